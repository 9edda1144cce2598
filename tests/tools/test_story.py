"""The story of a flight, word for word; the script's arguments, the buses, the screen."""

import itertools
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_dg.plan import Plan
from heronry_dg.situation import situation
from heronry_manager.events import (
    Adopted,
    Advice,
    ControlPaths,
    EpochAbandoned,
    EpochPrepared,
    EpochStep,
    Event,
    FaultCleared,
    Heartbeat,
    Logs,
    ManagerStarted,
    ModuleFailed,
    Outage,
    Outages,
    OutputsHeld,
    Overtime,
    PeHeardAgain,
    PeJoined,
    PeLost,
    PeSuspected,
    PhaseChanged,
    PlanReady,
    PlanUnchanged,
    Process,
    Reconfigured,
    StoodStill,
    Summary,
    TakenOver,
    Times,
    UnknownEpoch,
    Waited,
)
from heronry_manager.planner.exact import plan
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError
from heronry_tools.reports.plain_lines import Line, plain_line
from heronry_tools.reports.screen import screen
from heronry_tools.reports.story import Story
from heronry_tools.runtime.demo.buses import BusChoice, choose, has_interface
from heronry_tools.runtime.demo.script import DemoAction, default_actions, read_script
from heronry_tools.sim.faults.drawing import drawn_faults
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.outcome import KEY
from heronry_tools.sim.flight.simulation import Simulation
from heronry_wire.bus_arguments import BusArgumentError
from scenarios.flights import twin_wires
from thoroughness import part_of

MS = 1_000_000
ELEVATOR = load(Path("dg_specs/elevator_and_chute.dg.yaml"))
BIG_BLUE = load(Path("dg_specs/big_blue.dg.yaml"))
TIMES = Times(detect=61 * MS, decide=40 * MS, distribute=9 * MS, activate=5 * MS)


def plan_after(before: Plan | None, *down: str) -> Plan:
    modules = before.configuration.modules if before is not None else {}
    return plan(ELEVATOR, situation(ELEVATOR, down), {name: (r.mode, r.pe) for name, r in modules.items()} or None)


def reconfiguration(now_ms: int, epoch: int, made: Plan, *causes: str) -> list[Event]:
    """A plan on its way to running."""
    return [
        PlanReady(now_ms * MS, request=epoch, plan=made.told(), decide_ns=1),
        EpochPrepared(now_ms * MS, epoch=epoch, digest="0000AB", contingency=0, pes=(), bytes=1),
        EpochStep(now_ms * MS, epoch=epoch, step="GO_ALL", waiting_for=()),
        Reconfigured(
            now_ms * MS,
            epoch=epoch,
            causes=causes,
            times_ns=TIMES,
            moved=(),
            started=(),
            stopped=(),
        ),
    ]


def flight() -> Iterator[Event]:
    """The tail's PE is killed, and comes back."""
    whole = plan_after(None)
    yield ManagerStarted(
        0,
        spec=ELEVATOR.name,
        spec_digest=ELEVATOR.digest,
        node=126,
        term=1,
        bus="can0",
        phase=None,
        advises=False,
        key="0badcafe",
    )
    yield Process(1, pe="tail_pe", pid=41, what="started")
    yield PeJoined(2, pe="tail_pe", cause="first heard")
    yield from reconfiguration(1000, 1, whole, "pe:control_pe joined", "pe:tail_pe joined")
    yield Process(3000 * MS, pe="tail_pe", pid=41, what="killed")
    yield PeSuspected(3030 * MS, pe="tail_pe", cause="silent", silent_ns=25 * MS)
    yield PeLost(3061 * MS, pe="tail_pe", cause="silent for 3 periods", last_heard_ns=3000 * MS)
    without = plan_after(whole, "pe:tail_pe")
    yield from reconfiguration(3115, 2, without, "pe:tail_pe: silent for 3 periods")
    yield Process(5000 * MS, pe="tail_pe", pid=42, what="restored")
    yield PeHeardAgain(5100 * MS, pe="tail_pe", cause="a hold-down begins")
    yield PeJoined(5300 * MS, pe="tail_pe", cause="steady for 100 ms")
    yield from reconfiguration(5400, 3, plan_after(without), "pe:tail_pe joined")
    yield Outage(5450 * MS, function="elevator", from_ns=2990 * MS, to_ns=5440 * MS, gathered=False)
    yield Summary(
        6000 * MS, served=tuple(ELEVATOR.functions), unserved=(), never=(), waited={}, rivals=(), pending=None
    )


