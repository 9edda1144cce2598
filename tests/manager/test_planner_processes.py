"""The policy with the real planners, each in its own process: plans for the next fault are made ahead."""

import os
import select
import signal
from collections.abc import Iterator
from pathlib import Path
from time import monotonic_ns, sleep

import pytest

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan, Settled
from heronry_manager.planner import client
from heronry_manager.planner.client import PlannerClient
from heronry_manager.planner.exact import plan
from heronry_manager.planner.greedy.planner import Greedy
from heronry_manager.planning_policy import PlanningPolicy
from heronry_manager.shell import planner_processes
from heronry_manager.shell.planner_processes import PlannerProcesses

FILE = shipped_spec_path("elevator_and_chute")
SPEC = load(FILE)
RUNNING = placement(plan(SPEC, Situation(), None).configuration)
TAIL_LOST = Situation(frozenset({"pe:tail_pe"}))


class Flown:
    """A policy, and the processes behind it."""

    def __init__(self, spec: Spec, planner: PlannerClient, pre_planner: PlannerClient) -> None:
        self.policy = PlanningPolicy(spec, Greedy(spec), has_planner=True)
        self.processes = PlannerProcesses(self.policy, planner, lambda: pre_planner, calm_ns=0)

    def settle(self, now: Situation, running: Placement) -> None:
        """Let this run until every question ahead is planned."""
        assert self.processes.take(Settled(now, running)) == []
        while self.processes.next_deadline_ns() is not None:
            assert self.wait() == []

    def wait(self) -> list[PlanReady | PlanFailed]:
        deadline_ns = self.processes.next_deadline_ns()
        assert deadline_ns is not None
        select.select(self.processes.readers(), [], [], max(0, deadline_ns - monotonic_ns()) / 1e9)
        return self.processes.poll()

    def in_time(self) -> PlanReady | PlanFailed:
        """Wait for the one answer that comes because a budget ends: no process says anything."""
        while not (answers := self.processes.poll()):
            sleep(0.01)
        (answer,) = answers
        return answer

    def immediate(self, plan_request: RequestPlan) -> PlanReady:
        (answer,) = self.processes.take(plan_request)
        assert isinstance(answer, PlanReady)
        assert answer.request == plan_request.request
        return answer

    def later(self, plan_request: RequestPlan) -> PlanReady:
        assert self.processes.take(plan_request) == []
        while not (answers := self.wait()):
            pass
        (answer,) = answers
        assert isinstance(answer, PlanReady)
        assert answer.request == plan_request.request
        return answer


@pytest.fixture(scope="module")
def planners() -> Iterator[tuple[PlannerClient, PlannerClient]]:
    """A planner and a pre-planner, which no test has stopped; each test leaves them without a request."""
    with PlannerClient(SPEC, FILE) as planner, PlannerClient(SPEC, FILE, niceness=10) as pre_planner:
        yield planner, pre_planner


@pytest.fixture
def flown(planners: tuple[PlannerClient, PlannerClient]) -> Iterator[Flown]:
    flown = Flown(SPEC, *planners)
    yield flown
    assert flown.processes.next_deadline_ns() is None


def test_what_was_not_pre_planned_gets_an_immediate_plan_and_the_best_one_in_the_background(flown: Flown) -> None:
    answer = flown.immediate(RequestPlan(1, TAIL_LOST, RUNNING))
    assert not answer.plan.optimal
    assert answer.plan.functions["parachute"].served
    runs_now = placement(answer.plan.configuration)
    best = flown.later(RequestPlan(2, TAIL_LOST, runs_now, in_background=True))
    assert best.plan.configuration == plan(SPEC, TAIL_LOST, runs_now).configuration


