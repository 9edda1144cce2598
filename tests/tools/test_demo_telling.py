"""In which order a demo tells its events, what it gathers, and what it waits for at its end."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.situation import situation
from heronry_manager.events import (
    EpochAbandoned,
    FaultReported,
    ModuleFailed,
    PeJoined,
    PeLost,
    Process,
    Reconfigured,
    Times,
    Waited,
)
from heronry_manager.planner.exact import plan
from heronry_manager.shell.ordered_telling import OrderedTelling
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError
from heronry_tools.reports.story import Story
from heronry_tools.runtime.demo import play
from heronry_tools.runtime.demo.cut_off import gateways_lost
from heronry_tools.runtime.demo.fleet import Fleet
from heronry_tools.runtime.demo.held_outages import TELL_AGAIN_NS, HeldOutages
from heronry_tools.runtime.demo.planning_ahead import PlanningAhead
from heronry_tools.runtime.demo.processor_waits import ProcessorWaits, Wait
from heronry_tools.runtime.demo.run import GRACE_S, Show
from heronry_tools.runtime.witness import Outage, Witness
from heronry_wire.standstill import LatenessMeter

MS = 1_000_000
ELEVATOR = load(Path("dg_specs/elevator_and_chute.dg.yaml"))


def names(told: list[Any]) -> list[str]:
    return [one.kind for one in told]


def test_events_are_told_in_the_order_of_their_times_once_they_were_held() -> None:
    told: list[Any] = []
    telling = OrderedTelling(told.append)
    telling.take(PeJoined(30, pe="b", cause=""))
    telling.take(Process(10, pe="a", pid=1, what="killed"))
    telling.tell_until(20)
    assert names(told) == ["process"]
    telling.take(PeLost(25, pe="a", cause="", last_heard_ns=1))
    telling.tell_until()
    assert names(told) == ["process", "pe_lost", "pe_joined"]


def test_events_of_one_time_keep_their_order() -> None:
    told: list[Any] = []
    telling = OrderedTelling(told.append)
    for epoch in range(5):
        telling.take(EpochAbandoned(7, epoch=epoch, reason=""))
    telling.tell_until()
    assert [one.epoch for one in told] == [0, 1, 2, 3, 4]


class _SlowToKill:
    """A fleet in which the end of a process takes some time."""

    def __init__(self) -> None:
        self.killed_ns = 0

    def kill_pe(self, _pe: str) -> int:
        self.killed_ns = time.monotonic_ns()
        return 7


def test_a_kill_stands_before_its_consequence_however_long_the_process_takes_to_end() -> None:
    told: list[Any] = []
    fleet = _SlowToKill()
    show = Show(ELEVATOR, cast("Fleet", fleet), {}, told.append)
    assert show._do("kill", "tail_pe") == "pe:tail_pe is killed (process 7)"
    show._follow(PeLost(fleet.killed_ns, pe="tail_pe", cause="", last_heard_ns=1))
    show._telling.tell_until()
    assert names(told) == ["process", "pe_lost"]


class _Running:
    """A fleet whose processes run."""

    def processes(self) -> dict[str, int]:
        return {"pe:tail_pe": 11, "pe:nav": 12, "manager 126": 13}

    def kill_pe(self, _pe: str) -> int:
        return 11


def test_the_loss_of_a_pe_whose_process_runs_says_in_the_same_breath_what_that_process_waited_for(
    tmp_path: Path,
) -> None:
    told: list[Any] = []
    show = Show(ELEVATOR, cast("Fleet", _Running()), {}, told.append)
    show._waits = ProcessorWaits(1000 * MS, tmp_path)
    lost = PeLost(5, pe="tail_pe", cause="silent", last_heard_ns=1)
    for at_ms, waits_ms in ((0, (0, 0, 7)), (500, (1, 0, 7)), (1000, (141, 900, 27))):
        for number, waited_ms in zip((11, 12, 13), waits_ms, strict=True):
            (tmp_path / str(number)).mkdir(exist_ok=True)
            (tmp_path / str(number) / "schedstat").write_text(f"5 {waited_ms * MS} 3\n")
        show._waits.look(at_ms * MS, _Running().processes())
    show._waits._samples.pop()  # the last wait has just ended
    show._follow(lost)
    show._telling.tell_until()
    assert (told[0].waited.who, told[0].waited.for_ns) == ("pe:tail_pe", 141 * MS)


def test_a_function_that_was_never_heard_is_told_with_what_the_processes_of_its_pes_waited_for(tmp_path: Path) -> None:
    told: list[Any] = []
    show = Show(ELEVATOR, cast("Fleet", _Running()), {}, told.append)
    show._seconds, show._plan = 1.0, plan(ELEVATOR, situation(ELEVATOR)).told()
    show._waits = ProcessorWaits(1000 * MS, tmp_path)
    for at_ms, waits_ms in ((0, (0, 0, 0)), (1000, (700, 900, 27))):
        for number, waited_ms in zip((11, 12, 13), waits_ms, strict=True):
            (tmp_path / str(number)).mkdir(exist_ok=True)
            (tmp_path / str(number) / "schedstat").write_text(f"5 {waited_ms * MS} 3\n")
        show._waits.look(at_ms * MS, _Running().processes())
    assert show._summary() == 1
    show._telling.tell_until()
    waited = {name: (one.who, one.for_ns // MS) for name, one in told[-1].waited.items()}
    at_the_tail = ("pe:tail_pe", 700)
    assert waited.pop("parachute") == ("manager 126", 27)  # its PE has not waited
    assert waited == {"elevator": at_the_tail, "servo_monitoring": at_the_tail}


def test_a_loss_after_a_kill_is_its_consequence_and_one_before_it_is_not_however_late_the_demo_reads_it() -> None:
    told: list[Any] = []
    show = Show(ELEVATOR, cast("Fleet", _Running()), {}, told.append)
    before_ns = time.monotonic_ns()
    show._do("kill", "tail_pe")
    after_ns = time.monotonic_ns()
    show._follow(PeJoined(before_ns, pe="tail_pe", cause=""))  # read late: it does not end the kill
    for at_ns in (before_ns, after_ns):
        show._follow(PeLost(at_ns, pe="tail_pe", cause="silent", last_heard_ns=1))
    show._coming_back.add("tail_pe")  # it is restored
    show._follow(PeJoined(after_ns + 1, pe="tail_pe", cause=""))
    show._follow(PeLost(after_ns + 2, pe="tail_pe", cause="silent", last_heard_ns=1))
    show._telling.tell_until()
    assert [one.waited is not None for one in told if isinstance(one, PeLost)] == [True, False, True]


@pytest.mark.parametrize(
    ("who", "for_ns", "words"),
    [
        ("manager 126", 20 * MS, "the process of manager 126 has waited 20 of the last 1000 ms for a processor"),
        ("pe:nav", 5 * MS, "its process runs: it has waited 5 of the last 1000 ms for a processor, which may be the"),
        ("pe:nav", 4 * MS, "its process runs: this computer may have kept it from working"),
    ],
)
def test_a_lost_pe_whose_process_runs_is_never_told_alone(who: str, for_ns: int, words: str) -> None:
    waited = Waited(who, for_ns, 1000 * MS)
    lost = PeLost(5, pe="nav", cause="silent", last_heard_ns=1, waited=waited)
    assert words in Story(ELEVATOR).tell(lost)[1].text


def test_waits_of_processes_that_have_ended_count_nothing(tmp_path: Path) -> None:
    waits = ProcessorWaits(1000 * MS, tmp_path)
    assert waits.longest(0, "nav", {"pe:nav": 5}) == Wait("pe:nav", 0, 0)
    waits.look(0, {"pe:nav": 5})
    waits.look(10 * MS, {"pe:tail_pe": 6})  # too soon
    assert waits.longest(20, "nav", {"pe:nav": 5, "pe:tail_pe": 6}) == Wait("pe:nav", 0, 20)


def test_the_reason_of_a_failure_stands_before_the_epoch_to_which_it_led() -> None:
    told: list[Any] = []
    show = Show(ELEVATOR, cast("Fleet", None), {}, told.append)
    show._follow(FaultReported(50, element="module:m", by="a", detail=0, code="MODULE_MISSING"))
    show._follow(Reconfigured(60, 2, (), Times(1, 1, 1, 1), (), (), ()))
    show._follow(ModuleFailed(90, element="module:m", by="a", text="why", heard_ns=50))
    show._telling.tell_until()
    assert names(told) == ["fault_reported", "module_failed", "reconfigured"]


class Heard:
    """A witness of outages that the test names."""

    def __init__(self, outages: list[Outage]) -> None:
        self._outages = outages

    def outages(self, _now_ns: int) -> list[Outage]:
        return self._outages

    def served(self, function: str, _now_ns: int) -> bool:
        return function != "elevator"


def show_with(told: list[Any], *outages: Outage) -> Show:
    show = Show(ELEVATOR, cast("Fleet", None), {}, told.append)
    show._witness = cast("Any", Heard([*outages]))
    show._start_ns = 0
    return show


@pytest.mark.parametrize(("count", "lines"), [(3, 3), (4, 1), (60, 1)])
def test_many_outages_that_end_together_are_one_line_and_each_is_an_event(count: int, lines: int) -> None:
    told: list[Any] = []
    show = show_with(told, *(Outage("elevator", n * MS, 500 * MS) for n in range(count)))
    show._look()
    show._look()
    show._telling.tell_until()
    assert names(told).count("outage") == count
    story = story_of_elevator()
    assert len([line for one in told for line in story.tell(one)]) == lines


def test_after_the_first_outages_what_follows_within_a_second_is_one_line_with_a_count() -> None:
    held = HeldOutages(are_over=True)
    told = []
    for at_ms in range(0, 1900, 100):  # a function that the busy computer makes silent ten times in a second
        held.take([Outage("elevator", at_ms * MS, (at_ms + 90) * MS), Outage("mission", at_ms * MS, None)])
        told.append(len(held.due(at_ms * MS)))
    assert told == [1, *[0] * 9, 10, *[0] * 8]
    assert len(held.all()) == 8
    events: list[Any] = []
    show = show_with(events, *(Outage("elevator", n * MS, 500 * MS) for n in range(5)))
    show._look()
    show._telling.tell_until()
    lines = [line.text for one in events for line in story_of_elevator().tell(one)]
    assert lines == ["[ start  ] elevator is heard again on the bus (5 times), after 496 to 500 ms of silence"]


def test_a_silence_that_has_ended_while_it_was_held_is_not_told_as_one_that_lasts() -> None:
    held = HeldOutages(are_over=False)
    held.take([Outage("elevator", 0, None)])
    assert len(held.due(0)) == 1
    held.take([Outage("elevator", 10, None), Outage("parachute", 10, None)])
    held.take([Outage("elevator", 10, 20)])
    assert [one.function for one in held.due(TELL_AGAIN_NS)] == ["parachute"]


def story_of_elevator() -> Story:
    story = Story(ELEVATOR)
    story._plan = plan(ELEVATOR, situation(ELEVATOR)).told()
    return story


def test_the_demo_says_once_what_it_waits_for_when_its_time_is_up() -> None:
    told: list[Any] = []
    show = show_with(told)
    show._pending = "epoch 4"
    show._coming_back = {"tail_pe"}
    show._plan = plan(ELEVATOR, situation(ELEVATOR)).told()
    show._seconds = show._show_s() - 1.0
    assert not show._over()
    assert not show._over()
    show._telling.tell_until()
    (one,) = told
    assert one.awaited == ("tail_pe to join", "epoch 4 to be complete", "elevator to be heard")
    show._seconds = show._show_s() - GRACE_S - 1.0
    assert show._over()
    show._page = cast("Any", SimpleNamespace(is_served=False))
    assert show._awaited()[3:] == ["the page to be served"]
    show._page.is_served = True
    assert show._awaited()[3:] == []


def test_a_demo_for_no_time_ends_with_its_first_configuration_and_misses_no_output() -> None:
    told: list[Any] = []
    show = show_with(told)
    show._plan = plan(ELEVATOR, situation(ELEVATOR)).told()
    show._pending = None
    assert show._over()  # though nothing was heard yet
    show._witness = Witness(ELEVATOR)
    assert show._summary() == 0
    show._telling.tell_until()
    assert (told[-1].unserved, told[-1].never) == ((), ())


def test_without_a_kill_nothing_is_killed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "elevator_and_chute", "--no-kill", "--kill", "pe:tail_pe@1"]) == 2
    assert "--no-kill flies without a kill" in capsys.readouterr().err


def test_plans_that_a_busy_computer_had_no_time_for_are_not_promised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("heronry_tools.runtime.demo.planning_ahead.subprocess.Popen", _Hung)
    behind = PlanningAhead(ELEVATOR, Path("none"))
    behind.start()
    assert str(behind.close()).endswith(
        "none of them in this demo, which was too short for that on this computer: a longer one (--for 60) makes them"
    )


def test_the_demo_says_once_when_the_plans_for_its_successor_are_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("heronry_tools.runtime.demo.planning_ahead.subprocess.Popen", _Ended)
    told: list[Any] = []
    show = show_with(told)
    show._behind = PlanningAhead(ELEVATOR, Path("none"))
    show._behind.start()
    show._look()
    show._look()
    show._telling.tell_until()
    sentence = "the 25 plans for every single fault are complete: the next demo uses them"
    assert [one.sentence for one in told] == [sentence]


def test_the_demo_tells_standstills_of_its_own_process() -> None:
    told: list[Any] = []
    show = Show(ELEVATOR, cast("Fleet", None), {}, told.append)
    period_ns = ELEVATOR.buses[ELEVATOR.manager.bus].heartbeat_ns
    meter = LatenessMeter(period_ns, 0, time.thread_time_ns())
    for _ in range(3):  # each wait was over long ago
        meter.waits(time.monotonic_ns() - 7 * period_ns)
        show._measure_lateness(meter)
    show._telling.tell_until()
    assert show._standstills.long_times == 3
    assert {one.by for one in told} == {"the demo"}
    assert told[0].for_ns >= 6 * period_ns


class _Fleet:
    """A fleet that cannot be started; it keeps what it was to fly with."""

    heartbeat_ns = 0
    spec = ELEVATOR

    def __init__(self, spec: Spec, *_: Any, heartbeat_ns: int, **__: Any) -> None:
        _Fleet.spec, _Fleet.heartbeat_ns = spec, heartbeat_ns
        raise UserError("no fleet today")


@pytest.mark.parametrize(("late_ms", "period_ms", "flown_ms"), [(1, 20, 20), (61, 160, 160)])
def test_the_demo_flies_with_a_heartbeat_that_this_computer_can_keep(
    late_ms: int, period_ms: int, flown_ms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(play, "latest_wake_up_ns", lambda *_: late_ms * MS)
    monkeypatch.setattr(play, "Fleet", _Fleet)
    assert main(["demo", "elevator_and_chute", "--contingencies", "none"]) == 2
    assert _Fleet.heartbeat_ns == period_ms * MS
    assert _Fleet.spec.buses[ELEVATOR.manager.bus].heartbeat_ns == flown_ms * MS


@pytest.mark.parametrize(
    ("flags", "period_ms", "beside"), [(["--heartbeat", "50"], 50, None), (["--web"], 160, 2), ([], 160, 0)]
)
def test_a_heartbeat_is_given_or_rehearsed_with_the_load_of_the_page(
    flags: list[str], period_ms: int, beside: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    rehearsed: list[int] = []
    monkeypatch.setattr(play, "latest_wake_up_ns", lambda *given: rehearsed.append(given[3]) or 61 * MS)
    monkeypatch.setattr(play, "Fleet", _Fleet)
    assert main(["demo", "elevator_and_chute", "--contingencies", "none", *flags]) == 2
    assert _Fleet.heartbeat_ns == period_ms * MS
    assert rehearsed == ([] if beside is None else [beside])


def test_a_heartbeat_that_no_demo_can_have_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "elevator_and_chute", "--contingencies", "none", "--heartbeat", "5"]) == 2
    assert "the spec has 20 ms, which a demo can only lengthen" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["demo", "elevator_and_chute", "--heartbeat", "0"])
    assert "0 is not a heartbeat period" in capsys.readouterr().err


def test_a_pe_is_lost_because_its_only_gateway_was_killed() -> None:
    spec = load(Path("dg_specs/big_blue.dg.yaml"))
    (gateway,) = (one.name for one in spec.pes.values() if {spec.manager.bus, "radio"} <= set(one.buses))
    (beyond,) = (one.name for one in spec.pes.values() if spec.manager.bus not in one.buses)
    other = next(one.name for one in spec.pes.values() if one.name not in (gateway, beyond))
    assert gateways_lost(spec, beyond, [other, gateway]) == [gateway]
    assert gateways_lost(spec, beyond, [other]) == []
    assert gateways_lost(spec, other, [gateway]) == []
    told: list[Any] = []
    show = Show(spec, cast("Fleet", None), {}, told.append)
    show._down_since_ns = {gateway: 1}
    lost = PeLost(5, pe=beyond, cause="silent for 4 heartbeat periods", last_heard_ns=1)
    noted = cast("PeLost", show._noted(lost))
    assert noted.waited is None
    assert noted.cause.endswith(f"; its only way to the manager led over pe:{gateway}, now killed")


class _Hung:
    """A process that never comes to its first plan."""

    def __init__(self, *_: Any, **__: Any) -> None:
        pass

    def poll(self) -> None:
        return None

    def kill(self) -> None:
        pass

    def communicate(self) -> None:
        pass


class _Ended(_Hung):
    """A process that has made all plans."""

    returncode = 0

    def poll(self) -> int:  # type: ignore[override]
        return 0

    def communicate(self) -> tuple[bytes, None]:  # type: ignore[override]
        return b"", None