STORY = """\
[ start  ] manager 126 on can0, term 1; waiting for the PEs
[  0.00 s] epoch 1 runs: 11 modules, 3 of 3 wanted functions served (pe:control_pe joined, and 1 more)
           detect 61.0 ms  decide 40.0 ms  distribute 9.0 ms  activate 5.0 ms
             sensor_pe   54 % CPU  gps_driver, pressure_driver, high_quality_altitude:fused
             control_pe   8 % CPU  release_driver, chute_logic, chute_driver
             tail_pe    100 % CPU  state_estimator, elevator_control, servo_driver_1, angle_driver, servo_monitor
[  2.00 s] KILL tail_pe (SIGKILL, process 41); it ran \
state_estimator, elevator_control, servo_driver_1, angle_driver, servo_monitor
[  2.06 s] tail_pe is lost: missed a heartbeat, was sent PINGs, silent for 3 periods
[  2.12 s] epoch 2 runs: 6 modules, 1 of 3 wanted functions served (pe:tail_pe: silent for 3 periods)
           detect 61.0 ms  decide 40.0 ms  distribute 9.0 ms  activate 5.0 ms
             - angle_driver stops (was tail_pe)
             - elevator_control stops (was tail_pe)
             - servo_driver_1 stops (was tail_pe)
             - servo_monitor stops (was tail_pe)
             - state_estimator stops (was tail_pe)
             elevator is no longer served: servo_driver_1 needs device elevator_servo_1 on tail_pe, which is down, \
and servo_driver_2 needs device elevator_servo_2 on tail_pe, which is down
             servo_monitoring is no longer served: servo_monitor needs elevator_angle from angle_driver, which needs \
device elevator_angle_sensor on tail_pe, which is down
[  4.00 s] RESTORE tail_pe (process 42)
[  4.10 s] tail_pe is heard again; a hold-down begins
[  4.30 s] tail_pe joins: steady for 100 ms
[  4.40 s] epoch 3 runs: 11 modules, 3 of 3 wanted functions served (pe:tail_pe joined)
           detect 61.0 ms  decide 40.0 ms  distribute 9.0 ms  activate 5.0 ms
             + angle_driver starts on tail_pe
             + elevator_control starts on tail_pe
             + servo_driver_1 starts on tail_pe
             + servo_monitor starts on tail_pe
             + state_estimator starts on tail_pe
             elevator is served again (only, value 100)
             servo_monitoring is served again (only, value 100)
[  4.45 s] elevator (class A) is heard again on the bus, after 2450 ms of silence
[  5.00 s] heard on the bus at the end: elevator, parachute, servo_monitoring
"""


def told(story: Story, events: list[Event]) -> list[Line]:
    return [line for one in events for line in story.tell(one)]


def test_a_kill_and_a_return_word_for_word() -> None:
    assert "".join(line.text + "\n" for line in told(Story(ELEVATOR), list(flight()))) == STORY


def test_a_function_that_was_never_wanted_ends_with_its_module_and_not_with_the_phase(tmp_path: Path) -> None:
    """Without `only_in` the experiment's module runs on the ground for the guidance; the loss of the ground ends it."""
    file = tmp_path / "always_open.dg.yaml"
    file.write_text(re.sub(r", only_in: \[[a-z, ]*\]", "", Path("dg_specs/big_blue.dg.yaml").read_text()))
    spec = load(file)
    whole, without = (plan(spec, situation(spec, down)) for down in ((), ("pe:ground",)))
    events = [*reconfiguration(0, 1, whole, "all joined"), *reconfiguration(9, 2, without, "pe:ground: silent")]
    (line,) = (line for line in told(Story(spec), events) if "experiment is" in line.text)
    assert line.text.strip() == (
        "experiment is no longer served: experimental_autopilot, which ran on ground because other modules used its "
        "data, has ended; phase ascent does not want experiment for itself"
    )
    assert line.tone == "plain"


def test_a_function_that_another_phase_does_not_want_ends_with_the_phase() -> None:
    glide, landing = (plan(BIG_BLUE, situation(BIG_BLUE, phase=phase)) for phase in ("glide", "landing"))
    events = [*reconfiguration(0, 1, glide, "all joined"), *reconfiguration(9, 2, landing, "phase landing")]
    lines = [line.text.strip() for line in told(Story(BIG_BLUE), events)]
    assert "experiment is no longer served: it is not wanted in phase landing" in lines


