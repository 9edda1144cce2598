"""Partitions as real processes: whatever a module does to its own, the agent gets one sentence, and others go on."""

import os
import select
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from unittest.mock import ANY

import pytest

from agent.one_pe import CONTROL, MONITOR, SERVO_1, TABLE
from agent.recorded_devices import RecordedDriver
from heronry_agent.core.step_times import HUNG_NS
from heronry_agent.core.vocabulary import (
    Drive,
    Driven,
    EndPartition,
    ImagesMissing,
    MeasureStep,
    ModuleEvent,
    NotReady,
    PartitionEnded,
    StartFailed,
    StartModule,
    StepFailed,
    StepMeasured,
    StepModule,
    Stepped,
    StopModule,
)
from heronry_agent.shell.devices import Devices
from heronry_agent.shell.module_runner import Orders
from heronry_agent.shell.partition_groups import PartitionGroups
from heronry_agent.shell.partition_host import PartitionHost
from heronry_agent.shell.partition_messages import Answer, Done, Load, Loaded, Start, Step, decode_answer
from heronry_agent.shell.partition_process import PartitionProcess

pytestmark = pytest.mark.live

PATIENCE_S = 20.0
LONG_NS = 3_600_000_000_000


@pytest.fixture(autouse=True)
def _path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Partitions find the modules of the tests."""
    tests = Path(__file__).resolve().parents[1]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(tests), os.environ.get("PYTHONPATH", ""))))


class Hosted:
    """A host with `control` in one partition, and `monitor` and `servo_1` in another, or all in one."""

    def __init__(self, image: str, good: str = "good", groups: PartitionGroups | None = None) -> None:
        images = {CONTROL: image, MONITOR: "Misbehaving", SERVO_1: "Misbehaving"}
        modules = tuple(
            replace(
                module,
                image=f"live.modules_that_misbehave:{images[module.index]}",
                partition="bad" if module.index == CONTROL else good,
            )
            for module in TABLE.modules
            if module.index in images
        )
        self.entries = {module.index: module for module in modules}
        table = replace(TABLE, modules=modules)
        self.driver = RecordedDriver()
        self.host = PartitionHost(table, Devices(table, {"left": self.driver}), groups)
        self.releases = 0

    def do(self, action: object) -> ModuleEvent | None:
        return self.host.carry_out(action, time.monotonic_ns())  # type: ignore[arg-type]

    def start(self, module: int, mode: int = 0) -> None:
        assert self.do(StartModule(module, self.entries[module], mode)) is None

    def next(self) -> ModuleEvent:
        """Next thing that the host has to tell."""
        end_ns = time.monotonic_ns() + int(PATIENCE_S * 1e9)
        while (now_ns := time.monotonic_ns()) < end_ns:
            self.host.flush(now_ns)
            watched, due_ns = self.host.watch(now_ns)
            ready, _, _ = select.select(watched, [], [], max(0, min(end_ns, due_ns) - now_ns) / 1e9)
            events = self.host.take(ready, time.monotonic_ns())
            if events:
                assert len(events) == 1
                return events[0]
        raise AssertionError("the host has nothing to tell")

    def step(self, module: int) -> ModuleEvent:
        """What comes of the next step, when the partition is ready for it."""
        self.releases += 1
        self.do(StepModule(module, self.releases, {}, time.monotonic_ns() + LONG_NS))
        event = self.next()
        if event == NotReady(module, self.releases):
            return self.step(module)
        return event

    def demand(self, module: int) -> object:
        event = self.step(module)
        assert isinstance(event, Stepped), event
        return event.outputs["demand"]

    def misbehave(self) -> ModuleEvent:
        """Start both, step them twice, and give what comes of the third step of `control`."""
        self.start(CONTROL)
        self.start(MONITOR)
        assert [self.demand(module) for module in (CONTROL, MONITOR) * 2] == [1.0, 1.0, 2.0, 2.0]
        return self.step(CONTROL)

    def pids(self) -> dict[str, int]:
        return {one.name: one.pid for one in self.host.watch(0)[0] if isinstance(one, PartitionProcess)}


@pytest.fixture
def hosted(request: pytest.FixtureRequest) -> Iterator[Hosted]:
    hosted = Hosted(request.param)
    yield hosted
    hosted.host.close()
    assert hosted.pids() == {}


def on(image: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("hosted", [image], indirect=True)


@pytest.mark.parametrize(
    ("hosted", "reason"),
    [
        ("Segfaults", "killed by SIGSEGV"),
        ("Exits", "exit code 3"),
        ("Leaves", "exit code 1"),
        ("HangsUp", "killed by SIGKILL"),
        ("Floods", "a packet of kind 108 is no answer"),
    ],
    indirect=["hosted"],
)
def test_a_partition_that_ends_is_reported_and_the_other_one_goes_on_and_so_does_its_successor(
    hosted: Hosted, reason: str
) -> None:
    assert hosted.misbehave() == PartitionEnded("bad", reason, CONTROL)
    assert hosted.demand(MONITOR) == 3.0
    hosted.start(CONTROL)
    assert hosted.demand(CONTROL) == 1.0


@pytest.mark.parametrize(
    ("hosted", "reason"), [("Eats", "MemoryError"), ("Shouts", "the results of a step take")], indirect=["hosted"]
)
def test_one_that_takes_or_gives_too_much_fails_in_its_own_step(hosted: Hosted, reason: str) -> None:
    event = hosted.misbehave()
    assert isinstance(event, StepFailed)
    assert event.reason.startswith(reason)
    assert hosted.demand(CONTROL) == 4.0


@pytest.mark.parametrize("hosted", ["Spins", "Sleeps", "Stops"], indirect=True)
def test_a_hang_is_measured_and_ended_from_outside(hosted: Hosted) -> None:
    hosted.start(CONTROL)
    hosted.start(MONITOR)
    hosted.demand(CONTROL), hosted.demand(CONTROL)
    hosted.releases += 1
    release = hosted.releases
    hosted.do(StepModule(CONTROL, release, {}, time.monotonic_ns() + LONG_NS))
    spent_ns = 0
    while spent_ns < HUNG_NS:  # the other one computes meanwhile
        assert isinstance(hosted.step(MONITOR), Stepped)
        measured = hosted.do(MeasureStep(CONTROL, release))
        assert isinstance(measured, StepMeasured)
        spent_ns = measured.spent_ns
    before = hosted.pids()
    hosted.do(EndPartition("bad"))
    hosted.start(CONTROL)
    assert hosted.demand(CONTROL) == 1.0
    assert hosted.pids()["bad"] != before["bad"]
    assert hosted.pids()["good"] == before["good"]


@on("Misbehaving")
def test_the_partition_of_a_table_that_neither_flies_nor_is_beside_any_more_ends(hosted: Hosted) -> None:
    hosted.start(CONTROL)
    assert hosted.demand(CONTROL) == 1.0
    hosted.entries[9] = replace(hosted.entries[CONTROL], index=9, partition="bad+1")
    hosted.host._devices.add(TABLE, [hosted.entries[9]], {})
    hosted.host.add([hosted.entries[9]], time.monotonic_ns())
    hosted.start(9)
    assert hosted.demand(9) == 1.0
    hosted.do(StopModule(9))
    hosted.host.keep_only({CONTROL, MONITOR, SERVO_1})
    assert "bad+1" not in hosted.pids()
    assert hosted.demand(CONTROL) == 2.0


def test_one_that_was_stopped_while_it_hangs_does_not_hold_its_partition() -> None:
    hosted = Hosted("Sleeps", good="bad")
    try:
        for module in (CONTROL, MONITOR):
            hosted.start(module)
            hosted.demand(module)
        hosted.demand(CONTROL)
        for module, release in ((CONTROL, 100), (MONITOR, 101)):
            hosted.do(StepModule(module, release, {}, time.monotonic_ns() + LONG_NS))
        hosted.do(StopModule(CONTROL))
        hosted.host.flush(time.monotonic_ns())
        events: list[ModuleEvent] = []
        end_s = time.monotonic() + PATIENCE_S
        while not events and time.monotonic() < end_s:
            assert hosted.do(MeasureStep(MONITOR, 101)) == StepMeasured(MONITOR, 101, 0)
            events = hosted.host.take([], time.monotonic_ns())
        assert events == [PartitionEnded("bad", "it hangs in a step of a module that was stopped", CONTROL)]
    finally:
        hosted.host.close()


def test_a_step_lasts_from_its_command_to_its_answer() -> None:
    process = PartitionProcess("one", 0)
    image = "live.modules_that_misbehave:Misbehaving"
    try:
        process.send(Load((image,)))
        process.flush(0)
        assert answer_of(process) == Loaded({})
        process.loading = False
        process.send(Start(CONTROL, Orders("control", image, "only", 1, device=None), ()))
        process.expect(CONTROL, 1, time.monotonic_ns())
        assert process.spent_ns(CONTROL, 1, time.monotonic_ns() + LONG_NS) == 0
        process.send(Step(CONTROL, 1, 0, LONG_NS + time.monotonic_ns(), None, []))
        process.flush(0)
        select.select([process], [], [], PATIENCE_S)
        assert process.spent_ns(CONTROL, 1, time.monotonic_ns() + LONG_NS) == 0
        assert isinstance(answer_of(process), Done)
        assert process.spent_ns(CONTROL, 1, time.monotonic_ns() + LONG_NS) > 0
    finally:
        process.kill()


def answer_of(process: PartitionProcess) -> Answer:
    select.select([process], [], [], PATIENCE_S)
    packet = process.receive()
    assert packet is not None
    return decode_answer(packet)


def test_the_module_that_computes_is_known_when_several_were_started() -> None:
    hosted = Hosted("Sleeps", good="bad")
    now_ns = time.monotonic_ns()
    try:
        for module in (MONITOR, CONTROL, SERVO_1):
            hosted.start(module)
            hosted.demand(module)
            hosted.demand(module)
        for release, module in enumerate((MONITOR, CONTROL, SERVO_1), start=100):
            hosted.do(StepModule(module, release, {}, now_ns + LONG_NS))
        assert hosted.next() == Stepped(MONITOR, 100, {"demand": 3.0}, spent_ns=ANY)
        assert hosted.do(MeasureStep(SERVO_1, 102)) == StepMeasured(SERVO_1, 102, 0)
        os.kill(hosted.pids()["bad"], signal.SIGKILL)
        assert hosted.next() == PartitionEnded("bad", "killed by SIGKILL", CONTROL)
    finally:
        hosted.host.close()


@on("Misbehaving")
def test_a_killed_partition_that_was_idle_blames_no_module(hosted: Hosted) -> None:
    hosted.misbehave()
    os.kill(hosted.pids()["bad"], signal.SIGKILL)
    assert hosted.next() == PartitionEnded("bad", "killed by SIGKILL", None)


@on("Misbehaving")
def test_a_step_whose_time_is_over_when_its_turn_comes_computes_nothing(hosted: Hosted) -> None:
    hosted.misbehave()
    hosted.do(StepModule(CONTROL, 99, {}, time.monotonic_ns() - 1))
    event = hosted.next()
    assert isinstance(event, Stepped)
    assert event.outputs == {}
    assert hosted.demand(CONTROL) == 4.0


@on("Misbehaving")
def test_what_is_stopped_before_its_partition_is_ready_never_runs(hosted: Hosted) -> None:
    hosted.start(CONTROL)
    hosted.do(StepModule(CONTROL, 1, {}, LONG_NS))
    hosted.do(StopModule(CONTROL))
    hosted.start(MONITOR)
    assert hosted.demand(MONITOR) == 1.0
    assert isinstance(hosted.step(CONTROL), StepFailed)


@on("Warm")
def test_a_module_that_is_kept_goes_on_in_its_new_mode_and_one_that_is_dropped_begins_anew(hosted: Hosted) -> None:
    hosted.start(CONTROL)
    assert [hosted.demand(CONTROL), hosted.demand(CONTROL)] == [1.0, 2.0]
    hosted.do(StopModule(CONTROL, keep=True))
    hosted.start(CONTROL, 1)
    assert hosted.demand(CONTROL) == 3.0
    hosted.do(StopModule(CONTROL))
    hosted.start(CONTROL)
    assert hosted.demand(CONTROL) == 1.0


@on("Nonexistent")
def test_code_that_is_not_there_is_reported(hosted: Hosted) -> None:
    hosted.start(CONTROL)
    missing = hosted.next()
    assert isinstance(missing, ImagesMissing)
    ((image, reason),) = missing.images.items()
    assert image == hosted.entries[CONTROL].image
    assert reason.startswith("the code cannot be imported: ")
    event = hosted.next()
    assert isinstance(event, StartFailed)
    assert "no class Nonexistent" in event.reason


@on("Misbehaving")
def test_others_are_warmed_up_when_the_pe_is_at_work(hosted: Hosted) -> None:
    hosted.start(CONTROL)
    hosted.demand(CONTROL)
    assert "bad" in hosted.pids()  # the other one may have been warmed up by now
    end_ns = time.monotonic_ns() + int(PATIENCE_S * 1e9)
    while hosted.pids().keys() != {"bad", "good"} and time.monotonic_ns() < end_ns:
        hosted.host.flush(time.monotonic_ns())
        now_ns = time.monotonic_ns()
        watched, due_ns = hosted.host.watch(now_ns)
        ready, _, _ = select.select(watched, [], [], max(0, due_ns - now_ns) / 1e9)
        assert hosted.host.take(ready, time.monotonic_ns()) == []
    assert hosted.pids().keys() == {"bad", "good"}


@on("Misbehaving")
def test_a_device_is_driven_here_and_not_there(hosted: Hosted) -> None:
    assert hosted.do(Drive(SERVO_1, 2.0)) == Driven(SERVO_1, 2.0)
    assert hosted.driver.devices["left"].commands == [2.0]


@on("Misbehaving")
def test_a_device_is_made_safe_when_its_module_stops_and_not_while_it_changes_its_mode(hosted: Hosted) -> None:
    hosted.start(SERVO_1)
    hosted.do(StopModule(SERVO_1, keep=True))
    assert hosted.driver.devices["left"].made_safe == 0
    hosted.do(StopModule(SERVO_1))
    assert hosted.driver.devices["left"].made_safe == 1


def test_every_device_is_made_safe_when_the_agent_begins_anew_and_when_it_ends() -> None:
    hosted = Hosted("Misbehaving")
    hosted.start(SERVO_1)
    hosted.host.abandon()
    assert hosted.driver.devices["left"].made_safe == 1
    hosted.start(SERVO_1)
    hosted.host.close()
    assert hosted.driver.devices["left"].made_safe == 2


@on("Misbehaving")
def test_a_partition_inherits_one_socket_and_no_secrets(
    hosted: Hosted, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("HERONRY_KEY", "very secret")
    with (tmp_path / "a key").open("w"):
        hosted.start(CONTROL)
        hosted.demand(CONTROL)
    process = Path(f"/proc/{hosted.pids()['bad']}")
    files = {number.name: str(number.readlink()) for number in (process / "fd").iterdir()}
    assert files.pop("3").startswith("socket:")
    assert files.pop("0") == os.devnull
    assert files.keys() == {"1", "2"}
    assert b"very secret" not in (process / "environ").read_bytes()


@pytest.mark.parametrize("hosted", ["WritesMuch", "PrintsMuch"], indirect=True)
def test_a_module_that_prints_much_fills_no_log_and_goes_on(hosted: Hosted, capfd: pytest.CaptureFixture[str]) -> None:
    event = hosted.misbehave()
    assert isinstance(event, Stepped), event
    assert hosted.demand(MONITOR) == 3.0
    hosted.host.close()
    said = capfd.readouterr().err
    assert len(said) < 400_000
    assert said.count("is left out of the log") == 1
    assert "\x1b" not in said
    assert "\\x1b[2J" in said


def gone(group: int) -> bool:
    """Wait until no process of a process group lives."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        states = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            with suppress(OSError):
                state, _, member_of = stat.read_text(errors="replace").rpartition(") ")[2].split()[:3]
                states += [state] if int(member_of) == group else []
        if set(states) <= {"Z"}:
            return True
        time.sleep(0.05)
    return False


@on("Multiplies")
def test_a_program_that_a_module_has_started_ends_with_the_partition(hosted: Hosted) -> None:
    hosted.start(CONTROL)
    group = hosted.pids()["bad"]
    assert hosted.misbehave() == PartitionEnded("bad", "exit code 3", CONTROL)
    assert gone(group)


@on("Forks")
def test_what_a_module_has_forked_dies_with_its_partition_without_the_agent(hosted: Hosted) -> None:
    event = hosted.misbehave()
    assert isinstance(event, Stepped), event
    group = hosted.pids()["bad"]
    os.kill(group, signal.SIGKILL)  # as the kernel does when the agent is killed
    assert gone(group)
