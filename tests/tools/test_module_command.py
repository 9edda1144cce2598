"""`heronry module try`: a module without a bus, and what its author sees when it fails."""

import json
from pathlib import Path

import pytest

from heronry_tools.cli import main

SPEED = """
from heronry_agent.module import Module


class Speed(Module):
    def step(self, inputs):
        print("reading", self.ctx.read())
        if self.ctx.mode == "broken":
            return {"airspeed": 1.0 / (inputs["density"].number() - 1.0)}
        if self.ctx.mode == "odd":
            return {"airspeed": object()}
        self.ctx.write(3)
        self.ctx.report_failed("device:pitot", 7)
        self.ctx.request_phase("landing")
        return {"airspeed": self.ctx.now_ns / 1e9, "raw": b"\\x01", "all": inputs.get("list").value}


class Unbuildable(Module):
    def __init__(self, ctx):
        raise LookupError("no calibration")


class Hanging(Module):
    def step(self, inputs):
        while True:
            try:
                while True:
                    pass
            except Exception:
                pass


class Requesting(Module):
    def step(self, inputs):
        self.ctx.request_priority("imaging", 7)
        self.ctx.request_priority("guidance", None)
        return {}


class Leaving(Module):
    def step(self, inputs):
        raise SystemExit
"""


STATEFUL = """
from heronry_agent.module import Module


class Counting(Module):
    count = 0

    def step(self, inputs):
        self.count += 1
        return {"count": self.count}

    def save(self):
        return (self.count, 2.5, -1)

    def restore(self, state, age_ns):
        self.count = int(state[0])


class Early(Counting):
    def save(self):
        return ()


class Slow(Counting):
    def save(self):
        while True:
            pass

class Unsaved(Counting):
    def save(self):
        return (float("nan"),)


class Unrestored(Counting):
    def restore(self, state, age_ns):
        raise LookupError("another time")


class Unbuilt(Counting):
    built = False

    def __init__(self, ctx):
        super().__init__(ctx)
        if Unbuilt.built:
            raise LookupError("only once")
        Unbuilt.built = True
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A folder with a module, whose name no other test uses."""
    name = f"speed_{abs(hash(tmp_path))}"
    (tmp_path / f"{name}.py").write_text(SPEED)
    (tmp_path / f"{name}_unfit.py").write_text("import no_such_package\n")
    (tmp_path / f"{name}_state.py").write_text(STATEFUL)
    (tmp_path / f"{name}_typo.py").write_text("def step(:\n")
    monkeypatch.chdir(tmp_path)
    return name


