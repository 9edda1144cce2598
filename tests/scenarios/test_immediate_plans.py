"""Faults that were not pre-planned: the greedy plan flies immediately, and is replaced if the best one is worth it."""

import pytest

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.planning import Planners, best_plan
from scenarios.flights import MS, big_blue, elevator_and_chute, flying, times_are_told, two_tails


def critical_and_utility(simulation: Simulation) -> tuple[object, object]:
    objective = simulation.events_of(events.PlanReady)[-1].plan.objective
    return objective.critical, objective.utility


@pytest.mark.parametrize("planners", [Planners.IMMEDIATE, Planners.GREEDY, Planners.ALL], ids=lambda one: one.name)
@pytest.mark.parametrize("spec", [elevator_and_chute(), two_tails()], ids=lambda spec: spec.name)
def test_every_pe_may_be_lost_and_come_back(spec: Spec, planners: Planners) -> None:
    for seed, pe in enumerate(spec.pes):
        simulation = flying(spec, seed, planners=planners)
        simulation.fleet.kill(pe)
        simulation.run_for(400 * MS)
        assert list(simulation.settle()) == [], pe
        simulation.fleet.restore(pe)
        simulation.run_for(400 * MS)
        assert list(simulation.settle()) == [], pe
        times_are_told(simulation)


def test_the_whole_aircraft_without_its_flight_computer_ends_with_the_best_plan() -> None:
    simulation = flying(big_blue(), planners=Planners.IMMEDIATE)
    simulation.fleet.kill("flight")
    simulation.run_for(600 * MS)
    assert list(simulation.settle()) == []
    first = simulation.events_of(events.Reconfigured)[1]
    assert first.causes == ("pe:flight: silent for 3 heartbeat periods",)
    assert first.times_ns.decide < 5 * MS


@pytest.mark.soak
def test_the_whole_aircraft_flies_without_a_solver() -> None:
    """Level 3 of the objective may fall short of the best plan: no other level may."""
    simulation = Simulation(big_blue(), planners=Planners.GREEDY)
    simulation.run_for(2_000 * MS)
    simulation.fleet.kill("flight")
    violations = simulation.settle()
    assert {violation.rule for violation in violations} <= {"optimal"}
    best = best_plan(big_blue(), simulation.truth.situation, None).objective
    assert critical_and_utility(simulation) == (dict(zip("ABCD", best.critical, strict=True)), best.utility)


def test_a_plan_of_the_pre_planner_flies_immediately() -> None:
    """With the planners of a real flight: the loss of a PE is pre-planned, and its plan is the best one."""
    simulation = flying(elevator_and_chute(), planners=Planners.ALL)
    simulation.run_for(1_000 * MS)
    simulation.fleet.kill("tail_pe")
    simulation.run_for(600 * MS)
    assert list(simulation.settle()) == []
    told = simulation.events_of(events.PlanReady)[-1]
    assert told.plan.down == ("pe:tail_pe",)
    assert told.plan.optimal
    assert told.decide_ns < MS


def test_a_fault_while_the_best_plan_is_computed_has_an_immediate_plan() -> None:
    simulation = flying(big_blue(), planners=Planners.IMMEDIATE, decide_ns=200 * MS)
    simulation.fleet.kill("flight")
    while not simulation.events_of(events.Reconfigured)[1:]:
        simulation.run_for(5 * MS)
    assert simulation.events_of(events.PlanRequested)[-1].causes == ("a better plan",)
    simulation.fleet.kill("payload")
    simulation.run_for(90 * MS)
    assert simulation.events_of(events.Reconfigured)[-1].causes == ("pe:payload: silent for 3 heartbeat periods",)
    simulation.run_for(600 * MS)
    assert list(simulation.settle()) == []
