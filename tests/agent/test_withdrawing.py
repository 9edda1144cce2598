"""Waiting data frames of a module that moves away must not be sent after the report that the module has stopped."""

from agent.one_pe import DEMAND_ID, FLYING, NEIGHBOUR, NODE, RUN_SERVO_1, OnePe, neighbour_state
from heronry_agent.core.vocabulary import Action
from heronry_wire.configuration_slice import Slice
from heronry_wire.management import Activate, Alive, Lease, Step
from heronry_wire.sansio import Withdraw

WITHOUT_CONTROL = Slice((RUN_SERVO_1,), remote={1: 94})


def allowed() -> OnePe:
    """A PE that may send under identifiers that another PE could have."""
    pe = OnePe()
    pe.configure(FLYING, epoch=1)
    assert not withdrawn(pe.command(Alive(1, 1, frozenset({NEIGHBOUR, NODE}))))
    return pe


def withdrawn(actions: list[Action]) -> set[int]:
    return {identifier for action in actions if isinstance(action, Withdraw) for identifier in action.identifiers}


# The transmission of a PE has failed: frames made while it was authorized must not go out when it is heard again.


def test_what_waits_is_withdrawn_when_another_pe_runs_a_newer_epoch() -> None:
    pe = allowed()
    assert not withdrawn(pe.hear(neighbour_state(1, 1001)))
    assert withdrawn(pe.hear(neighbour_state(2))) == {DEMAND_ID}
    assert not withdrawn(pe.hear(neighbour_state(3)))


def test_what_waits_is_withdrawn_when_a_configuration_runs_without_us() -> None:
    assert withdrawn(allowed().command(Activate(1, 2, Step.GO_ALL, 7))) == {DEMAND_ID}


def test_what_waits_is_withdrawn_when_the_manager_means_something_else_by_our_epoch() -> None:
    assert withdrawn(allowed().command(Lease(1, 1, Step.GO_ALL, 7))) == {DEMAND_ID}


def test_a_pe_without_movable_modules_withdraws_nothing() -> None:
    pe = OnePe()
    pe.configure(WITHOUT_CONTROL, epoch=1)
    pe.command(Alive(1, 1, frozenset({NEIGHBOUR, NODE})))
    assert not withdrawn(pe.command(Alive(1, 2, frozenset({NEIGHBOUR}))))
