"""Every PE is retired in flight and restored: all oracles watch, no PE is lost, and no function that can be kept."""

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager import events
from heronry_manager.core.vocabulary import RestoreElement, RetireElement
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
