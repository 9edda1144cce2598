"""Data that waits to be sent when its module goes elsewhere must not follow the word that it has stopped."""

from agent.one_pe import DEMAND_ID, FLYING, RUN_SERVO_1, OnePe
from heronry_agent.vocabulary import Action
from heronry_wire.configuration_slice import Slice
from heronry_wire.identifiers import state_id
from heronry_wire.management import Alive, Step
from heronry_wire.sansio import Send, Withdraw

WITHOUT_CONTROL = Slice((RUN_SERVO_1,), remote={1: 94})
NODE_STATE = state_id(93)


def position(actions: list[Action], wanted: type[Action]) -> int:
    """Place of the first withdrawal, or of the first state frame."""
    for place, action in enumerate(actions):
        if isinstance(action, wanted) and (not isinstance(action, Send) or action.frame.can_id == NODE_STATE):
            return place
    raise AssertionError(f"no {wanted.__name__} in {actions}")


def test_what_is_published_no_longer_is_withdrawn_before_the_pe_reports_broken() -> None:
    pe = OnePe()
    pe.configure(FLYING, epoch=1)
    actions = pe.configure(WITHOUT_CONTROL, epoch=2, step=Step.BREAK)
    assert Withdraw(frozenset({DEMAND_ID})) in actions
    after_activation = actions[position(actions, Withdraw) :]
    assert position(after_activation, Send) > 0


def test_what_stays_published_is_not_withdrawn() -> None:
    pe = OnePe()
    pe.configure(FLYING, epoch=1)
    assert not [action for action in pe.configure(FLYING, epoch=2) if isinstance(action, Withdraw)]


def test_what_waits_is_withdrawn_when_the_manager_counts_on_us_no_more() -> None:
    """A PE that hears and is not heard: what it made while it was allowed to must not go out when it is heard again."""
    pe = OnePe()
    pe.configure(FLYING, epoch=1)
    assert not [action for action in pe.command(Alive(1, 1, frozenset({92, 93}))) if isinstance(action, Withdraw)]
    assert Withdraw(frozenset({DEMAND_ID})) in pe.command(Alive(1, 2, frozenset({92})))