def test_a_control_loop_is_told_when_it_opens_and_when_it_closes() -> None:
    states = ["on_path", "open", "open", "unseen", "unmoved", "on_path", "on_path"]
    story, loop = Story(ELEVATOR), "the control loop through pitch is"
    events = [ControlPaths(MS, epoch=1 + n, plants={"pitch": state}) for n, state in enumerate(states)]
    assert [(line.text.partition("] ")[2], line.tone) for line in told(story, events)] == [
        (
            f"{loop} open: nothing leads from a sensor that sees it to an actuator that moves it",
            "bad",
        ),
        (f"{loop} open: no module runs on a sensor that sees it", "bad"),
        (f"{loop} open: no module runs on an actuator that moves it", "bad"),
        (f"{loop} closed again", "good"),
    ]


def test_a_loss_is_a_fault_what_it_costs_is_bad_and_the_return_is_good() -> None:
    tones = {line.text.strip().partition("] ")[2] or line.text.strip(): line.tone for line in told_flight()}
    assert tones["tail_pe is lost: missed a heartbeat, was sent PINGs, silent for 3 periods"] == "fault"
    assert next(tone for text, tone in tones.items() if text.startswith("elevator is no longer served")) == "bad"
    assert tones["elevator is served again (only, value 100)"] == "good"
    assert tones["+ servo_monitor starts on tail_pe"] == "quiet"


def told_flight() -> list[Line]:
    return told(Story(ELEVATOR), list(flight()))


def test_a_better_or_worse_mode_and_a_move_are_shown_with_both_ends() -> None:
    whole = plan_after(None)
    story = Story(ELEVATOR)
    told(story, reconfiguration(0, 1, whole, "start"))
    blind = plan_after(whole, "device:gps")
    lines = [line.text.strip() for line in told(story, reconfiguration(10, 2, blind, "device:gps failed"))]
    assert "- high_quality_altitude stops (was sensor_pe (fused))" in lines
    assert "+ low_quality_altitude starts on sensor_pe" in lines
    assert f"worth of the data used: {whole.objective.inputs} -> {blind.objective.inputs} points" in lines
    told(story, reconfiguration(20, 3, whole, "device:gps repaired"))
    half = plan_after(whole, "device:barometer")
    text = "\n".join(line.text for line in told(story, reconfiguration(30, 4, half, "device:barometer failed")))
    assert re.search(r"> high_quality_altitude goes from sensor_pe \(fused\) to \w+ \(gps_only\)", text)


def test_a_function_in_a_lesser_mode_is_shown_with_its_value() -> None:
    spec, story = BIG_BLUE, Story(BIG_BLUE)
    now = situation(spec, phase="glide")
    whole = plan(spec, now, None)
    without_gps = plan(spec, situation(spec, ["device:gps"], phase="glide"), None)
    told(story, reconfiguration(0, 1, whole, "start"))
    worse = told(story, reconfiguration(1, 2, without_gps, "device:gps failed"))
    better = told(story, reconfiguration(2, 3, whole, "device:gps repaired"))
    assert ("guidance: mode route -> level, value 100 -> 30", "bad") in [(w.text.strip(), w.tone) for w in worse]
    assert ("guidance: mode level -> route, value 30 -> 100", "good") in [(b.text.strip(), b.tone) for b in better]


def test_the_story_tells_the_plan_of_the_epoch_that_runs_not_one_that_is_still_to_come() -> None:
    whole, without = plan_after(None), plan_after(None, "pe:tail_pe")
    early, late = reconfiguration(10, 1, whole, "start"), reconfiguration(20, 2, without, "pe:tail_pe lost")
    story = Story(ELEVATOR)
    lines = told(story, [*early[:3], *late[:2], early[3]])  # the first epoch ends while the second is being prepared
    assert "epoch 1 runs: 11 modules, 3 of 3" in lines[0].text
    lines = told(story, late[2:])
    assert "epoch 2 runs: 6 modules, 1 of 3" in lines[0].text
    assert any("servo_driver_1 stops" in line.text for line in lines)


