"""Which planner answers, and what is planned ahead: the policy, without a process."""

from dataclasses import replace
from fractions import Fraction
from typing import NoReturn

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load, loads
from heronry_dg.objective import Placement, placement, score
from heronry_dg.plan import Plan, make_plan
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_dg.verify import verify
from heronry_manager.contingency.contingencies import contingencies
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan, Settled
from heronry_manager.planner.exact import plan
from heronry_manager.planner.greedy.planner import Greedy
from heronry_manager.planner.sweep import Outcome, Scope, Sweep
from heronry_manager.planner.sweep import Question as SweepQuestion
from heronry_manager.planning_policy import (
    Answer,
    AskPlanner,
    ImmediatePlanner,
    PlannerAnswered,
    PlanningPolicy,
    PrePlan,
    PrePlannerAnswered,
    Question,
    Source,
)
from heronry_wire.sansio import InvariantError

FILE = shipped_spec_path("elevator_and_chute")
SPEC = load(FILE)
GREEDY = Greedy(SPEC)
WELL = Situation()
BEST = plan(SPEC, WELL, None)
RUNNING = placement(BEST.configuration)
TAIL_LOST = Situation(frozenset({"pe:tail_pe"}))
LOSSES = [Situation(frozenset({f"pe:{pe}"})) for pe in SPEC.pes]


class Ahead:
    """A policy, and the questions that its pre-planner gets."""

    def __init__(self, policy: PlanningPolicy) -> None:
        self.policy, self.plan_request = policy, list[Question]()

    def settle(self, now: Situation = WELL, running: Placement = RUNNING, plan: Plan | None = BEST) -> list[Question]:
        """Settle, and answer all questions ahead; gives them."""
        self.plan_request, instructions = [], self.policy.step(Settled(now, running))
        while instructions:
            (instruction,) = instructions
            assert isinstance(instruction, PrePlan)
            self.plan_request.append(instruction.question)
            instructions = self.policy.step(PrePlannerAnswered(instruction.number, plan))
        return self.plan_request

    def knows(self, now: Situation, running: Placement = RUNNING) -> bool:
        return source(self.policy, RequestPlan(1, now, running)) is Source.PRE_PLANNED


def source(policy: PlanningPolicy, plan_request: RequestPlan) -> Source | None:
    """Where the answer comes from; None: the planner is plan_request."""
    (instruction,) = policy.step(plan_request)
    return instruction.source if isinstance(instruction, Answer) else None


@pytest.fixture
def policy() -> PlanningPolicy:
    return PlanningPolicy(SPEC, GREEDY, has_planner=True)


@pytest.fixture
def ahead(policy: PlanningPolicy) -> Ahead:
    return Ahead(policy)


MONITOR_LOST = Situation(frozenset({"module:servo_monitor"}))
SAFE = plan(SPEC, MONITOR_LOST, RUNNING).configuration


def table(safe: Configuration = SAFE) -> ContingencyTable:
    """Contingencies for the losses of PEs; `safe`: the safe mode."""
    scope = Scope(tuple(f"pe:{pe}" for pe in SPEC.pes), 1, (None,))
    swept = Sweep(SPEC, scope)
    swept.run(lambda _, questions: [(one, _planned(one)) for one in questions])
    return ContingencyTable(SPEC, contingencies(SPEC, scope, swept.outcomes, {None: safe}))


def _planned(one: SweepQuestion) -> Outcome:
    found = plan(SPEC, Situation(one.down), one.running)
    return Outcome(found.configuration, found.objective, found.optimal)


