"""Thinking ahead: what happens next is planned before it happens, with the real planner in its own process."""

import select
from collections.abc import Iterator

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load
from heronry_dg.objective import placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_manager.contingency.contingencies import contingencies
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_manager.planner.client import PlannerClient
from heronry_manager.planner.exact import plan
from heronry_manager.planner.foresight import Foresight
from heronry_manager.planner.sweep import Outcome, Question, Scope, Sweep
from heronry_manager.vocabulary import PlanReady, RequestPlan

FILE = shipped_spec_path("elevator_and_chute")
SPEC = load(FILE)
RUNNING = placement(plan(SPEC, Situation(), None).configuration)
TAIL_LOST = frozenset({"pe:tail_pe"})


@pytest.fixture
def foresight() -> Iterator[Foresight]:
    with PlannerClient(SPEC, FILE) as planner, PlannerClient(SPEC, FILE, niceness=10) as thinker:
        yield Foresight(SPEC, planner, lambda: thinker)


def wait(foresight: Foresight) -> list[PlanReady]:
    """Wait until a planner has something to say, and give what was really asked."""
    select.select(foresight.readers(), [], [])
    return [answer for answer in foresight.poll() if isinstance(answer, PlanReady)]


def think_to_the_end(foresight: Foresight) -> None:
    while foresight.is_thinking:
        assert wait(foresight) == []


def answer_of(foresight: Foresight) -> PlanReady:
    while not (answers := wait(foresight)):
        pass
    (answer,) = answers
    return answer


def test_what_was_not_foreseen_is_asked_for(foresight: Foresight) -> None:
    assert foresight.request(RequestPlan(1, TAIL_LOST, None, RUNNING)) is None
    answer = answer_of(foresight)
    assert answer.request == 1
    assert answer.plan.configuration == plan(SPEC, Situation(TAIL_LOST), RUNNING).configuration


def test_every_single_loss_is_at_hand_once_a_configuration_runs(foresight: Foresight) -> None:
    foresight.settled(frozenset(), None, RUNNING)
    think_to_the_end(foresight)
    for number, pe in enumerate(SPEC.pes, start=1):
        down = frozenset({f"pe:{pe}"})
        answer = foresight.request(RequestPlan(number, down, None, RUNNING))
        assert answer is not None
        assert answer.request == number
        assert answer.plan == plan(SPEC, Situation(down), RUNNING)


def test_a_return_is_at_hand_too(foresight: Foresight) -> None:
    degraded = placement(plan(SPEC, Situation(TAIL_LOST), RUNNING).configuration)
    foresight.settled(TAIL_LOST, None, degraded)
    think_to_the_end(foresight)
    answer = foresight.request(RequestPlan(7, frozenset(), None, degraded))
    assert answer is not None
    assert answer.plan.functions["elevator"].served


def test_a_plan_made_for_another_configuration_is_not_used(foresight: Foresight) -> None:
    foresight.settled(frozenset(), None, RUNNING)
    think_to_the_end(foresight)
    other = {**RUNNING, "state_estimator": ("only", "sensor_pe")}
    assert foresight.request(RequestPlan(1, TAIL_LOST, None, other)) is None
    foresight.settled(frozenset(), None, other)
    assert foresight.request(RequestPlan(2, TAIL_LOST, None, RUNNING)) is None


def test_a_real_question_does_not_wait_for_those_ahead(foresight: Foresight) -> None:
    foresight.settled(frozenset(), None, RUNNING)
    both = frozenset({"pe:tail_pe", "pe:sensor_pe"})
    assert foresight.request(RequestPlan(1, both, None, RUNNING)) is None
    assert answer_of(foresight).request == 1
    think_to_the_end(foresight)
    assert foresight.request(RequestPlan(2, TAIL_LOST, None, RUNNING)) is not None


def test_what_is_in_a_contingency_table_is_at_hand_and_not_thought_about() -> None:
    """A single loss is in the table, so neither planner nor thinker is asked; another one's return is not."""
    scope = Scope(tuple(f"pe:{pe}" for pe in SPEC.pes), 1, (None,))
    swept = Sweep(SPEC, scope)
    swept.run(lambda _, questions: [(one, _planned(one)) for one in questions])
    table = ContingencyTable(SPEC, contingencies(SPEC, scope, swept.outcomes, {None: Configuration()}))
    with PlannerClient(SPEC, FILE) as planner:
        foresight = Foresight(SPEC, planner, lambda: planner, table)
        foresight.settled(frozenset(), None, RUNNING)
        assert not foresight.is_thinking
        answer = foresight.request(RequestPlan(7, TAIL_LOST, None, RUNNING))
        assert answer is not None
        assert answer.request == 7
        assert answer.plan.configuration == plan(SPEC, Situation(TAIL_LOST), RUNNING).configuration
        two = frozenset({"pe:sensor_pe", "pe:control_pe"})
        assert foresight.request(RequestPlan(8, two, None, RUNNING)) is None
        assert answer_of(foresight).request == 8


def _planned(question: Question) -> Outcome:
    found = plan(SPEC, Situation(question.down, {}, question.phase), question.running)
    return Outcome(found.configuration, found.objective, found.optimal)