def test_a_repeated_question_is_answered_without_the_planners_process(
    flown: Flown, monkeypatch: pytest.MonkeyPatch, planners: tuple[PlannerClient, PlannerClient]
) -> None:
    running = placement(flown.immediate(RequestPlan(1, TAIL_LOST, RUNNING)).plan.configuration)
    best = flown.later(RequestPlan(2, TAIL_LOST, running, in_background=True))
    with monkeypatch.context() as patch:
        patch.setattr(planners[0], "request", lambda *_: pytest.fail("it was asked again"))
        assert flown.later(RequestPlan(3, TAIL_LOST, running, in_background=True)).plan == best.plan
    assert flown.later(RequestPlan(4, TAIL_LOST, RUNNING, in_background=True)).plan.optimal  # another question


def test_the_oldest_plans_of_the_planner_are_forgotten(flown: Flown, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner_processes, "_KEPT_PLANS", 1)
    asked = []
    request = PlannerClient.request
    monkeypatch.setattr(PlannerClient, "request", lambda *given: [asked.append(given[1]), request(*given)])
    down = Situation(frozenset({"device:gps"}))
    for number, now in enumerate([TAIL_LOST, down, down, TAIL_LOST], start=1):
        flown.later(RequestPlan(number, now, RUNNING, in_background=True))
    assert asked == [1, 2, 4]


def test_the_first_configuration_has_time_to_be_the_best(flown: Flown) -> None:
    assert flown.later(RequestPlan(1, Situation(), None)).plan.optimal


def test_every_single_loss_is_at_hand_once_a_configuration_runs(flown: Flown) -> None:
    flown.settle(Situation(), RUNNING)
    for number, pe in enumerate(SPEC.pes, start=1):
        lost = Situation(frozenset({f"pe:{pe}"}))
        assert flown.immediate(RequestPlan(number, lost, RUNNING)).plan == plan(SPEC, lost, RUNNING)


def test_nothing_is_pre_planned_while_configurations_change() -> None:
    policy = PlanningPolicy(SPEC, Greedy(SPEC), has_planner=True)
    with PlannerClient(SPEC, FILE) as planner:
        processes = PlannerProcesses(policy, planner, lambda: pytest.fail("too early"))
        settled = Settled(Situation(), RUNNING)
        assert processes.take(settled) == []
        deadline_ns = processes.next_deadline_ns()
        assert deadline_ns is not None
        assert processes.take(settled) == processes.poll() == []
        assert processes.next_deadline_ns() == deadline_ns  # told again, it does not begin anew
        assert len(processes.take(RequestPlan(1, TAIL_LOST, RUNNING))) == 1
        assert processes.next_deadline_ns() is None


def test_a_return_is_at_hand_too(flown: Flown) -> None:
    degraded = placement(plan(SPEC, TAIL_LOST, RUNNING).configuration)
    flown.settle(TAIL_LOST, degraded)
    answer = flown.immediate(RequestPlan(7, Situation(), degraded))
    assert answer.plan.optimal
    assert answer.plan.functions["elevator"].served


def test_a_question_does_not_wait_for_those_ahead(flown: Flown) -> None:
    assert flown.processes.take(Settled(Situation(), RUNNING)) == flown.processes.poll() == []
    both = Situation(frozenset({"pe:tail_pe", "pe:sensor_pe"}))
    flown.later(RequestPlan(1, both, RUNNING, in_background=True))
    flown.settle(Situation(), RUNNING)
    assert flown.immediate(RequestPlan(2, TAIL_LOST, RUNNING)).plan.optimal


def test_what_the_planner_cannot_answer_is_reported(flown: Flown) -> None:
    nowhere = Situation(phase="nowhere")
    assert flown.processes.take(RequestPlan(1, nowhere, RUNNING, in_background=True)) == []
    while not (answers := flown.wait()):
        pass
    (answer,) = answers
    assert isinstance(answer, PlanFailed)
    assert "no phase is named 'nowhere'" in answer.reason


