"""The demo with real processes on a software bus: what is killed, what is heard on the bus, and what is left behind."""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_dg.situation import situation
from heronry_manager.events import (
    EpochPrepared,
    Event,
    PeJoined,
    PeLost,
    PlannedAhead,
    PlanReady,
    PlanRequested,
    PlanUnchanged,
    Reconfigured,
)
from heronry_manager.events.reading import events_in
from heronry_manager.planner.exact import plan
from heronry_tools.analysis.made_ahead import contingencies_of
from heronry_tools.cli import main
from heronry_tools.console.contingencies_argument import Ahead
from heronry_tools.runtime.witness import Witness
from heronry_wire.frame import Malformed, parse_log_line
from live.processes import processes_that_mention
from live.told_events import next_event
from thoroughness import IS_WHOLE, mostly_soak

pytestmark = pytest.mark.live
BIG_BLUE = Path("dg_specs/big_blue.dg.yaml")
PES = list(load(BIG_BLUE).pes)
TRIPLEX = "dg_specs/examples/triplex_voting.dg.yaml"  # so small that a slow computer keeps up with it
PATIENCE_S = 200
HERONRY = [sys.executable, "-m", "heronry_tools"]
QUOTED = re.compile(r"^(\d\d:\d\d:\d\d\.\d{3} .+)$", re.MULTILINE)  # what a document shows of a flight


def demo(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*HERONRY, "demo", *arguments], capture_output=True, text=True, timeout=90, check=False)