class TestQuestions:
    def test_an_immediate_one_is_answered_by_a_plan_that_the_verifier_accepts(self, policy: PlanningPolicy) -> None:
        (answer,) = policy.step(RequestPlan(7, TAIL_LOST, RUNNING))
        assert answer == Answer(PlanReady(7, GREEDY.plan(TAIL_LOST, RUNNING)), Source.IMMEDIATE)

    @pytest.mark.parametrize("in_background", [False, True])
    def test_one_in_the_background_is_for_the_planner(self, policy: PlanningPolicy, in_background: bool) -> None:
        plan_request = RequestPlan(7, WELL, RUNNING if in_background else None, in_background)
        assert policy.step(plan_request) == [AskPlanner(plan_request)]
        ready = PlanReady(7, BEST)
        assert policy.step(PlannerAnswered(ready)) == [Answer(ready, Source.PLANNER)]

    def test_a_failure_at_a_better_plan_is_handed_on(self, policy: PlanningPolicy) -> None:
        policy.step(RequestPlan(7, WELL, RUNNING, in_background=True))
        failed = PlanFailed(7, "it was killed")
        assert policy.step(PlannerAnswered(failed)) == [Answer(failed, Source.PLANNER)]

    def test_a_failure_at_the_first_plan_is_answered_by_the_greedy_planner(self, policy: PlanningPolicy) -> None:
        policy.step(RequestPlan(7, WELL, None))
        failed = PlannerAnswered(PlanFailed(7, "it was killed"))
        assert policy.step(failed) == [Answer(PlanReady(7, GREEDY.plan(WELL)), Source.IMMEDIATE)]
        assert policy.step(failed) == []

    def test_a_failure_is_handed_on_where_there_is_no_immediate_planner(self) -> None:
        policy = PlanningPolicy(SPEC, None, has_planner=True)
        policy.step(RequestPlan(7, WELL, None))
        failed = PlanFailed(7, "it was killed")
        assert policy.step(PlannerAnswered(failed)) == [Answer(failed, Source.PLANNER)]

    def test_a_late_answer_is_handed_on_and_a_doubled_one_is_dropped(self, policy: PlanningPolicy) -> None:
        policy.step(RequestPlan(1, WELL, None))
        policy.step(RequestPlan(2, TAIL_LOST, None))
        for number in (1, 2):
            assert len(policy.step(PlannerAnswered(PlanReady(number, BEST)))) == 1
            assert policy.step(PlannerAnswered(PlanReady(number, BEST))) == []

    def test_a_lost_answer_holds_up_nothing(self, policy: PlanningPolicy) -> None:
        policy.step(RequestPlan(1, WELL, None))
        assert source(policy, RequestPlan(2, TAIL_LOST, RUNNING)) is Source.IMMEDIATE
        assert source(policy, RequestPlan(3, TAIL_LOST, RUNNING, in_background=True)) is None

    @pytest.mark.parametrize(
        "plan_request", [RequestPlan(1, WELL, None), RequestPlan(1, WELL, RUNNING, in_background=True)]
    )
    def test_without_a_solver_every_one_is_immediate(self, plan_request: RequestPlan) -> None:
        assert source(PlanningPolicy(SPEC, GREEDY, has_planner=False), plan_request) is Source.IMMEDIATE

    def test_without_an_immediate_planner_every_one_is_for_the_planner(self) -> None:
        plan_request = RequestPlan(1, TAIL_LOST, RUNNING)
        assert PlanningPolicy(SPEC, None, has_planner=True).step(plan_request) == [AskPlanner(plan_request)]

    def test_there_has_to_be_a_planner(self) -> None:
        with pytest.raises(InvariantError, match="there is no planner"):
            PlanningPolicy(SPEC, None, has_planner=False)


class Overloading:
    """An immediate planner whose plans are not legal: they run on a PE that is down."""

    def plan(self, now: Situation, running: Placement | None = None) -> Plan:
        assert running == RUNNING
        return replace(BEST, now=now)


class TestARefusedGreedyPlan:
    plan_request = RequestPlan(7, TAIL_LOST, RUNNING)
    refusal = verify(SPEC, TAIL_LOST, BEST.configuration)[0]

    def test_is_not_flown_and_the_planner_is_asked(self) -> None:
        policy = PlanningPolicy(SPEC, Overloading(), has_planner=True)
        assert policy.step(self.plan_request) == [AskPlanner(self.plan_request, self.refusal)]
        assert len(policy.step(PlannerAnswered(PlanReady(7, BEST)))) == 1

    def test_is_not_flown_either_where_the_planner_fails(self) -> None:
        policy = PlanningPolicy(SPEC, Overloading(), has_planner=True)
        policy.step(self.plan_request)
        failed = PlanFailed(7, "it was killed")
        assert policy.step(PlannerAnswered(failed)) == [Answer(failed, Source.PLANNER)]

    def test_fails_the_question_where_there_is_no_planner(self) -> None:
        policy = PlanningPolicy(SPEC, Overloading(), has_planner=False)
        failed = PlanFailed(7, f"the greedy plan is not legal: {self.refusal}")
        assert policy.step(self.plan_request) == [Answer(failed, Source.IMMEDIATE)]


class Idle:
    """An immediate planner whose plans serve nothing."""

    def plan(self, now: Situation, running: Placement | None = None) -> Plan:
        worth = score(SPEC, now, Configuration(), running)
        return make_plan(SPEC, now, Configuration(), worth, optimal=False)


