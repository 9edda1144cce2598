"""The policy with the real planners, each in its own process: plans for the next fault are made ahead."""

import select
from collections.abc import Iterator
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_manager.core.planning_policy import PlanningPolicy
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan, Settled
from heronry_manager.planner.client import PlannerClient
from heronry_manager.planner.exact import plan
from heronry_manager.planner.greedy.planner import Greedy
from heronry_manager.shell.planner_processes import PlannerProcesses

FILE = shipped_spec_path("elevator_and_chute")
SPEC = load(FILE)
RUNNING = placement(plan(SPEC, Situation(), None).configuration)
TAIL_LOST = Situation(frozenset({"pe:tail_pe"}))


class Flown:
    """A policy, and the processes behind it."""

    def __init__(self, spec: Spec, planner: PlannerClient, pre_planner: PlannerClient) -> None:
        self.policy = PlanningPolicy(spec, Greedy(spec), has_planner=True)
        self.processes = PlannerProcesses(self.policy, planner, lambda: pre_planner)

    def settle(self, now: Situation, running: Placement) -> None:
        """Let this run until every question ahead is planned."""
        assert self.processes.take(Settled(now, running)) == []
        while self.policy.is_pre_planning:
            assert self.wait() == []

    def wait(self) -> list[PlanReady | PlanFailed]:
        select.select(self.processes.readers(), [], [])
        return self.processes.poll()

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


@pytest.fixture
def flown() -> Iterator[Flown]:
    with PlannerClient(SPEC, FILE) as planner, PlannerClient(SPEC, FILE, niceness=10) as pre_planner:
        yield Flown(SPEC, planner, pre_planner)


def test_what_was_not_pre_planned_gets_an_immediate_plan_and_the_best_one_in_the_background(flown: Flown) -> None:
    answer = flown.immediate(RequestPlan(1, TAIL_LOST, RUNNING))
    assert not answer.plan.optimal
    assert answer.plan.functions["parachute"].served
    runs_now = placement(answer.plan.configuration)
    best = flown.later(RequestPlan(2, TAIL_LOST, runs_now, in_background=True))
    assert best.plan.configuration == plan(SPEC, TAIL_LOST, runs_now).configuration


def test_the_first_configuration_has_time_to_be_the_best(flown: Flown) -> None:
    assert flown.later(RequestPlan(1, Situation(), None)).plan.optimal


def test_every_single_loss_is_at_hand_once_a_configuration_runs(flown: Flown) -> None:
    flown.settle(Situation(), RUNNING)
    for number, pe in enumerate(SPEC.pes, start=1):
        lost = Situation(frozenset({f"pe:{pe}"}))
        assert flown.immediate(RequestPlan(number, lost, RUNNING)).plan == plan(SPEC, lost, RUNNING)


def test_a_return_is_at_hand_too(flown: Flown) -> None:
    degraded = placement(plan(SPEC, TAIL_LOST, RUNNING).configuration)
    flown.settle(TAIL_LOST, degraded)
    answer = flown.immediate(RequestPlan(7, Situation(), degraded))
    assert answer.plan.optimal
    assert answer.plan.functions["elevator"].served


def test_a_question_does_not_wait_for_those_ahead(flown: Flown) -> None:
    assert flown.processes.take(Settled(Situation(), RUNNING)) == []
    both = Situation(frozenset({"pe:tail_pe", "pe:sensor_pe"}))
    flown.later(RequestPlan(1, both, RUNNING, in_background=True))
    flown.settle(Situation(), RUNNING)
    assert flown.immediate(RequestPlan(2, TAIL_LOST, RUNNING)).plan.optimal


def test_what_the_planner_cannot_answer_is_reported(flown: Flown) -> None:
    nowhere = Situation(phase="nowhere")
    assert flown.processes.take(RequestPlan(1, nowhere, None)) == []
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


def test_without_a_solver_nothing_is_started() -> None:
    policy = PlanningPolicy(SPEC, Greedy(SPEC), has_planner=False)
    processes = PlannerProcesses(policy, None, lambda: pytest.fail("a pre-planner needs a solver"))
    (first,) = processes.take(RequestPlan(1, Situation(), None))
    assert isinstance(first, PlanReady)
    assert first.plan.objective.critical == plan(SPEC, Situation()).objective.critical
    assert processes.take(Settled(Situation(), placement(first.plan.configuration))) == []
    assert (processes.readers(), processes.poll()) == ([], [])
