"""Every PE is retired in flight and restored: all oracles watch, no PE is lost, and no function that can be kept."""

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager import events
from heronry_manager.core.vocabulary import RestoreElement, RetireElement
from heronry_tools.sim.flight.simulation import Simulation
from scenarios.flights import flying

SPEC = load(shipped_spec_path("elevator_and_chute"))


@pytest.mark.parametrize("pe", SPEC.pes)
def test_a_pe_is_retired_and_restored_in_flight(pe: str) -> None:
    simulation = flying(SPEC)
    before = simulation.events_of(events.Reconfigured)
    reply = simulation.operator.say(RetireElement(f"pe:{pe}"))
    assert reply is not None
    assert reply.done, reply.sentence
    assert simulation.settle() == []
    retired = simulation.events_of(events.Reconfigured)[len(before) :]
    assert retired[0].causes == (f"pe:{pe} retired by the operator",)
    reply = simulation.operator.say(RestoreElement(f"pe:{pe}"))
    assert reply is not None
    assert reply.done, reply.sentence
    assert simulation.settle() == []
    assert not simulation.events_of(events.PeLost)


def served(simulation: Simulation) -> set[str]:
    plan = simulation.events_of(events.PlanReady)[-1].plan
    return {name for name, function in plan.functions.items() if function.served}


@pytest.mark.soak
def test_no_output_of_a_function_that_the_next_plan_serves_is_missed_when_a_pe_of_big_blue_is_retired() -> None:
    big_blue = load(shipped_spec_path("big_blue"))
    simulation = flying(big_blue)
    story = [("ground", "comms")] + [(pe,) for pe in big_blue.pes if pe not in ("ground", "comms")]
    for pes in story:  # the gateway after the PE behind it
        orders = [RetireElement(f"pe:{pe}") for pe in pes] + [RestoreElement(f"pe:{pe}") for pe in reversed(pes)]
        for order in orders:
            before, began_ns = served(simulation), simulation.now_ns
            reply = simulation.operator.say(order)
            assert reply is not None
            assert reply.done, reply.sentence
            simulation.run_for(2_000_000_000)
            kept = before & served(simulation)
            outages = simulation.witness.outages(simulation.now_ns)
            assert [one for one in outages if one.from_ns >= began_ns and one.function in kept] == []
    assert simulation.settle() == []
    assert not simulation.events_of(events.PeLost)