def test_standstills_in_a_row_are_one_line_until_a_pe_is_lost() -> None:
    story = Story(ELEVATOR)

    def stood(at_ms: int, for_ms: int, by: str = "nav") -> int:
        return len(story.tell(StoodStill(at_ms * MS, by=by, for_ns=for_ms * MS, times=1)))

    assert [stood(0, 30), stood(100, 25), stood(200, 31), stood(300, 31), stood(300, 22, "tail_pe")] == [1, 0, 1, 0, 1]
    story.tell(PeLost(400 * MS, pe="nav", cause="silent", last_heard_ns=0))
    assert [stood(410, 22), stood(500, 22), stood(2410, 22)] == [1, 0, 1]


def test_a_standstill_that_a_pe_reports_afterwards_names_the_loss_that_it_may_explain_and_no_older_one() -> None:
    story = Story(ELEVATOR)
    lost = PeLost(400 * MS, pe="nav", cause="silent", last_heard_ns=0)
    stood = StoodStill(900 * MS, by="nav", for_ns=300 * MS, times=1)
    words = "the computer of nav stood still for 300 ms (once so far)"
    story.tell(lost)
    assert story.tell(stood)[0].text == f"[ start  ] {words}, which may be why nav was lost"
    story._start_ns = 100 * MS
    story.tell(lost)
    assert story.tell(stood)[0].text == f"[  0.80 s] {words}, which may be why nav was lost at 0.30 s"
    story.tell(lost)
    story.tell(PeJoined(1100 * MS, pe="nav", cause="heard again"))
    assert story.tell(stood)[0].text == f"[  0.80 s] {words}"


def test_an_epoch_that_was_given_up_is_told_with_the_one_that_runs_as_none_was_announced() -> None:
    given_up = reconfiguration(10, 1, plan_after(None), "start")
    story = Story(ELEVATOR)
    assert told(story, [*given_up[:2], EpochAbandoned(11, epoch=1, reason="a PE was lost")]) == []
    lines = [line.text.strip() for line in told(story, reconfiguration(20, 2, plan_after(None), "start"))]
    assert lines[0].startswith("[  0.00 s] epoch 2 runs")
    assert lines[2] == "given up before it ran: epoch 1 (a PE was lost)"
    for epoch in range(3, 9):
        told(story, [EpochAbandoned(21, epoch=epoch, reason="x")])
    lines = [line.text.strip() for line in told(story, reconfiguration(30, 9, plan_after(None), "start"))]
    assert lines[2] == "given up before it ran: epochs 3 (x), 4 (x), 5 (x), 6 (x), 7 (x) and 1 more"


def test_waiting_silence_and_failures_are_shown() -> None:
    story = Story(ELEVATOR)
    told(story, reconfiguration(0, 1, plan_after(None, "pe:tail_pe"), "start"))
    events = [
        EpochStep(10 * MS, epoch=2, step="GO", waiting_for=()),
        Outage(1500 * MS, function="parachute", from_ns=300 * MS, to_ns=None, gathered=False),
        Outage(
            1500 * MS, function="elevator", from_ns=300 * MS, to_ns=None, gathered=False
        ),  # and the plan does not have it
        Process(1600 * MS, pe="tail_pe", pid=9, what="killed"),
        Summary(
            2000 * MS,
            served=(),
            unserved=("parachute",),
            never=("parachute",),
            waited={"parachute": Waited("pe:control_pe", 99 * MS, 1000 * MS)},
            rivals=("servo_driver_1 and servo_driver_2",),
            pending="epoch 3",
        ),
    ]
    texts = [line.text.strip() for line in told(story, events)]
    assert texts[:3] == [
        "[  0.01 s] a DEMUX waits until a silent PE has certainly stopped driving it",
        "[  1.50 s] parachute (class B) has not been heard for 1200 ms",
        "[  1.60 s] KILL tail_pe (SIGKILL, process 9); it ran nothing",
    ]
    assert texts[3:5] == ["[  2.00 s] heard on the bus at the end: nothing", "planned, but not heard: parachute"]
    assert texts[5] == (
        "parachute was never heard: chute_driver on control_pe drove nothing; a step of such a module has to command "
        "its device: ctx.write(value)"
    )
    assert texts[6] == "still under way: epoch 3"
    assert texts[7].startswith("not served: elevator: servo_driver_1 needs device elevator_servo_1")
    assert texts[-1] == "two drivers at once: servo_driver_1 and servo_driver_2"


