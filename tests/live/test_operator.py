"""The operator and a running system: phases, faults, status, and callers that are refused.

The operator's commands run in this process, since another one would import for half a second.
"""

import json
import subprocess
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from io import BytesIO, TextIOWrapper
from pathlib import Path
from threading import Timer
from typing import Any

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager import events
from heronry_tools.cli import main
from live.told_events import E, next_event

pytestmark = pytest.mark.live
HERONRY = [sys.executable, "-m", "heronry_tools"]
ALONE = ("--contingencies", "none")  # no process makes plans behind the flight, for a later one
PATIENCE_S = 120.0
PHASES = "phases: {climb: {}, land: {}}\n"


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    """Figure 3 of the paper, with a phase in which no module watches the servos any more."""
    text = shipped_spec_path("elevator_and_chute").read_text()
    wanted = "output: servo_monitor, criticality: D, priority: 20"
    assert wanted in text
    text = text.replace(wanted, "output: servo_monitor, criticality: D, priority: {default: 20, land: 0}")
    file = tmp_path / "phases.dg.yaml"
    file.write_text(text.replace("functions:\n", f"{PHASES}functions:\n"))
    return file


def heronry(*arguments: str) -> subprocess.CompletedProcess[str]:
    """What a command says that ends at once."""
    out, err = (TextIOWrapper(BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with redirect_stdout(out), redirect_stderr(err):
        code = main(arguments)
    said, complained = (stream.buffer.getvalue().decode() for stream in (out, err))
    return subprocess.CompletedProcess(arguments, code, said, complained)


def test_the_demo_tells_a_kill_the_four_times_the_return_and_a_phase(spec: Path) -> None:
    show = ("--kill", "pe:sensor_pe@0.5", "--restore", "pe:sensor_pe@1.5", "--phase", "land@3", "--for", "4.5")
    told = subprocess.run(
        [*HERONRY, "demo", str(spec), *show, *ALONE], capture_output=True, text=True, timeout=90, check=False
    )
    assert told.returncode == 0, told.stdout + told.stderr
    for expected in ("KILL sensor_pe", "is lost", "detect", "decide", "distribute", "activate", "RESTORE", "joins"):
        assert expected in told.stdout
    assert "software bus" in told.stdout
    assert "PHASE land (was climb), requested by the operator" in told.stdout
    assert "- servo_monitor stops" in told.stdout


class Demo:
    """A demo that runs until it is told to end, and its manager's socket; it is killed if that takes too long."""

    def __init__(self, spec: Path, kill: str = "pe:sensor_pe@600") -> None:
        command = [*HERONRY, "demo", str(spec), "--kill", kill, "--json", *ALONE]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._latest = Timer(PATIENCE_S, self.process.kill)
        self._latest.start()
        self.flags = self.until(events.Orders).flags.split()

    def until(self, kind: type[E], **fields: Any) -> E:
        """Wait for an event; the demo may end, or be killed after PATIENCE_S, before that."""
        assert self.process.stdout is not None
        return next_event(self.process.stdout, kind, **fields)

    def say(self, *order: str) -> subprocess.CompletedProcess[str]:
        return heronry(order[0], *order[1:], *self.flags)

    def fly(self, script: Path, spec: Path) -> subprocess.CompletedProcess[str]:
        return self.say("pcs", "apply", str(script), str(spec), "--live")

    def status(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.say("status", "--json").stdout)
        return found

    def end(self) -> None:
        self._latest.cancel()
        self.process.terminate()
        self.process.wait(30)
        assert self.process.stdout is not None
        self.process.stdout.close()


def test_an_operator_at_work(spec: Path) -> None:
    demo = Demo(spec)
    try:
        demo.until(events.Reconfigured)
        assert demo.status()["phase"] == "climb"
        assert "land from now on" in demo.say("phase", "land").stdout
        demo.until(events.Reconfigured, causes=["phase land, requested by the operator"])
        assert "counts as failed" in demo.say("fail", "device:gps").stdout
        demo.until(events.Reconfigured)
        status = demo.status()
        assert (status["phase"], [fault["element"] for fault in status["latched"]]) == ("land", ["device:gps"])
        assert "device:gps counts as failed, reported by the operator" in demo.say("status").stdout
        assert "no longer counts as failed" in demo.say("clear", "device:gps").stdout
        demo.until(events.FaultCleared, element="device:gps")
        refused = demo.say("clear", "device:gps")
        assert (refused.returncode, refused.stdout) == (1, "")
        assert "no fault is latched on device:gps" in refused.stderr
        assert demo.say("phase", "lnd").stderr.startswith("heronry: no phase is named 'lnd'; did you mean 'land'?")
    finally:
        demo.end()


@pytest.mark.soak  # in every run test_demo_folder.py holds two names, and test_control_socket.py finds two sockets
def test_the_demo_is_found_by_its_name_and_of_two_each(spec: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with tempfile.TemporaryDirectory(dir="/tmp") as runtime:
        monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
        first, second = Demo(spec), Demo(spec)
        try:
            name = load(spec).name
            assert (first.flags, second.flags) == (["--of", f"{name}-demo"], ["--of", f"{name}-demo-2"])
            first.until(events.Reconfigured)
            second.until(events.Reconfigured)
            assert f"there are 2 managers: {name}-demo, {name}-demo-2" in heronry("status").stderr
            second.end()
            assert json.loads(heronry("status", "--json").stdout)["spec"] == name
        finally:
            first.end()
            second.end()
        assert list(Path(runtime).glob("heronry/*.sock")) == []


def test_where_no_manager_runs_one_sentence_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    for arguments in (["status"], ["phase", "land", "--of", "big_blue"], ["status", "--socket", str(tmp_path / "no")]):
        assert main(arguments) == 2
        said = capsys.readouterr().err
        assert "no manager" in said
        assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--phase", "moon@1"], "no phase is named 'moon'"),
        (["--phase", "land"], "write it as NAME@SECONDS"),
    ],
)
def test_a_phase_that_cannot_be_played_is_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", *arguments]) == 2
    assert sentence in capsys.readouterr().err
