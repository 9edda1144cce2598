"""Searches for which nobody waits stand still while something is urgent, and nothing of them stays behind."""

import time

import pytest

from heronry_dg.loader import load
from heronry_dg.objective import placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_manager.core.vocabulary import PlanReady, RequestPlan, Settled
from heronry_manager.planner.client import Planned, PlannerClient
from heronry_manager.planner.exact import plan
from heronry_manager.planner.greedy.planner import Greedy
from heronry_manager.planning_policy import PlanningPolicy
from heronry_manager.shell.filler_pauses import PAUSE_PERIODS, FillerPauses
from heronry_manager.shell.planner_processes import PlannerProcesses
from heronry_wire.state_frames import PeState
from manager.killed_parents import expect_end_of_helper, state_of, until
from manager.one_manager import BEAT_NS, MS, OneManager

FILE = shipped_spec_path("elevator_and_chute")
SPEC = load(FILE)
RUNNING = placement(plan(SPEC, Situation(), None).configuration)
TAIL_LOST = Situation(frozenset({"pe:tail_pe"}))
STOPPED = "T"
MANAGER_THAT_IS_KILLED = """
import os, signal, sys
from pathlib import Path
from heronry_dg.loader import load
from heronry_manager.planner.client import PlannerClient
file = Path(sys.argv[1])
planner = PlannerClient(load(file), file)
if sys.argv[2] == "ready":
    planner.wait_until_ready()
planner.hold(True)
print(planner.process_id, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def stands_still(planner: PlannerClient) -> bool:
    """Tell whether the process is stopped; a signal may take a moment."""
    assert planner.process_id is not None
    return state_of(planner.process_id) == STOPPED


def test_a_pause_lasts_a_few_heartbeats_longer_than_what_was_urgent() -> None:
    pauses, after_ns = FillerPauses(20 * MS), PAUSE_PERIODS * 20 * MS
    assert not pauses.look(0, is_pressed=False)
    assert pauses.next_deadline_ns() is None
    assert pauses.look(MS, is_pressed=True)
    assert pauses.look(2 * MS, is_pressed=True)
    assert pauses.next_deadline_ns() == 2 * MS + after_ns
    assert pauses.look(1 * MS + after_ns, is_pressed=False)
    assert not pauses.look(2 * MS + after_ns, is_pressed=False)
    assert pauses.next_deadline_ns() is None


def test_the_manager_is_pressed_from_a_suspicion_until_the_epoch_is_active_everywhere() -> None:
    manager = OneManager()
    manager.start()
    assert not manager.core.is_pressed
    manager.die("middle")
    manager.pass_time(BEAT_NS + BEAT_NS // 2)
    assert manager.core.is_pressed, "middle is suspected"
    manager.live("middle", PeState.ACTIVE, epoch=manager.prepared()[0], digest=manager.prepared()[1])
    assert not manager.core.is_pressed, "it has answered in time"
    manager.die("left")
    manager.pass_time(4 * BEAT_NS)
    assert manager.core.is_pressed, "a plan is awaited"
    manager.answer()
    for pe in ("middle", "right"):
        assert manager.core.is_pressed, "it is being prepared"
        manager.stage(pe)
    manager.pass_time(6 * BEAT_NS)
    for pe in ("middle", "right"):
        assert manager.core.is_pressed, "it is being activated"
        manager.take(pe, PeState.ACTIVE)
    assert not manager.core.is_pressed


def test_both_processes_stand_still_and_go_on_where_they_were() -> None:
    with PlannerClient(SPEC, FILE) as planner, PlannerClient(SPEC, FILE) as pre_planner:
        processes = PlannerProcesses(
            PlanningPolicy(SPEC, Greedy(SPEC), has_planner=True), planner, lambda: pre_planner, calm_ns=0
        )
        for one in (planner, pre_planner):
            one.wait_until_ready()
        assert processes.take(Settled(Situation(), RUNNING)) == processes.poll() == []
        processes.take(RequestPlan(1, TAIL_LOST, RUNNING, in_background=True))
        begun_ns = time.monotonic_ns()
        processes.hold(True, begun_ns)
        until(lambda: stands_still(planner) and stands_still(pre_planner))
        assert processes.next_deadline_ns() is None, "a pause counts in no budget"
        processes.hold(False, time.monotonic_ns())
        answers: list[object] = []
        until(lambda: bool(answers.extend(processes.poll()) or answers))
        assert isinstance(answers[0], PlanReady)
        until(lambda: processes.poll() == [] and processes.next_deadline_ns() is None)
        first = next(iter(SPEC.pes))  # the question that was out already: a request drops the others
        (known,) = processes.take(RequestPlan(2, Situation(frozenset({f"pe:{first}"})), RUNNING))
        assert isinstance(known, PlanReady)
        assert known.plan.optimal


def test_a_plan_that_the_aircraft_waits_for_is_made_during_a_pause() -> None:
    with PlannerClient(SPEC, FILE) as planner:
        processes = PlannerProcesses(PlanningPolicy(SPEC, None, has_planner=True), planner, lambda: planner, calm_ns=0)
        planner.wait_until_ready()
        processes.take(RequestPlan(1, TAIL_LOST, RUNNING, in_background=True))
        processes.hold(True, time.monotonic_ns())
        until(lambda: stands_still(planner))
        assert processes.take(RequestPlan(2, Situation(), None)) == []
        assert not stands_still(planner)
        assert processes.next_deadline_ns() is not None
        answers: list[object] = []
        until(lambda: bool(answers.extend(processes.poll()) or len(answers) == 2))
        processes.take(RequestPlan(3, Situation(), RUNNING, in_background=True))
        until(lambda: stands_still(planner))
        processes.hold(False, time.monotonic_ns())
        until(lambda: bool(processes.poll()))


def test_nothing_new_is_pre_planned_during_a_pause() -> None:
    policy = PlanningPolicy(SPEC, Greedy(SPEC), has_planner=True)
    started: list[PlannerClient] = []
    with PlannerClient(SPEC, FILE) as planner:
        processes = PlannerProcesses(policy, planner, lambda: started.append(planner) or planner, calm_ns=0)
        processes.hold(True, time.monotonic_ns())
        assert processes.take(Settled(Situation(), RUNNING)) == processes.poll() == []
        assert (started, processes.next_deadline_ns()) == ([], None)
        processes.hold(False, time.monotonic_ns())
        assert processes.poll() == []
        assert started == [planner]


def test_a_process_that_stands_still_ends_in_order_and_its_successor_stands_still_too() -> None:
    with PlannerClient(SPEC, FILE) as planner:
        planner.wait_until_ready()
        first = planner.process_id
        planner.request(1, Situation(), None)
        planner.hold(True)
        planner.cancel()
        assert planner.process_id != first
        until(lambda: not planner.poll() and stands_still(planner))  # as soon as it is ready
        planner.request(2, Situation(), None)
        planner.hold(False)
        answers: list[object] = []
        until(lambda: bool(answers.extend(planner.poll()) or answers))
        assert isinstance(answers[0], Planned)
        planner.hold(True)
        until(lambda: stands_still(planner))
        last = planner.process_id
    assert last is not None
    assert state_of(last) is None


@pytest.mark.parametrize("process", ["ready", "starting"])
def test_a_manager_that_is_killed_during_a_pause_leaves_no_process(process: str) -> None:
    expect_end_of_helper(MANAGER_THAT_IS_KILLED, str(FILE), process)