@pytest.mark.parametrize(
    ("waited_ms", "stood_still_ms", "reason"),
    [
        (99, 0, ""),
        (850, 200, " the process of pe:control_pe has waited 850 of the last 1000 ms for a processor,"),
        (99, 200, " this computer stood still for 200 ms,"),
        (99, 60, ""),
    ],
)
def test_a_function_that_was_never_heard_on_a_busy_computer_may_be_its_doing(
    waited_ms: int, stood_still_ms: int, reason: str
) -> None:
    waited = Waited("pe:control_pe", waited_ms * MS, 1000 * MS)
    over = {"served": [], "unserved": ["parachute"], "never": ["parachute"], "rivals": [], "pending": None}
    events = [
        *reconfiguration(0, 1, plan_after(None), "all joined"),
        StoodStill(500 * MS, by="the demo", for_ns=stood_still_ms * MS, times=1),
        Summary(1000 * MS, **over, waited={"parachute": waited}),
    ]
    told_reason = f"{reason} which may be the cause; if not," if reason else ""
    assert told(Story(ELEVATOR), events)[-1].text.strip() == (
        f"parachute was never heard: chute_driver on control_pe drove nothing;{told_reason} "
        "a step of such a module has to command its device: ctx.write(value)"
    )


def test_a_phase_a_cleared_fault_what_is_adopted_and_what_is_advised_are_shown() -> None:
    whole = plan_after(None)
    events = [
        PlanReady(1, request=1, plan=whole.told(), decide_ns=0),
        Adopted(1, epoch=7, digest="0000AB"),
        PlanUnchanged(1, request=1),
        PhaseChanged(2, phase="land", before="climb", by="tail_pe"),
        FaultCleared(3, element="device:gps", by="the operator"),
        Advice(4, plan=whole.told(), moved=("a",), started=("b", "c"), stopped=()),
        Advice(5, plan=whole.told(), moved=(), started=(), stopped=()),
        UnknownEpoch(6, epoch=8),
        Process(10_000_001, pe="tail_pe", pid=41, what="killed"),
    ]
    lines = [line.text.removeprefix("[  0.00 s] ") for line in told(Story(ELEVATOR), events)]
    assert lines[:-1] == [
        "epoch 7 runs already: the manager adopts it as it is",
        "PHASE land (was climb), requested by tail_pe",
        "device:gps counts as working again, cleared by the operator",
        "this manager would start b, c; move a",
        "this manager would only change modes and wires",
        "this manager does not know the running epoch 8, and gives no advice",
    ]
    assert lines[-1].startswith("[  0.01 s] KILL tail_pe")
    assert "it ran state_estimator" in lines[-1]


@pytest.mark.parametrize(
    "first", [UnknownEpoch(2, 8), Advice(2, plan_after(None).told(), moved=(), started=("a",), stopped=())]
)
def test_the_clock_of_an_advising_manager_starts_with_its_first_advice(first: Event) -> None:
    cleared = {"element": "device:gps", "by": "the operator"}
    events = [
        FaultCleared(1, **cleared),
        first,
        FaultCleared(10_000_002, **cleared),
    ]
    stamps = [line.text[:11] for line in told(Story(ELEVATOR), events)]
    assert stamps == ["[ start  ] ", "[  0.00 s] ", "[  0.01 s] "]