def test_the_next_phase_is_at_hand_too(tmp_path: Path) -> None:
    file = tmp_path / "phases.dg.yaml"
    phases = "phases: {climb: {}, glide: {}, land: {}}\n"
    file.write_text(FILE.read_text().replace("functions:\n", f"{phases}functions:\n"))
    spec = load(file)
    running = placement(plan(spec, Situation(phase="climb"), None).configuration)
    with PlannerClient(spec, file) as planner, PlannerClient(spec, file) as pre_planner:
        flown = Flown(spec, planner, pre_planner)
        flown.settle(Situation(phase="climb"), running)
        glide = Situation(phase="glide")
        assert flown.immediate(RequestPlan(1, glide, running)).plan == plan(spec, glide, running)


def stop(planner: PlannerClient) -> int:
    """Stop the process of a planner that has loaded the solver, as a debugger or a full memory may do."""
    planner.wait_until_ready()
    assert planner.process_id is not None
    os.kill(planner.process_id, signal.SIGSTOP)
    return planner.process_id


def test_a_planner_that_hangs_is_replaced_and_the_greedy_plan_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    with PlannerClient(SPEC, FILE) as planner, PlannerClient(SPEC, FILE) as pre_planner:
        flown = Flown(SPEC, planner, pre_planner)
        stopped = stop(planner)
        monkeypatch.setattr(planner_processes, "AWAITED_NS", 1_000_000)
        assert flown.processes.take(RequestPlan(1, Situation(), None)) == []
        answer = flown.in_time()
        assert isinstance(answer, PlanReady)
        assert not answer.plan.optimal
        assert planner.process_id != stopped
        assert flown.processes.next_deadline_ns() is None
        running = placement(answer.plan.configuration)
        assert flown.later(RequestPlan(2, Situation(), running, in_background=True)).plan.optimal


def test_a_better_plan_that_does_not_come_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    with PlannerClient(SPEC, FILE) as planner, PlannerClient(SPEC, FILE) as pre_planner:
        flown = Flown(SPEC, planner, pre_planner)
        stop(planner)
        monkeypatch.setattr(planner_processes, "AHEAD_NS", 1_000_000)
        assert flown.processes.take(RequestPlan(1, TAIL_LOST, RUNNING, in_background=True)) == []
        answer = flown.in_time()
        assert isinstance(answer, PlanFailed)
        assert "did not answer within its budget, and was replaced" in answer.reason


def test_a_pre_planner_that_hangs_is_replaced_and_goes_on_with_the_next_question(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with PlannerClient(SPEC, FILE) as planner, PlannerClient(SPEC, FILE) as pre_planner:
        flown = Flown(SPEC, planner, pre_planner)
        stopped = stop(pre_planner)
        monkeypatch.setattr(planner_processes, "AHEAD_NS", 1_000_000)
        assert flown.processes.take(Settled(Situation(), RUNNING)) == flown.processes.poll() == []
        monkeypatch.undo()
        while flown.processes.next_deadline_ns() is not None:
            sleep(0.01)
            assert flown.processes.poll() == []
        assert pre_planner.process_id != stopped
        last = list(SPEC.pes)[-1]
        assert flown.immediate(RequestPlan(1, Situation(frozenset({f"pe:{last}"})), RUNNING)).plan.optimal


def test_a_planner_that_hangs_does_not_keep_the_manager_from_ending(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "_LONGEST_END_S", 0.01)
    with PlannerClient(SPEC, FILE) as planner:
        stopped = stop(planner)
    with pytest.raises(ProcessLookupError):
        os.kill(stopped, 0)


def test_without_a_solver_nothing_is_started() -> None:
    policy = PlanningPolicy(SPEC, Greedy(SPEC), has_planner=False)
    processes = PlannerProcesses(policy, None, lambda: pytest.fail("a pre-planner needs a solver"), calm_ns=0)
    (first,) = processes.take(RequestPlan(1, Situation(), None))
    assert isinstance(first, PlanReady)
    assert first.plan.objective.critical == plan(SPEC, Situation()).objective.critical
    assert processes.take(Settled(Situation(), placement(first.plan.configuration))) == []
    assert (processes.readers(), processes.poll()) == ([], [])