def events_of(text: str) -> list[Event]:
    return list(events_in(text.splitlines()))


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder in which the demos of one test alone make theirs. Its name is short: sockets go into it."""
    with tempfile.TemporaryDirectory(prefix="d-", dir="/tmp") as folder:
        monkeypatch.setenv("TMPDIR", folder)
        monkeypatch.setattr(tempfile, "tempdir", folder)
        yield Path(folder)


@pytest.fixture
def nothing_left(home: Path) -> Iterator[None]:
    yield
    assert processes_that_mention(str(home)) == []
    assert list(home.glob("heronry-demo-*")) == []


@pytest.fixture(scope="session")
def planned_ahead(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    """Make plans for single faults of big_blue before the flight; give the demo's options that fly with them.

    In `make test` these are plans for the loss of a PE in the first phase, in a file; else all, where demos find them.
    """
    if IS_WHOLE:
        contingencies_of(load(BIG_BLUE), Ahead.SINGLE_FAULTS)
        return ()
    file = str(tmp_path_factory.mktemp("plans") / "pes.contingencies")
    scope = ["--faults", "1", "--kinds", "pe", "--phase", str(load(BIG_BLUE).initial_phase())]
    assert main(["contingencies", "big_blue", *scope, "-o", file, "--jobs", "1"]) == 0
    return ("--contingencies", file)


@pytest.mark.timing
@pytest.mark.parametrize("pe", mostly_soak(PES, ["flight"]))
def test_after_the_kill_of_any_pe_what_a_plan_can_serve_is_heard_on_the_bus(
    pe: str, tmp_path: Path, planned_ahead: tuple[str, ...], nothing_left: None
) -> None:
    log = tmp_path / "flight.log"
    ran = demo("--kill", f"pe:{pe}@1", "--for", "3", "--json", "--record", str(log), *planned_ahead)
    assert ran.returncode == 0, ran.stderr
    spec = load(BIG_BLUE)
    oracle = plan(spec, situation(spec, [f"pe:{pe}"]), None)
    served = {name for name, f in oracle.functions.items() if f.served}
    critical = {n for n in served if spec.functions[n].criticality_in(spec.initial_phase()) != "E"}
    heard = heard_at_the_end(log)
    assert critical - heard == set()
    assert called_for(events_of(ran.stdout), f"pe:{pe}"), "what is foreseen is called by its number"


def called_for(events: list[Event], element: str) -> bool:
    """Tell whether the first epoch without this element, if one was needed, was called by a number.

    Where the computer is busy with other things, something else may seem to be lost or limited before: two faults are
    not foreseen.
    """
    asked = [one for one in events if isinstance(one, PlanRequested)]
    first = next(one for one in asked if one.down or one.limits)
    if (first.down, first.limits) != ((element,), {}):
        return True
    since = events.index(first)
    epochs = [one for one in events[since:] if isinstance(one, PlanUnchanged | EpochPrepared)]
    return not epochs or isinstance(epochs[0], PlanUnchanged) or epochs[0].contingency > 0


def heard_at_the_end(log: Path) -> set[str]:
    spec, witness, last_ns = load(BIG_BLUE), Witness(load(BIG_BLUE)), 0
    for line in log.read_text().splitlines():
        logged = parse_log_line(line)
        assert not isinstance(logged, Malformed)
        if logged.channel == "can0":
            witness.see(logged.time_ns, logged.frame)
            last_ns = max(last_ns, logged.time_ns)
    assert witness.rivals == []
    return {name for name in spec.functions if witness.served(name, last_ns)}


@pytest.mark.timing
def test_two_kills_within_one_heartbeat_and_a_return(nothing_left: None) -> None:
    kills = ("--kill", "pe:nav@1", "--kill", "pe:air@1.01", "--restore", "pe:nav@2.5")
    ran = demo(TRIPLEX, *kills, "--for", "5", "--json")
    assert ran.returncode == 0, ran.stderr
    events = events_of(ran.stdout)
    assert {"nav", "air"} <= {one.pe for one in events if isinstance(one, PeLost)}
    joined = [one.pe for one in events if isinstance(one, PeJoined)]
    assert joined.count("nav") > 1
    last = [one for one in events if isinstance(one, PlanReady)][-1].plan
    assert last.down == ("pe:air",)


@pytest.mark.soak  # in every run the simulator kills a PE at each message of a reconfiguration (test_two_faults.py)
@pytest.mark.timing
def test_a_kill_during_a_reconfiguration(nothing_left: None) -> None:
    """The second PE dies about when the first one has been declared: its epoch is abandoned or replaced."""
    ran = demo(TRIPLEX, "--kill", "pe:nav@1", "--kill", "pe:air@1.09", "--for", "4", "--json")
    assert ran.returncode == 0, ran.stderr
    last = [one for one in events_of(ran.stdout) if isinstance(one, PlanReady)][-1].plan
    assert last.down == ("pe:air", "pe:nav")


def test_on_a_fresh_home_the_first_demo_flies_at_once(
    home: Path, monkeypatch: pytest.MonkeyPatch, nothing_left: None
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / "cache"))
    sentences = plans_told("0.5")
    assert sentences[0] == (
        "the 25 plans for every single fault are made in the background; this demo flies without them"
    )
    assert re.match(r"\d+ of 25 plans for single faults are made and kept[:,] ", sentences[1])


@pytest.mark.soak  # 25 plans in the background take long beside other tests
def test_a_later_demo_flies_with_the_plans(home: Path, monkeypatch: pytest.MonkeyPatch, nothing_left: None) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / "cache"))
    sentences, until_s = plans_told("0.5"), time.monotonic() + PATIENCE_S
    while not sentences[-1].endswith("are complete: the next demo uses them"):
        assert time.monotonic() < until_s, sentences
        sentences = plans_told("6")
    assert plans_told("0.5", "--kill", "pe:tail_pe@0.1") == []


def plans_told(seconds: str, *more: str) -> list[str]:
    """What a demo tells of plans made ahead; its manager asks for no plan before the flight."""
    ran = demo("elevator_and_chute", "--for", seconds, "--json", *more)
    assert ran.returncode == 0, ran.stderr
    assert "planning" not in ran.stderr
    return [one.sentence for one in events_of(ran.stdout) if isinstance(one, PlannedAhead)]


def test_a_failing_module_is_told_with_exception_file_and_line_and_the_logs_are_kept(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The module of the tutorial: it fails in its third step, and misspells its output, as the tutorial lets it.

    The flight says every line that the tutorial quotes of it, but for times, PEs and the name of the folder.
    """
    tutorial = Path("docs/tutorial.md").read_text()
    (block,) = re.findall(r"^```python\n(.*?)^```$", tutorial, re.MULTILINE | re.DOTALL)
    assert block.count('"state_info": 1.0 / self.steps') == 1
    wrong = block.replace('"state_info": 1.0 / self.steps', '"state_inof": 1.0 / (3 - self.steps)')
    (tmp_path / "my_estimator.py").write_text(wrong)
    healthy = Path("dg_specs/elevator_and_chute.dg.yaml").read_text()
    sick = healthy.replace("state_estimator: {", "state_estimator: {image: 'my_estimator:Estimator', ")
    (tmp_path / "sick.dg.yaml").write_text(sick)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    ran = demo(str(tmp_path / "sick.dg.yaml"), "--contingencies", "none", "--kill", "pe:sensor_pe@2", "--for", "3")
    kept = re.search(r"the logs of this run are kept in (.*); they are deleted after 5 more runs", ran.stdout)
    assert kept is not None, ran.stdout + ran.stderr
    logs = "".join(log.read_text() for log in Path(kept[1]).glob("*.log"))
    quoted = QUOTED.findall(tutorial)
    assert len(quoted) == 4
    said = {without_what_varies(line) for line in (ran.stdout + logs).splitlines()}
    assert [line for line in quoted if without_what_varies(line) not in said] == [], ran.stdout + logs
    assert re.search(r"^\d\d:\d\d:\d\d\.\d{3} module state_estimator: step 3$", logs, re.MULTILINE)
    assert re.search(r"module state_estimator: .*my_estimator\.py\", line 14, in step$", logs, re.MULTILINE)
    assert list(home.glob("heronry-demo-*")) == []