# The computer on which it runs


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        (
            StoodStill(0, by="manager 126", for_ns=140 * MS, times=1),
            "this computer stood still for 140 ms (manager 126 noticed it), which may be the cause of what follows",
        ),
        (
            StoodStill(0, by="the demo", for_ns=140 * MS, times=3),
            "this computer stood still for 140 ms (the demo noticed it), which may be the cause of what follows",
        ),
        (
            StoodStill(0, by="tail_pe", for_ns=90 * MS, times=1),
            "the computer of tail_pe stood still for 90 ms (once so far)",
        ),
        (
            StoodStill(0, by="nav", for_ns=90 * MS, times=2),
            "the computer of nav stood still for 90 ms (2 times so far)",
        ),
        (
            Heartbeat(0, late_ns=7 * MS, period_ns=20 * MS, of_spec_ns=20 * MS),
            "processes run up to 7 ms late on this computer now: it can keep the heartbeat of 20 ms",
        ),
        (
            Heartbeat(0, late_ns=61 * MS, period_ns=160 * MS, of_spec_ns=20 * MS),
            (
                "processes run up to 61 ms late on this computer now, and a heartbeat should be twice that: the demo "
                "flies with a heartbeat of 160 ms, and not 20 ms as in the spec"
            ),
        ),
        (
            Heartbeat(0, late_ns=9 * MS, period_ns=20 * MS, of_spec_ns=20 * MS, why="rehearsal with a page"),
            (
                "processes run up to 9 ms late on this computer now beside a page and its browser: it can keep the "
                "heartbeat of 20 ms"
            ),
        ),
        (
            Heartbeat(0, late_ns=0, period_ns=50 * MS, of_spec_ns=20 * MS, why="given"),
            "as told by --heartbeat, the demo flies with a heartbeat of 50 ms, and not 20 ms as in the spec",
        ),
        (
            Heartbeat(0, late_ns=0, period_ns=20 * MS, of_spec_ns=20 * MS, why="given"),
            "as told by --heartbeat, the heartbeat is 20 ms",
        ),
        (Logs(0, folder="/tmp/f", kept=False), "the logs of all processes are in /tmp/f"),
        (
            Logs(0, folder="/tmp/f", kept=True),
            "the logs of this run are kept in /tmp/f; they are deleted after 5 more runs that keep logs",
        ),
        (
            Overtime(0, awaited=("tail_pe to join", "elevator to be heard"), at_most_s=15.0),
            "the time is up; the demo waits, at most 15 s, for tail_pe to join; elevator to be heard",
        ),
        (
            Outages(0, functions=(*"abcdefg",), times=7, over=True, shortest_ns=180 * MS, longest_ns=640 * MS),
            "7 functions are heard again on the bus, after 180 to 640 ms of silence: a, b, c, d, e and 2 more",
        ),
        (
            Outages(0, functions=(*"abcd",), times=4, over=False, shortest_ns=1000 * MS, longest_ns=1200 * MS),
            "4 functions have not been heard for up to 1200 ms: a, b, c, d",
        ),
        (
            ModuleFailed(0, element="module:servo", by="tail_pe", text="ValueError: no (servo.py:3)", heard_ns=0),
            "why module:servo failed on tail_pe: ValueError: no (servo.py:3)",
        ),
    ],
)
def test_what_the_computer_does_is_told(told: Event, sentence: str) -> None:
    assert [line.text for line in Story(ELEVATOR).tell(told)] == [f"[ start  ] {sentence}"]


# The script


def test_acts_are_played_in_order_of_time() -> None:
    faults = read_script(BIG_BLUE, ["pe:nav@3", "pe:tail_a@3.01"], ["pe:nav@4.5", "pe:tail_a@3.5"])
    assert faults == [
        DemoAction(3, "kill", "nav"),
        DemoAction(3.01, "kill", "tail_a"),
        DemoAction(3.5, "restore", "tail_a"),
        DemoAction(4.5, "restore", "nav"),
    ]