def test_a_module_that_hangs_has_failed_after_the_limit(folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["module", "try", f"{folder}:Hanging", "--limit", "0.2"]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    last = err.splitlines()[-1]
    assert last.startswith(f"heronry: the module failed in step 1: it has not ended after 0.2 s ({folder}.py:")
    assert err.startswith("Stack (most recent call last):\n")
    assert "module_runner.py" not in err
    with pytest.raises(SystemExit, match="2"):
        main(["module", "try", f"{folder}:Hanging", "--limit", "0"])
    assert "0 cannot be the limit; write a number of seconds" in capsys.readouterr().err


def test_code_that_hangs_when_it_is_imported_has_failed(
    tmp_path: Path, folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / f"{folder}_slow.py").write_text("import time\ntime.sleep(60)\n")
    assert main(["module", "try", f"{folder}_slow:Slow", "--limit", "0.2"]) == 1
    err = capsys.readouterr().err
    assert err.splitlines()[-1] == (
        f"heronry: the module failed before its first step: it has not ended after 0.2 s ({folder}_slow.py:2)"
    )
    assert "importlib" not in err


def test_a_syntax_error_shows_no_frame_but_its_own(folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["module", "try", f"{folder}_typo:Any"]) == 1
    err = capsys.readouterr().err
    assert "importlib" not in err
    assert "image_catalogues" not in err
    assert f"{folder}_typo.py" in err


def test_a_module_computes_some_steps(folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    inputs = ("--inputs", "density=1.5", "list=1,2", "--reading", "3.5")
    assert main(["module", "try", f"{folder}:Speed", *inputs, "--steps", "2", "--rate-hz", "4"]) == 0
    out, err = capsys.readouterr()
    printed = out.splitlines()
    assert err == "reading 3.5\n" * 2
    does = "raw=b'\\x01', all=(1, 2), writes 3, reports device:pitot failed, detail 7, requests phase landing"
    assert printed[:2] == [f"step 1: airspeed=0.0, {does}", f"step 2: airspeed=0.25, {does}"]
    assert printed[2].startswith("longest step ")
    assert printed[2].endswith(" of a period of 250 ms")


def test_a_step_that_only_requests_priorities_is_shown(folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["module", "try", f"{folder}:Requesting", "--steps", "1"]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "step 1: requests priority 7 of imaging, requests the spec's priority of guidance"
    assert main(["module", "try", f"{folder}:Requesting", "--steps", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["steps"][0]["priorities"] == [["imaging", 7], ["guidance", None]]


def test_a_module_that_ends_its_process_has_failed(folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["module", "try", f"{folder}:Leaving"]) == 1
    assert "SystemExit(None): on a PE this ends the process, with all modules in it" in capsys.readouterr().err


def test_a_failing_step_shows_exception_place_and_traceback(folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["module", "try", f"{folder}:Speed", "--mode", "broken", "--inputs", "density=1"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("reading None\nTraceback (most recent call last):\n")
    sentence = f"heronry: the module failed in step 1: ZeroDivisionError: float division by zero ({folder}.py:9)\n"
    assert error.endswith(sentence)


@pytest.mark.parametrize(
    ("image", "mode", "reason"),
    [
        ("{}:Unbuildable", "only", "before its first step: LookupError: no calibration ({}.py:20)"),
        ("{}:Speed", "odd", "is no value of a module: use int, float, str, bytes or a tuple of int"),
        ("{}_unfit:Speed", "only", "the code cannot be imported: image '{}_unfit:Speed': cannot import {}_unfit"),
        ("{}_typo:Speed", "only", "the code cannot be imported: SyntaxError: invalid syntax ({}_typo.py, line 1)"),
    ],
)
def test_every_failure_has_its_reason(
    folder: str, image: str, mode: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["module", "try", image.replace("{}", folder), "--mode", mode, "--inputs", "density=2"]) == 1
    assert reason.replace("{}", folder) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        ("{}:Sped", "image '{}:Sped': {} has no class Sped derived from heronry_agent.module.Module"),
        ("{}_no:Speed", "image '{}_no:Speed': cannot import {}_no"),
        ("state_estimater", "did you mean 'state_estimator'?"),
    ],
)
def test_code_that_is_not_there_is_a_mistake_on_the_command_line(
    folder: str, image: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["module", "try", image.replace("{}", folder)]) == 2
    assert reason.replace("{}", folder) in capsys.readouterr().err


def test_a_program_gets_json_and_prints_of_the_module_do_not_disturb_it(
    folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["module", "try", f"{folder}:Speed", "--inputs", "list=a,b", "--json", "--steps", "1"]) == 0
    printed = capsys.readouterr()
    told = json.loads(printed.out)
    assert told["ok"]
    assert told["steps"][0]["outputs"] == {"airspeed": 0.0, "raw": "01", "all": "a,b"}
    assert printed.err == "reading None\n"
    assert main(["module", "try", f"{folder}:Unbuildable", "--json"]) == 1
    failure = json.loads(capsys.readouterr().out)["failure"]
    assert failure["in_step"] == 0
    assert failure["reason"] == f"LookupError: no calibration ({folder}.py:20)"
    assert "no calibration" in failure["traceback"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [(["--inputs", "density"], "write it as NAME=VALUE"), (["--steps", "0"], "--steps must be at least 1")],
)
def test_a_mistake_on_the_command_line_is_one_sentence(
    folder: str, arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["module", "try", f"{folder}:Speed", *arguments]) == 2
    assert sentence in capsys.readouterr().err


SIZES = "state: 24 bytes, 6 frames on a bus each time; in the spec: checkpoint: {bytes: 24, hz: ..., max_age_ms: ...}"


@pytest.mark.parametrize(
    ("image", "code", "says"),
    [
        ("Counting", 0, f"{SIZES}\nstate: restored by a new object\n"),
        ("Early", 0, "state: none yet; save returns nothing after these steps\n"),
        ("Unsaved", 1, "state: cannot be saved (NO_NUMBERS): save gives (nan,); return a tuple of finite numbers\n"),
        ("Slow", 1, "state: cannot be saved (HANGS): save takes too long\n"),
        ("Unrestored", 1, f"{SIZES}\nstate: cannot be restored (REFUSED): LookupError: another time"),
        ("Unbuilt", 1, SIZES),
    ],
)
def test_a_state_is_saved_and_restored(
    image: str, code: int, says: str, folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["module", "try", f"{folder}_state:{image}"]) == code
    assert says in capsys.readouterr().out
    assert main(["module", "try", f"{folder}_state:{image}", "--json"]) in (0, 1)
    document = json.loads(capsys.readouterr().out)
    assert document["state"] is None or document["state"]["restored"] is (image == "Counting")


def test_a_class_without_save_has_no_state(folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["module", "try", f"{folder}:Requesting", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["state"] is None