class TestSafeMode:
    lost = RequestPlan(7, MONITOR_LOST, RUNNING)

    @pytest.mark.parametrize("immediate", [Overloading(), Idle()], ids=["no legal plan", "a plan without class A"])
    @pytest.mark.parametrize("has_planner", [False, True])
    def test_it_takes_the_place_of_what_is_not_legal_or_serves_less_of_class_a(
        self, immediate: ImmediatePlanner, *, has_planner: bool
    ) -> None:
        policy = PlanningPolicy(SPEC, immediate, has_planner=has_planner, contingencies=table())
        (answer,) = policy.step(self.lost)
        assert isinstance(answer, Answer)
        assert isinstance(answer.answer, PlanReady)
        assert answer.source is Source.SAFE_MODE
        assert answer.answer.plan.configuration == SAFE
        assert not answer.answer.plan.optimal

    def test_it_takes_the_place_of_a_planner_that_fails(self) -> None:
        policy = PlanningPolicy(SPEC, None, has_planner=True, contingencies=table())
        assert policy.step(self.lost) == [AskPlanner(self.lost)]
        (answer,) = policy.step(PlannerAnswered(PlanFailed(7, "it was killed")))
        assert isinstance(answer, Answer)
        assert answer.source is Source.SAFE_MODE

    def test_it_must_be_legal(self) -> None:
        policy = PlanningPolicy(SPEC, Idle(), has_planner=False, contingencies=table(BEST.configuration))
        assert source(policy, self.lost) is Source.IMMEDIATE

    def test_it_must_serve_more_of_class_a(self) -> None:
        policy = PlanningPolicy(SPEC, Idle(), has_planner=False, contingencies=table(Configuration()))
        assert source(policy, self.lost) is Source.IMMEDIATE

    def test_it_is_that_of_the_phase(self) -> None:
        assert table().safe_mode(Situation(phase="unknown"), None) is None

    def test_a_background_request_never_gets_it(self) -> None:
        policy = PlanningPolicy(SPEC, None, has_planner=True, contingencies=table())
        policy.step(replace(self.lost, in_background=True))
        failed = PlanFailed(7, "it was killed")
        assert policy.step(PlannerAnswered(failed)) == [Answer(failed, Source.PLANNER)]


class TestContingencies:
    def test_what_they_know_is_at_hand_and_not_pre_planned(self) -> None:
        policy = PlanningPolicy(SPEC, GREEDY, has_planner=True, contingencies=table())
        assert Ahead(policy).settle() == []
        (answer,) = policy.step(RequestPlan(7, TAIL_LOST, RUNNING))
        assert isinstance(answer, Answer)
        assert isinstance(answer.answer, PlanReady)
        assert answer.source is Source.CONTINGENCIES
        assert answer.answer.plan.configuration == plan(SPEC, TAIL_LOST, RUNNING).configuration

    def test_what_they_do_not_know_is_for_others(self) -> None:
        policy = PlanningPolicy(SPEC, GREEDY, has_planner=True, contingencies=table())
        two = Situation(frozenset({"pe:sensor_pe", "pe:control_pe"}))
        assert source(policy, RequestPlan(8, two, RUNNING)) is Source.IMMEDIATE
        ahead = Ahead(policy).settle(TAIL_LOST, placement(plan(SPEC, TAIL_LOST, RUNNING).configuration))
        assert {one.now.down for one in ahead} >= {frozenset(), frozenset({"pe:tail_pe", "pe:sensor_pe"})}

    def test_none_is_looked_up_while_a_bus_is_limited(self) -> None:
        class Table(ContingencyTable):
            def __init__(self) -> None:
                """Know nothing: no plan may be looked up."""

            def plan(self, *_: object) -> NoReturn:
                raise AssertionError("its plans are for whole buses")

            find = plan

            def safe_mode(self, *_: object) -> None:
                """The buses carry nothing, so it is not legal."""

        policy = PlanningPolicy(SPEC, GREEDY, has_planner=True, contingencies=Table())
        none = Situation(TAIL_LOST.down, {"bus:can0": Fraction(0)})
        (answer,) = policy.step(RequestPlan(1, none, RUNNING))
        assert isinstance(answer, Answer)
        assert isinstance(answer.answer, PlanReady)
        found = answer.answer.plan
        assert found.now == none
        assert all(report.bits_per_s == 0 for report in found.buses.values())
        assert len(Ahead(policy).settle(none)) == len(SPEC.pes)

    def test_none_is_looked_up_beside_the_target_of_a_script(self) -> None:
        policy = PlanningPolicy(SPEC, GREEDY, has_planner=True, contingencies=table())
        assert source(policy, RequestPlan(7, TAIL_LOST, RUNNING)) is Source.CONTINGENCIES
        assert source(policy, RequestPlan(8, TAIL_LOST, RUNNING, target=Configuration())) is Source.IMMEDIATE