@pytest.mark.parametrize(
    ("kills", "restores", "sentence"),
    [
        (["nav@3"], [], "--kill nav@3: write it as pe:NAME@SECONDS, for example pe:flight@4"),
        (["pe:nav"], [], "--kill pe:nav: write it as"),
        (["pe:nav@"], [], "--kill pe:nav@: write it as"),
        (["pe:nav@soon"], [], "--kill pe:nav@soon: write it as"),
        (["pe:nav@-1"], [], "--kill pe:nav@-1: write it as"),
        (["pe:nav@" + "9" * 400], [], "write it as"),
        (["device:gps@3"], [], "--kill device:gps@3: write it as"),
        ([], ["pe:nva@3"], "--restore pe:nva@3: no PE is named 'nva'; did you mean 'nav'?"),
        (["pe:@3"], [], "--kill pe:@3: write it as"),
        (["pe:nav@٣"], [], "write it as"),
        (["pe:nav@1", "pe:nav@2"], [], "--kill pe:nav@2: nav does not run at that time; kill and restore in turn"),
        ([], ["pe:nav@2"], "--restore pe:nav@2: nav runs at that time"),
        (["pe:nav@1"], ["pe:nav@2", "pe:nav@3"], "--restore pe:nav@3: nav runs at that time"),
    ],
)
def test_a_bad_script_is_one_clear_sentence(
    kills: list[str], restores: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(UserError, match=re.escape(sentence)):
        read_script(BIG_BLUE, kills, restores)
    arguments = [*itertools.chain(*(("--kill", k) for k in kills), *(("--restore", r) for r in restores))]
    assert main(["demo", "big_blue", *arguments]) == 2
    seen = capsys.readouterr()
    assert seen.out == ""
    assert re.fullmatch(f"heronry: .*{re.escape(sentence)}.*\n", seen.err)


def test_without_a_script_the_busiest_pe_is_killed_and_comes_back() -> None:
    kill, restore = default_actions(plan_after(None).told(), 15.0)
    assert (kill.what, restore.what) == ("kill", "restore")
    assert kill.pe == restore.pe == "tail_pe"
    assert kill.at_s < restore.at_s
    assert default_actions(None, 15.0) == []
    assert default_actions(plan_after(None).told(), 3.5) == []  # the demo ends before


def test_the_help_names_the_pe_that_the_demo_kills(capsys: pytest.CaptureFixture[str]) -> None:
    kill, _ = default_actions(plan(BIG_BLUE, situation(BIG_BLUE)).told(), 15.0)
    with pytest.raises(SystemExit):
        main(["demo", "--help"])
    assert f"big_blue; the PE with most modules ({kill.pe}) is killed, and back" in capsys.readouterr().out


# Buses


def test_every_bus_of_a_spec_is_a_software_bus_unless_there_is_something_better(tmp_path: Path) -> None:
    chosen = choose(BIG_BLUE, tmp_path, {}, None)
    assert chosen["radio"] == BusChoice("radio", "softbus", str(tmp_path / "radio.sock"), 112_500, is_ours=True)
    assert chosen["can0"].interface == ("socketcan" if has_interface("vcan0") else "softbus")
    assert choose(BIG_BLUE, tmp_path, {}, None, prefer_vcan=False)["can0"].is_ours


def test_what_is_named_is_taken(tmp_path: Path) -> None:
    chosen = choose(BIG_BLUE, tmp_path, {"radio": ("udp_multicast", "239.0.0.1")}, ("socketcan", "can7", 500_000))
    assert chosen["can0"] == BusChoice("can0", "socketcan", "can7", 500_000, is_ours=False)
    assert chosen["radio"].port_argument() == "radio=udp_multicast:239.0.0.1"
    assert not chosen["radio"].is_ours


def test_a_replicated_bus_is_two_of_whatever_it_is(tmp_path: Path) -> None:
    ours = choose(twin_wires(), tmp_path, {}, None, prefer_vcan=False)["can0"]
    assert [config["channel"] for config in ours.configs()] == [str(tmp_path / f"can0.{n}.sock") for n in (1, 2)]
    assert ours.port_argument() == f"can0=softbus:{tmp_path}/can0.1.sock,{tmp_path}/can0.2.sock"
    named = choose(twin_wires(), tmp_path, {"can1": (None, "can7,can8")}, ("socketcan", "vcan0,vcan1", None))
    assert named["can0"].configs()[1] == {"interface": "socketcan", "channel": "vcan1"}
    assert [config["channel"] for config in named["can1"].configs()] == ["can7", "can8"]
    with pytest.raises(BusArgumentError, match="bus can0 has 2 channels, and 'vcan0' names 1"):
        choose(twin_wires(), tmp_path, {}, ("socketcan", "vcan0", None))


def test_a_bus_named_in_both_ways_is_one_clear_sentence(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="--bus can0: this is the manager's bus, which -i and -c already give"):
        choose(BIG_BLUE, tmp_path, {"can0": ("softbus", "x")}, ("socketcan", "can7", None))


@pytest.mark.parametrize(
    ("interface", "channel", "said"),
    [
        ("softbus", "/tmp/can0.sock", "no bus-off"),
        ("socketcan", "vcan0", "no arbitration"),
        ("socketcan", "can0", "real hardware"),
        ("udp_multicast", "239.0.0.1", "239.0.0.1"),
    ],
)
def test_a_bus_says_what_it_does_not_model(interface: str, channel: str, said: str) -> None:
    sentence = BusChoice("can0", interface, channel, None, is_ours=False).describe()
    assert sentence.startswith("can0: ")
    assert channel in sentence
    assert said in sentence


def test_the_loopback_is_an_interface_of_this_machine() -> None:
    assert has_interface("lo")
    assert not has_interface("can_that_nobody_has")


# The screen


def test_a_pipe_gets_plain_lines(capsys: pytest.CaptureFixture[str]) -> None:
    show = screen(ELEVATOR)
    for one in flight():
        show(one)
    lines = capsys.readouterr().out.splitlines()
    assert [line[13:] for line in lines] == STORY.splitlines()
    begins = {line[:13] for line in lines}
    assert " " * 13 in begins
    assert all(re.fullmatch(r"\d\d:\d\d:\d\d\.\d{3} ", begin) for begin in begins if begin.strip())


def test_a_terminal_gets_colour_and_the_same_words() -> None:
    program = """
from pathlib import Path
from heronry_dg.loader import load
from heronry_manager.events import PeLost
from heronry_tools.reports.screen import screen
show = screen(load(Path("dg_specs/elevator_and_chute.dg.yaml")))
show(PeLost(5, pe="tail_pe", cause="[silent] for 3 periods", last_heard_ns=0))
"""
    master, terminal = os.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "200"}
    environment.pop("NO_COLOR", None)
    with os.fdopen(terminal, "wb") as end:
        subprocess.run([sys.executable, "-c", program], stdout=end, env=environment, check=True)
    with os.fdopen(master, "rb", buffering=0) as screen_side:
        seen = screen_side.read(4096).decode()
    assert "\x1b[1;33m" in seen  # bold yellow: a fault
    assert re.sub(r"\x1b\[[0-9;]*m", "", seen)[13:] == "[ start  ] tail_pe is lost: [silent] for 3 periods\r\n"