def without_what_varies(line: str) -> str:
    """A line of a demo or of a log, without its time, the PE on which a module ran, and where the logs are."""
    line = re.sub(r"^\d\d:\d\d:\d\d\.\d{3}( \[ *\d+\.\d\d s\])?", "", line)
    return re.sub(r"\bon \w+_pe\b|(?<=kept in )\S+(?=;)", "", line)


@pytest.mark.parametrize("number", mostly_soak([signal.SIGINT, signal.SIGTERM], [signal.SIGINT]))
def test_an_interrupted_demo_leaves_nothing(number: signal.Signals, nothing_left: None) -> None:
    with started_demo() as process:
        wait_for(process, Reconfigured)
        process.send_signal(number)
        assert process.wait(timeout=20) == 128 + number
        assert process.stderr is not None
        assert process.stderr.read() == b""


def test_a_demo_that_is_killed_takes_its_processes_along(home: Path) -> None:
    with started_demo() as process:
        wait_for(process, Reconfigured)
        (folder,) = home.glob(f"heronry-demo-{process.pid}-*")
        assert processes_that_mention(folder.name)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    end_s = time.monotonic() + PATIENCE_S
    while left := processes_that_mention(folder.name):
        assert time.monotonic() < end_s, left
        time.sleep(0.05)
    assert main(["demo", "elevator_and_chute", "-i", "socketcan", "-c", "can7"]) == 2  # the next demo sweeps it away
    assert not folder.exists()


class started_demo:  # noqa: N801 - reads as a verb
    def __enter__(self) -> "subprocess.Popen[bytes]":
        command = [*HERONRY, "demo", "elevator_and_chute", "--json", "--for", "60", "--contingencies", "none"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        return self.process

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()


def wait_for(process: "subprocess.Popen[bytes]", kind: type[Event]) -> None:
    assert process.stdout is not None
    next_event(process.stdout, kind)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--kill", "pe:nvv@1"], "did you mean 'nav'"),
        (["--kill", "nav"], "write it as pe:NAME@SECONDS"),
        (["nope"], "neither a file nor a shipped spec"),
        (["-i", "socketcan", "-c", "can7"], "can7"),
        (["-i", "softbus"], "needs a channel"),
        (["--bus", "radoi=vcan1"], "no such bus"),
        (["--record", "/no/such/folder/flight.log"], "No such file or directory"),
        (["--kill", "pe:nav@4", "--for", "3"], "--for 3: the demo would end before the action at 4 s"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, nothing_left: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", *arguments]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1
