"""Thinking ahead: what happens next is planned before it happens, with the real planner in its own process."""

import select
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import NoReturn

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load
from heronry_dg.objective import placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_dg.verify import Violation
from heronry_manager.contingency.contingencies import contingencies
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan
from heronry_manager.planner.client import PlannerClient
from heronry_manager.planner.exact import plan
from heronry_manager.planner.foresight import Foresight
from heronry_manager.planner.sweep import Outcome, Question, Scope, Sweep

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


def at_once(foresight: Foresight, asked: RequestPlan) -> PlanReady:
    answer = foresight.request(asked)
    assert isinstance(answer, PlanReady)
    assert answer.request == asked.request
    return answer


def was_foreseen(foresight: Foresight, asked: RequestPlan) -> bool:
    """A plan that was foreseen is proven; one that was made at once is not."""
    return at_once(foresight, asked).plan.optimal


def test_what_was_not_foreseen_gets_a_plan_at_once_and_the_best_one_at_leisure(foresight: Foresight) -> None:
    answer = at_once(foresight, RequestPlan(1, TAIL_LOST, None, RUNNING))
    assert not answer.plan.optimal
    assert answer.plan.functions["parachute"].served
    runs_now = placement(answer.plan.configuration)
    assert foresight.request(RequestPlan(2, TAIL_LOST, None, runs_now, at_leisure=True)) is None
    best = answer_of(foresight)
    assert best.request == 2
    assert best.plan.configuration == plan(SPEC, Situation(TAIL_LOST), runs_now).configuration


def test_the_first_configuration_has_time_to_be_the_best(foresight: Foresight) -> None:
    assert foresight.request(RequestPlan(1, frozenset(), None, None)) is None
    assert answer_of(foresight).plan.optimal


def test_without_a_solver_everything_is_answered_at_once_and_nothing_is_started() -> None:
    def no_thinker() -> PlannerClient:
        raise AssertionError("a thinker needs a solver")

    foresight = Foresight(SPEC, None, no_thinker)
    first = at_once(foresight, RequestPlan(1, frozenset(), None, None)).plan
    assert first.objective.critical == plan(SPEC, Situation()).objective.critical
    running = placement(first.configuration)
    foresight.settled(frozenset(), None, running)
    assert (foresight.readers(), foresight.poll(), foresight.is_thinking) == ([], [], False)
    same = at_once(foresight, RequestPlan(2, frozenset(), None, running, at_leisure=True)).plan
    assert same.configuration == first.configuration


def test_a_greedy_plan_that_the_judge_refuses_is_not_flown(
    foresight: Foresight, monkeypatch: pytest.MonkeyPatch
) -> None:
    refusal = Violation("7.cpu", "pe tail_pe", "it is too much")
    monkeypatch.setattr("heronry_manager.planner.foresight.verify", lambda *_: [refusal])
    assert foresight.request(RequestPlan(1, TAIL_LOST, None, RUNNING)) is None
    assert answer_of(foresight).plan.optimal
    alone = Foresight(SPEC, None, lambda: pytest.fail("a thinker needs a solver"))
    refused = alone.request(RequestPlan(2, TAIL_LOST, None, RUNNING))
    assert refused == PlanFailed(2, "the greedy plan is not legal: rule 7.cpu, pe tail_pe: it is too much")


def test_every_single_loss_is_at_hand_once_a_configuration_runs(foresight: Foresight) -> None:
    foresight.settled(frozenset(), None, RUNNING)
    think_to_the_end(foresight)
    for number, pe in enumerate(SPEC.pes, start=1):
        down = frozenset({f"pe:{pe}"})
        answer = at_once(foresight, RequestPlan(number, down, None, RUNNING))
        assert answer.plan == plan(SPEC, Situation(down), RUNNING)