def test_a_manager_that_is_killed_and_what_follows_is_a_story() -> None:
    story = Story(BIG_BLUE)
    killed = Process(2_000 * MS, pe="manager", pid=7, what="killed")
    taken = TakenOver(2_107 * MS, term=2, before=1, silent_ns=112 * MS, phase=None)
    over = Summary(3_000 * MS, served=("parachute",), unserved=(), never=(), waited={}, rivals=(), pending=None)
    told = [line.text for one in (killed, taken, over) for line in story.tell(one)]
    assert "KILL the manager (SIGKILL, process 7)" in told[0]
    assert "THE STANDBY MANAGER TAKES OVER, 107 ms after the kill: term 2, after 112 ms of silence" in told[1]
    assert "since the manager was killed no function has fallen silent" in told[2]


def test_a_manager_that_takes_over_reports_how_long_no_manager_was_heard() -> None:
    taken = TakenOver(5_000 * MS, term=2, before=0, silent_ns=None, phase=None)
    (line,) = Story(BIG_BLUE).tell(taken)
    assert "THE STANDBY MANAGER TAKES OVER: term 2, after no manager was heard" in line.text


def test_a_killed_manager_is_not_restored() -> None:
    assert read_script(BIG_BLUE, ["manager@3"], [])[0].pe == "manager"
    with pytest.raises(UserError, match="starts only PEs again, no manager; leave this option out"):
        read_script(BIG_BLUE, ["manager@3"], ["manager@4"])
    with pytest.raises(UserError, match="--kill manager@4: only one --kill can name the manager"):
        read_script(BIG_BLUE, ["manager@3", "manager@4"], [])


@pytest.mark.parametrize("seed", range(part_of(4, 2)))
def test_every_event_of_two_managers_can_be_shown(seed: int) -> None:
    faults = drawn_faults(ELEVATOR, seed, 6.0, of_two=True)
    simulation = Simulation(ELEVATOR, seed, standby=True, key=KEY)
    injections = Injections(simulation, faults, start_ns=2_000 * MS)
    simulation.run_until(8_000 * MS)
    injections.heal()
    assert simulation.settle() == []
    assert any("runs: 11 modules" in line.text for line in told(Story(ELEVATOR), simulation.events))


@pytest.mark.parametrize("option", ["--for", "--from"])
@pytest.mark.parametrize("seconds", ["-1", "nan", "inf", "soon"])
def test_a_time_that_is_none_is_refused(option: str, seconds: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["demo", f"{option}={seconds}"])
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"heronry demo: {option}: ")


def test_held_outputs_are_named_without_brackets() -> None:
    held = [plain_line(OutputsHeld(0, pe="a", modules=names, cause="no lease")) for names in (["x", "y"], [])]
    assert [line.text for line in held if line] == [
        "a holds back what x, y drive: no lease",
        "a holds back what its modules drive: no lease",
    ]
