"""Mastership: its state changes only by the table of transitions, and `validate` notices any other change."""

from enum import Enum, auto

import pytest

from heronry_manager.core.mastership.claim import MASTERSHIP_TRANSITIONS, Claim, Mastership, MastershipEvent
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.tables.compilation import Compiler
from heronry_manager.core.transitions import TransitionTable
from heronry_manager.core.turn import Turn
from heronry_wire.management import Lease, Step
from heronry_wire.sansio import InvariantError
from manager.one_manager import MS, OneManager, two_tails

LEASE_NS = 100 * MS


class Door(Enum):
    OPEN = auto()
    SHUT = auto()


class Push(Enum):
    OPENS = auto()
    SHUTS = auto()


DOOR = TransitionTable({Door.SHUT: "built so"}, ((Door.SHUT, Push.OPENS, Door.OPEN, "it was pushed"),))


def claim(*, node: int = 126, standby: bool = False) -> tuple[Turn, Claim]:
    turn = Turn(node, 0, term=1)
    return turn, Claim(ManagerSettings(two_tails(), Compiler(two_tails()), node, standby=standby), turn)


def test_a_table_leads_where_its_rows_say_and_nowhere_else() -> None:
    assert DOOR.after(Door.SHUT, Push.OPENS) is Door.OPEN
    with pytest.raises(InvariantError, match="SHUTS cannot happen in state SHUT"):
        DOOR.after(Door.SHUT, Push.SHUTS)


def test_a_table_knows_by_which_event_a_state_is_reached() -> None:
    assert DOOR.may_be(Door.SHUT, None)
    assert not DOOR.may_be(Door.OPEN, None)
    assert DOOR.may_be(Door.OPEN, Push.OPENS)
    assert not DOOR.may_be(Door.SHUT, Push.OPENS)


def test_for_each_state_and_event_there_is_one_row_of_mastership() -> None:
    assert len({(before, event) for before, event, _, _ in MASTERSHIP_TRANSITIONS.rows}) == len(
        MASTERSHIP_TRANSITIONS.rows
    )
    assert {before for before, _, _, _ in MASTERSHIP_TRANSITIONS.rows} == {*Mastership} - {Mastership.RETIRED}
    assert {event for _, event, _, _ in MASTERSHIP_TRANSITIONS.rows} == {*MastershipEvent}


def test_a_state_that_was_not_reached_by_the_table_is_noticed() -> None:
    turn, one = claim()
    one.validate()
    turn.now_ns = LEASE_NS
    assert one.may_begin()
    assert one.begin_term()
    one.validate()
    one.state = Mastership.RETIRED
    with pytest.raises(InvariantError, match="RETIRED was reached by"):
        one.validate()


def test_the_second_manager_stands_by_where_it_hears_no_other() -> None:
    turn, one = claim(node=127, standby=True)
    turn.now_ns = LEASE_NS
    assert not one.may_begin()
    assert one.state is Mastership.STANDBY


def test_an_active_manager_does_not_give_way_to_a_lower_term() -> None:
    turn, one = claim(standby=True)
    turn.now_ns = LEASE_NS
    assert one.begin_term()
    assert not one.gives_way_to(127, Lease(turn.term - 1, 0, Step.PREPARED, 0))
    assert one.gives_way_to(127, Lease(turn.term + 1, 0, Step.PREPARED, 0))
    assert one.state is Mastership.STANDBY


def test_a_manager_that_only_listens_has_no_epoch() -> None:
    manager = OneManager()
    manager.start()
    manager.core._claim.state, manager.core._claim._last_event = Mastership.LISTENING, None
    with pytest.raises(InvariantError, match="a manager that is not active has an epoch"):
        manager.core.validate()