def test_a_return_is_at_hand_too(foresight: Foresight) -> None:
    degraded = placement(plan(SPEC, Situation(TAIL_LOST), RUNNING).configuration)
    foresight.settled(TAIL_LOST, None, degraded)
    think_to_the_end(foresight)
    answer = at_once(foresight, RequestPlan(7, frozenset(), None, degraded))
    assert answer.plan.optimal
    assert answer.plan.functions["elevator"].served


def test_a_plan_made_for_another_configuration_is_not_used(foresight: Foresight) -> None:
    foresight.settled(frozenset(), None, RUNNING)
    think_to_the_end(foresight)
    other = {**RUNNING, "state_estimator": ("only", "sensor_pe")}
    assert not was_foreseen(foresight, RequestPlan(1, TAIL_LOST, None, other))
    foresight.settled(frozenset(), None, other)
    assert not was_foreseen(foresight, RequestPlan(2, TAIL_LOST, None, RUNNING))


def test_a_real_question_does_not_wait_for_those_ahead(foresight: Foresight) -> None:
    foresight.settled(frozenset(), None, RUNNING)
    both = frozenset({"pe:tail_pe", "pe:sensor_pe"})
    assert foresight.request(RequestPlan(1, both, None, RUNNING, at_leisure=True)) is None
    assert answer_of(foresight).request == 1
    think_to_the_end(foresight)
    assert was_foreseen(foresight, RequestPlan(2, TAIL_LOST, None, RUNNING))


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
        answer = at_once(foresight, RequestPlan(7, TAIL_LOST, None, RUNNING))
        assert answer.plan.configuration == plan(SPEC, Situation(TAIL_LOST), RUNNING).configuration
        two = frozenset({"pe:sensor_pe", "pe:control_pe"})
        assert not was_foreseen(foresight, RequestPlan(8, two, None, RUNNING))


def _planned(question: Question) -> Outcome:
    found = plan(SPEC, Situation(question.down, {}, question.phase), question.running)
    return Outcome(found.configuration, found.objective, found.optimal)


def test_the_next_phase_is_at_hand_too(tmp_path: Path) -> None:
    file = tmp_path / "phases.dg.yaml"
    phases = "phases: {climb: {}, glide: {}, land: {}}\n"
    file.write_text(FILE.read_text().replace("functions:\n", f"{phases}functions:\n"))
    spec = load(file)
    running = placement(plan(spec, Situation(phase="climb"), None).configuration)
    with PlannerClient(spec, file) as planner, PlannerClient(spec, file) as thinker:
        foresight = Foresight(spec, planner, lambda: thinker)
        foresight.settled(frozenset(), "climb", running)
        think_to_the_end(foresight)
        answer = foresight.request(RequestPlan(1, frozenset(), "glide", running))
        assert isinstance(answer, PlanReady)
        assert answer.plan == plan(spec, Situation(phase="glide"), running)


def test_what_is_foreseen_is_foreseen_for_the_limits_of_the_moment(foresight: Foresight) -> None:
    half = {"bus:can0": Fraction(1, 2)}
    foresight.settled(frozenset(), None, RUNNING, half)
    think_to_the_end(foresight)
    limited = at_once(foresight, RequestPlan(1, TAIL_LOST, None, RUNNING, limits=half)).plan
    assert limited == plan(SPEC, Situation(TAIL_LOST, half), RUNNING)
    assert not was_foreseen(foresight, RequestPlan(2, TAIL_LOST, None, RUNNING))


def test_no_contingency_is_looked_up_while_a_bus_is_limited() -> None:
    class Table(ContingencyTable):
        def __init__(self) -> None:
            """Know nothing: it must not be asked."""

        def plan(self, *_: object) -> NoReturn:
            raise AssertionError("its plans are for whole buses")

    foresight = Foresight(SPEC, None, lambda: pytest.fail("a thinker needs a solver"), Table())
    none = {"bus:can0": Fraction(0)}
    found = at_once(foresight, RequestPlan(1, TAIL_LOST, None, RUNNING, limits=none)).plan
    assert found.now.limits == none
    assert all(report.bits_per_s == 0 for report in found.buses.values())
