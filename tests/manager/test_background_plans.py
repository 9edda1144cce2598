"""A plan that was made immediately flies first; then the best plan is requested, and taken if it is better."""

from dataclasses import replace

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.objective import placement, score
from heronry_dg.plan import Plan, make_plan
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, Settled
from heronry_manager.planner.exact import plan
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import PLAN_AGAIN_NS
from heronry_wire.state_frames import PeState
from manager.one_manager import MS, OneManager

LEFT_SERVO_FAILED = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 0)


def fly(manager: OneManager, made: Plan) -> None:
    """Answer the last request with a plan, and let every PE run it."""
    manager.give(PlanReady(manager.requests[-1].request, made))
    for pe in manager.spec.pes:
        manager.stage(pe)
    for pe in manager.spec.pes:
        manager.take(pe, PeState.ACTIVE)


def best(manager: OneManager) -> Plan:
    request = manager.requests[-1]
    return plan(manager.spec, Situation(request.now.down), request.running)


def as_good(manager: OneManager) -> Plan:
    """A plan made immediately that happens to be the best."""
    return replace(best(manager), optimal=False)


def nothing_at_all(manager: OneManager) -> Plan:
    """A plan made immediately that is legal, and no more than that."""
    now = Situation(manager.requests[-1].now.down)
    objective = score(manager.spec, now, Configuration(), None)
    return make_plan(manager.spec, now, Configuration(), objective, optimal=False)


@pytest.fixture
def manager() -> OneManager:
    one = OneManager()
    one.start(fly=False)
    return one


def test_a_best_plan_that_is_no_better_where_it_counts_interrupts_nothing(manager: OneManager) -> None:
    made = as_good(manager)
    fly(manager, made)
    request = manager.requests[-1]
    assert request.in_background
    assert request.running == placement(made.configuration)
    elsewhere = replace(made, objective=replace(made.objective, changes=0, bus_mbit_per_s=0, cpu_millis=0))
    actions = manager.give(PlanReady(request.request, elsewhere))
    assert isinstance(manager.events[-1], events.PlanKept)
    assert [type(action) for action in actions if isinstance(action, Settled)] == [Settled]
    assert len(manager.of(events.EpochPrepared)) == 1
    assert manager.requests[-1] is request


def test_a_better_one_takes_the_place_of_what_runs(manager: OneManager) -> None:
    fly(manager, nothing_at_all(manager))
    assert manager.last(events.PlanRequested).causes == ("a better plan",)
    fly(manager, best(manager))
    told = manager.last(events.Reconfigured)
    assert told.causes == ("a better plan",)
    assert "control" in told.started
    assert len(manager.requests) == 2  # it is the best: there is no further request


def test_better_inputs_alone_are_worth_it_too(manager: OneManager) -> None:
    made = as_good(manager)
    fly(manager, made)
    supplied = replace(made, objective=replace(made.objective, inputs=made.objective.inputs + 1), optimal=True)
    manager.give(PlanReady(manager.requests[-1].request, supplied))
    assert isinstance(
        manager.events[-1], events.PlanUnchanged
    )  # taken; and as it happens nothing has to be done for it


def test_the_best_plan_is_requested_once_even_if_the_answer_is_not_proven_either(manager: OneManager) -> None:
    fly(manager, nothing_at_all(manager))
    fly(manager, as_good(manager))
    assert [request.in_background for request in manager.requests] == [False, True]


def test_a_fault_meanwhile_makes_the_answer_stale(manager: OneManager) -> None:
    fly(manager, nothing_at_all(manager))
    late, answer = manager.requests[-1], best(manager)
    manager.report("left", LEFT_SERVO_FAILED)
    assert not manager.requests[-1].in_background
    assert manager.last(events.PlanRequested).causes == ("device:servo_left failed, reported by left",)
    manager.give(PlanReady(late.request, answer))
    assert len(manager.of(events.EpochPrepared)) == 1
    fly(manager, as_good(manager))
    assert manager.requests[-1].in_background


def test_a_failure_leads_to_no_second_request(manager: OneManager) -> None:
    fly(manager, as_good(manager))
    request = manager.requests[-1]
    actions = manager.give(PlanFailed(request.request, "it was killed"))
    assert any(isinstance(action, Settled) for action in actions)
    manager.pass_time(PLAN_AGAIN_NS + 100 * MS)
    assert manager.requests[-1] is request
    assert manager.give(PlanFailed(request.request, "it was killed")) == []