class TestPrePlanning:
    def test_each_loss_is_pre_planned_in_the_order_of_the_spec(self, ahead: Ahead) -> None:
        assert ahead.settle() == [Question(lost, RUNNING) for lost in LOSSES]
        assert all(ahead.knows(lost) for lost in LOSSES)

    def test_each_return_is_pre_planned_after_the_losses(self, ahead: Ahead) -> None:
        down = Situation(frozenset({"pe:tail_pe", "device:gps"}))
        plan_request = [one.now.down for one in ahead.settle(down)]
        assert plan_request[-1] == {"device:gps"}
        assert len(plan_request) == len(SPEC.pes)

    def test_the_next_phase_comes_last_and_the_last_phase_has_none(self) -> None:
        phases = "phases: {climb: {}, glide: {}, land: {}}\n"
        spec = loads(FILE.read_text().replace("functions:\n", f"{phases}functions:\n"), "phases.dg.yaml")
        ahead = Ahead(PlanningPolicy(spec, Greedy(spec), has_planner=True))
        assert ahead.settle(Situation(phase="climb"))[-1].now == Situation(phase="glide")
        assert {one.now.phase for one in ahead.settle(Situation(phase="land"))} == {"land"}

    def test_the_limits_of_the_moment_hold_ahead_too(self, ahead: Ahead) -> None:
        half = {"bus:can0": Fraction(1, 2)}
        assert all(one.now.limits == half for one in ahead.settle(Situation(limits=half)))
        assert ahead.knows(replace(TAIL_LOST, limits=half))
        assert not ahead.knows(TAIL_LOST)

    def test_a_plan_for_another_configuration_is_not_used(self, ahead: Ahead) -> None:
        ahead.settle()
        assert not ahead.knows(TAIL_LOST, {**RUNNING, "state_estimator": ("only", "sensor_pe")})

    def test_a_configuration_that_returns_is_not_pre_planned_again(self, ahead: Ahead) -> None:
        ahead.settle()
        without_gps = Situation(frozenset({"device:gps"}))
        assert len(ahead.settle(without_gps)) == len(LOSSES)
        assert ahead.settle() == []
        assert ahead.settle(without_gps) == []

    def test_the_plans_of_a_configuration_that_ran_long_ago_are_forgotten(self, ahead: Ahead) -> None:
        others = [Situation(limits={"bus:can0": Fraction(percent, 100)}) for percent in range(1, 20)]
        ahead.settle()
        for other in others[:3]:
            ahead.settle(other)
        assert ahead.knows(TAIL_LOST)
        assert ahead.settle() == []  # which makes it the latest one again
        for other in others[3:6]:
            ahead.settle(other)
        assert ahead.knows(TAIL_LOST)
        for other in others[6:]:
            ahead.settle(other)
        assert not ahead.knows(TAIL_LOST)

    def test_what_is_known_is_not_pre_planned_again(self, ahead: Ahead) -> None:
        ahead.settle()
        assert ahead.settle() == []
        assert ahead.knows(TAIL_LOST)

    def test_a_failure_is_left_out(self, ahead: Ahead) -> None:
        assert len(ahead.settle(plan=None)) == len(LOSSES)
        assert not ahead.knows(TAIL_LOST)

    def test_one_question_at_a_time_and_each_once(self, policy: PlanningPolicy) -> None:
        (first,) = policy.step(Settled(WELL, RUNNING))
        assert isinstance(first, PrePlan)
        assert policy.step(Settled(WELL, RUNNING)) == []
        plan_request = [first]
        while found := policy.step(PrePlannerAnswered(plan_request[-1].number, BEST)):
            plan_request += [one for one in found if isinstance(one, PrePlan)]
        assert [one.question.now for one in plan_request] == LOSSES

    def test_a_doubled_answer_is_dropped(self, policy: PlanningPolicy) -> None:
        (first,) = policy.step(Settled(WELL, RUNNING))
        assert isinstance(first, PrePlan)
        (second,) = policy.step(PrePlannerAnswered(first.number, BEST))
        assert isinstance(second, PrePlan)
        assert policy.step(PrePlannerAnswered(first.number, BEST)) == []
        assert source(policy, RequestPlan(1, second.question.now, RUNNING)) is Source.IMMEDIATE

    def test_an_answer_that_is_not_awaited_is_dropped(self, policy: PlanningPolicy) -> None:
        assert policy.step(PrePlannerAnswered(1, BEST)) == []

    def test_a_late_answer_is_kept_under_its_own_question(self, policy: PlanningPolicy) -> None:
        (first,) = policy.step(Settled(WELL, RUNNING))
        assert isinstance(first, PrePlan)
        policy.step(Settled(TAIL_LOST, {}))
        policy.step(PrePlannerAnswered(first.number, BEST))
        assert source(policy, RequestPlan(1, LOSSES[0], RUNNING)) is Source.PRE_PLANNED
        assert source(policy, RequestPlan(2, LOSSES[0], {})) is Source.IMMEDIATE

    def test_without_a_solver_nothing_is_pre_planned(self) -> None:
        assert PlanningPolicy(SPEC, GREEDY, has_planner=False).step(Settled(WELL, RUNNING)) == []
