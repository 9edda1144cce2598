"""`heronry sim` as a user sees it: output, exit codes, and the command that replays a flight."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError
from heronry_tools.sim.faults.fault import KINDS
from heronry_tools.sim.faults.protocol_state import STATES
from heronry_tools.sim.flight.campaign import Coverage, fly_all
from heronry_tools.sim.flight.flyable import check_images
from thoroughness import mostly_soak

ESTIMATOR = "  state_estimator: {"


def die(_spec: Spec, number: int) -> None:
    """A flight whose process dies."""
    os.kill(os.getpid(), number)


@pytest.fixture
def raising(tmp_path: Path) -> Path:
    """A spec with a module that raises half a second after its start; the oracle does not know of the fault."""
    text = shipped_spec_path("elevator_and_chute").read_text()
    file = tmp_path / "raising.dg.yaml"
    file.write_text(text.replace(ESTIMATOR, f'{ESTIMATOR}image: "scenarios.raising:RaisesAfterHalfASecond", '))
    return file


def test_a_flight_is_told_with_its_four_times(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "elevator_and_chute", "--kill", "pe:tail_pe@0.5", "--seconds", "1"]) == 0
    head, *reconfigurations, _ = capsys.readouterr().out.splitlines()
    assert head.startswith("seed 0: 0.5 crash pe:tail_pe (")
    assert len(reconfigurations) == 2
    assert all(name in reconfigurations[1] for name in ("detect", "decide", "distribute", "activate"))
    assert reconfigurations[1].endswith("pe:tail_pe: silent for 3 heartbeat periods")


def test_a_long_flight_shows_on_a_terminal_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["sim", "elevator_and_chute", "--kill", "pe:tail_pe@0.5", "--seconds", "3.5"]
    monkeypatch.setattr("heronry_tools.console.progress._EVERY_S", 0.0)
    assert main(words) == 0
    told = capsys.readouterr()
    assert told.err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main(words) == 0
    seen = capsys.readouterr()
    assert seen.out == told.out  # the same frames
    assert "elevator_and_chute, seed 0: seconds flown: 2 of 3, " in seen.err
    assert seen.err.endswith("\r\x1b[K")
    assert main([*words, "--json"]) == 0
    assert "seconds flown" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "seconds"),
    [
        ([], 5.0),
        (["--kill", "pe:tail_pe@6", "--restore", "pe:tail_pe@7"], 8.0),
        (["--kill", "pe:tail_pe@0.5", "--restore", "pe:tail_pe@1.5", "--seconds", "1"], 1.5),
        (["--kill", "pe:tail_pe@0.5", "--seconds", "1"], 1.0),
        (["--act", "1 manager_pause manager for 0.2 in idle", "--seconds", "2"], 4.2),  # it may have to wait
    ],
)
def test_a_flight_lasts_until_its_faults_are_over(
    words: list[str], seconds: float, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", "elevator_and_chute", *words, "--json"]) == 0
    replay = shlex.split(json.loads(capsys.readouterr().out)["replay"])
    assert float(replay[replay.index("--seconds") + 1]) == seconds
    assert main([*replay[1:], "--json"]) == 0
    assert shlex.split(json.loads(capsys.readouterr().out)["replay"]) == replay


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["--act", "1 manager_crash manager for 0.2 in activating", "--seconds", "2"],
            (
                "'1 manager_crash manager for 0.2 in activating' was not injected as given "
                "(injected: manager_crash in idle)"
            ),
        ),
        (
            ["--kill", "pe:tail_pe@1", "--act", "1.5 pause pe:tail_pe for 0.1"],
            "'1.5 pause pe:tail_pe for 0.1' was not injected as given (injected: crash in idle); try another seed",
        ),
    ],
)
def test_a_given_fault_that_is_not_injected_fails_the_flight(
    words: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["sim", "elevator_and_chute", *words, "--shrink"]) == 1
    assert f"missed: {sentence}" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []  # there is no failure to be kept


def test_a_manager_is_killed_at_the_given_second(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "elevator_and_chute", "--standby", "--kill", "manager@1", "--json"]) == 0
    flight = json.loads(capsys.readouterr().out)
    assert [hit["kind"] for hit in flight["hits"]] == ["manager_crash"]


@pytest.mark.parametrize("seat", ["primary", "standby"])
def test_either_of_two_managers_is_killed(seat: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--standby", "--kill", f"{seat}@0.5", "--kill", "pe:tail_pe@0.7", "--seconds", "1", "--json"]
    assert main(["sim", "elevator_and_chute", *words]) == 0
    faults = json.loads(capsys.readouterr().out)["acts"]
    assert faults == [f"0.5 manager_crash {seat}", "0.7 crash pe:tail_pe"]


def test_a_file_without_faults_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "none.acts"
    file.write_text("# 1 crash pe:tail_pe\n\n")
    assert main(["sim", "elevator_and_chute", "--acts", str(file)]) == 2
    assert (
        capsys.readouterr().err
        == f"heronry: --acts {file}: the file lists no faults; write one fault per line, or leave --acts out\n"
    )
    file.write_bytes(b"\xff\xfe")
    assert main(["sim", "elevator_and_chute", "--acts", str(file)]) == 2
    assert "the file is not text in UTF-8; name a file with one fault per line" in capsys.readouterr().err


def test_a_file_that_is_no_spec_is_told_from_one_that_is_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bin"
    file.write_text("some")
    assert main(["sim", str(file)]) == 2
    assert f"{file}: the name of a spec's file must end in .dg.yaml" in capsys.readouterr().err


def test_each_seed_draws_its_own_losses_and_replays_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "elevator_and_chute", "--runs", "3", "--seconds", "1", "--loss", "0.01", "--json"]) == 0
    *flights, whole = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert (whole["flights"], whole["failed"]) == (3, 0)
    page = Path("docs/simulator.md").read_text().partition("## For programs")[2].partition("## How fast")[0]
    assert [key for key in (*flights[0], *whole, *whole["coverage"]) if f"`{key}`" not in page] == []
    assert sum(cell["count"] for cell in whole["coverage"]["cells"]) == sum(
        hit["count"] for flight in flights for hit in flight["hits"]
    )
    assert [flight["seed"] for flight in flights] == [0, 1, 2]
    assert len({json.dumps(flight["acts"]) for flight in flights}) == 3
    assert ["--foreseen 1" in flight["replay"] for flight in flights] == [False, True, False]
    for flight in flights[1:]:
        program, *words = shlex.split(flight["replay"])
        assert program == "heronry"
        assert main([*words, "--json"]) == 0
        assert json.loads(capsys.readouterr().out) == flight


def test_the_columns_of_the_table_stand_below_each_other() -> None:
    coverage = Coverage(load(shipped_spec_path("elevator_and_chute")), of_two=True)
    coverage.entered += Counter(STATES)
    head, *rows = coverage.table()
    kinds = [row for row in rows if row.split()[0] in KINDS]
    assert any(row.startswith("manager_clock_jump ") for row in kinds)
    assert {len(row) for row in kinds} == {len(head)}


def test_a_contingency_runs_sooner_than_a_new_plan_and_is_called_by_its_number(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["sim", "elevator_and_chute", "--kill", "pe:tail_pe@0.5", "--seconds", "1", "--json"]
    assert main(words) == 0
    assert main([*words, "--foreseen", "1"]) == 0
    sent, called = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    distribute = [flight["reconfigurations"][1]["times_ns"]["distribute"] for flight in (sent, called)]
    assert distribute[1] < distribute[0]


def test_a_violation_is_told_with_the_command_that_replays_it(
    raising: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", str(raising), "--kill", "pe:tail_pe@2", "--seed", "4", "--seconds", "3"]) == 1
    out = capsys.readouterr().out.splitlines()
    assert any("VIOLATION" in line and "module:state_estimator@tail_pe is reported" in line for line in out)
    assert out[-2:] == [
        f"  replay with: heronry sim {raising} --seed 4 --seconds 3 --act '2 crash pe:tail_pe'",
        "the flight FAILED",
    ]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--kill", "pe:tail@1"], "did you mean 'tail_pe'"),
        (["--kind", "collapse"], "elevator_and_chute has no far bus for a fault of this kind"),
        (["--kill", "tail_pe"], "write it as pe:NAME@SECONDS"),
        (["--restore", "pe:tail_pe@1"], "kill and restore in turn"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", "elevator_and_chute", *words]) == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--seconds", "-1"], "0 to 86400 seconds"),
        (["--loss", "0.9"], "0 to 0.5"),
        (["--runs", "-2"], "0 or more"),
        (["--runs", "0"], "1 or more"),
        (["--seed", "x"], "x is not a whole number; write 0 or more"),
        (["--seconds", "x"], "x is not a flight time; write 0 to 86400 seconds"),
    ],
)
def test_a_number_that_makes_no_sense_is_refused(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["sim", "elevator_and_chute", *words])
    assert stopped.value.code == 2
    assert sentence in capsys.readouterr().err


def test_a_module_without_code_cannot_be_simulated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "no_code.dg.yaml"
    text = shipped_spec_path("elevator_and_chute").read_text()
    file.write_text(text.replace(ESTIMATOR, f"{ESTIMATOR}image: state_estimater, "))
    assert main(["sim", str(file)]) == 2
    assert "module state_estimator cannot be simulated" in capsys.readouterr().err


def test_one_flight_ends_with_its_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "elevator_and_chute", "--seconds", "1", "--act", "0.2 crash pe:tail_pe"]) == 0
    assert capsys.readouterr().out.endswith("\nthe flight passed: no oracle was violated\n")


def test_a_campaign_flies_in_parallel_as_it_does_alone_and_says_what_it_has_reached(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["sim", "elevator_and_chute", "--runs", "3", "--seconds", "1"]
    assert main(words) == 0
    alone = capsys.readouterr().out
    assert main([*words, "--jobs", "2"]) == 0
    assert capsys.readouterr().out == alone
    lines = alone.splitlines()
    assert lines[-1] == "3 flights, 0 failed"
    assert any(line.startswith("faults in state") and line.split()[3:] == list(STATES) for line in lines)


def name_of(part: object) -> str:
    return part.split()[0] if isinstance(part, str) else str(getattr(part, "__name__", part))


def members(group: int) -> int:
    """How many processes of a group run."""
    found = subprocess.run(["ps", "-eo", "pgid=,stat="], check=True, capture_output=True, text=True).stdout
    return sum(line.split()[0] == str(group) and "Z" not in line for line in found.splitlines())


FLIES, PLANS = "sim elevator_and_chute --runs 100 --seconds 60", "contingencies big_blue -o plans"
STARTING, STARTED = 2, 4  # processes: a first one is being started, or all are; the others import
ENDINGS = list(product((FLIES, PLANS), (STARTING, STARTED), (os.kill, os.killpg), (signal.SIGINT, signal.SIGTERM)))
ALWAYS = [
    (FLIES, STARTING, os.kill, signal.SIGTERM),
    (FLIES, STARTED, os.killpg, signal.SIGINT),
    (PLANS, STARTING, os.killpg, signal.SIGTERM),
    (PLANS, STARTED, os.kill, signal.SIGINT),
]


@pytest.mark.live
@pytest.mark.parametrize("ending", mostly_soak(ENDINGS, ALWAYS), ids=lambda ending: " ".join(map(name_of, ending)))
def test_what_has_processes_of_its_own_and_is_ended_ends_at_once_and_leaves_nothing_behind(
    ending: tuple[str, int, Callable[[int, int], None], signal.Signals], tmp_path: Path
) -> None:
    words, there, end, number = ending
    with subprocess.Popen(
        [sys.executable, "-m", "heronry_tools", *words.split(), "--jobs", "2"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        while members(process.pid) < there:
            assert process.poll() is None, "it ended before the signal came"
        end(process.pid, number)
        told = process.communicate(timeout=20)
    assert process.returncode == 128 + number
    assert told in (("", ""), ("", "heronry: stopped; the same command continues from plans.partial\n"))
    until_s = time.monotonic() + 5  # the last processes end when their pipe is closed
    while members(process.pid) and time.monotonic() < until_s:
        time.sleep(0.01)
    assert members(process.pid) == 0


def test_a_flying_process_that_dies_is_reported_in_one_sentence() -> None:
    flown = fly_all(shipped_spec_path("elevator_and_chute"), [signal.SIGKILL] * 3, 2, die)
    with pytest.raises(UserError, match="repeat the command"):
        list(flown)


def test_a_failing_flight_is_shrunk_to_the_faults_that_matter(
    raising: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    faults = [f"{n / 10} doubled bus:can0 for 0.05 level 1" for n in range(4)]
    words = ["sim", str(raising), "--seconds", "1", *(word for fault in faults for word in ("--act", fault))]
    assert main([*words, "--shrink"]) == 1
    head = capsys.readouterr().out.splitlines()[0]
    assert head.count("doubled") == 1
    (file,) = tmp_path.glob("*.scenario")
    assert "module:state_estimator@tail_pe is reported" in file.read_text()
    assert main(["scenario", str(file)]) == 1
    assert "module:state_estimator@tail_pe is reported" in capsys.readouterr().out
    assert main(["scenario", str(file), "-i", "softbus"]) == 2
    assert "no 'expect' in this file" in capsys.readouterr().err


def test_what_was_shrunk_is_shown_where_it_cannot_be_kept(
    raising: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert (
        main(["sim", str(raising), "--seconds", "1", "--act", "0.1 doubled bus:can0 for 0.05 level 1", "--shrink"]) == 1
    )
    told = capsys.readouterr().err
    assert "cannot be written (No such file or directory); this is what it would hold:\n# " in told
    assert "at 0.1s doubled bus:can0 for 0.007s" in told


def test_a_spec_with_a_space_in_its_path_is_shrunk_and_replayed(
    raising: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "my specs"
    folder.mkdir()
    spec = folder / raising.name
    spec.write_text(raising.read_text())
    monkeypatch.chdir(tmp_path)
    assert main(["sim", str(spec), "--seconds", "1.51234", "--act", "0.9 clock_jump pe:tail_pe", "--shrink"]) == 1
    replay = next(line for line in capsys.readouterr().out.splitlines() if "replay with: " in line)
    assert "--seconds 1.51234 --act '0.9 clock_jump pe:tail_pe level 1'" in replay
    words = shlex.split(replay.partition("replay with: ")[2])
    assert main(words[1:]) == 1
    (file,) = tmp_path.glob("*.scenario")
    assert "end 1.513s" in file.read_text()
    assert main(["scenario", str(file)]) == 1
    assert "is reported" in capsys.readouterr().out


@pytest.mark.parametrize("loss", mostly_soak(["0.01", "0.00001"], ["0.00001"]))
def test_a_shrunk_flight_on_noisy_buses_stays_noisy(
    loss: str, raising: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = [
        "sim",
        str(raising),
        "--seconds",
        "1",
        "--loss",
        loss,
        "--foreseen",
        "1",
        "--act",
        "0.5 pause pe:tail_pe for 0.08 in suspect",
    ]
    assert main([*words, "--shrink"]) == 1
    (file,) = tmp_path.glob("*.scenario")
    lines = file.read_text().splitlines()
    assert f"loss {loss}" in lines
    assert "contingencies 1" in lines
    assert "at 0.5s pause pe:tail_pe for 0.01s" in lines
    assert main(["scenario", str(file)]) == 1
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--act", "soon"], "write SECONDS KIND ELEMENT"),
        (["--act", "1 explode pe:tail_pe"], "there is no fault kind 'explode'"),
        (["--act", "1 pause pe:tail_pe in doubt"], "there is no state 'doubt'"),
        (["--act", "1 pause pe:tail"], "did you mean 'tail_pe'"),
        (
            ["--act", "1 babble bus:can0 for 0.1 level 99999"],
            "babble has a level from 0 to 2047, not 99999; in this fault a foreign node sends",
        ),
        (
            ["--act", "1 loss bus:can0 for 0.1 level 5000"],
            "loss has a level from 1 to 1000, not 5000; in this fault frames are destroyed",
        ),
        (["--act", "1 pause pe:tail_pe for 0.1 level 3"], "pause has no level; leave it out"),
        (["--act", "1 pause device:gps"], "pause cannot be injected into device:gps"),
        (["--act", "1 manager_crash standby"], "the flight has only one manager; write 'manager', or add --standby"),
        (["--kind", "explode"], "no kind of fault has this name"),
        (
            ["--act", "90000 crash pe:tail_pe"],
            "begins or ends after 86400 s, the longest flight; write an earlier time",
        ),
        (["--act", "1 crash pe:tail_pe for 100000"], "begins or ends after 86400 s"),
        (["--kill", "pe:tail_pe@1", "--restore", "pe:tail_pe@90000"], "begins or ends after 86400 s"),
        (["--kill", "primary@4"], "the flight has only one manager; write 'manager', or add --standby"),
        (["--acts", "nowhere.acts"], "nowhere.acts: No such file or directory; name a file with one fault per line"),
    ],
)
def test_a_fault_that_makes_no_sense_is_refused_in_a_sentence(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", "elevator_and_chute", *words]) == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize("command", ["sim", "exhaust"])
def test_an_aircraft_with_flight_dynamics_is_left_to_heronry_fly(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "eav"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "has no flight dynamics" in said.err
    assert "fly eav with 'heronry fly'" in said.err


def test_code_beside_the_user_is_found_as_in_the_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = next(iter(load(shipped_spec_path("elevator_and_chute")).modules.values()))
    spec = SimpleNamespace(modules={module.name: replace(module, image="code_of_this_folder:Own")})
    with pytest.raises(UserError, match="cannot import code_of_this_folder"):
        check_images(cast("Spec", spec))
    text = (
        "from heronry_agent.module import Module\nclass Own(Module):\n    def step(self, inputs):\n        return {}\n"
    )
    (tmp_path / "code_of_this_folder.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*sys.path])
    check_images(cast("Spec", spec))
