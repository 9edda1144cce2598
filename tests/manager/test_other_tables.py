"""PEs fly with another table when a manager starts: it commands nothing until none of them does."""

import pytest

from heronry_manager import events
from heronry_manager.core.vocabulary import EnterPhase, FailElement, OperatorSaid, Order, PlanReady, Reply
from heronry_manager.planner.exact import plan
from heronry_wire.frame import Frame
from heronry_wire.protocol_times import START_UP_WINDOW_NS
from heronry_wire.state_frames import PeState, Reason, StatePage1
from manager.one_manager import MS, OneManager

EPOCH, DIGEST = 40, 0xABCDEF  # what the PEs run, from another spec


def refuse(manager: OneManager, pe: str, state: PeState = PeState.ACTIVE) -> None:
    """Let a PE refuse, for its digest, the slice that is being prepared."""
    told = manager.of(events.EpochPrepared)
    epoch = told[-1].epoch if told else 1
    page = StatePage1(state, manager.flags, epoch, 0, Reason.DIGEST, 0)
    manager.hear(Frame(manager.state_id(pe), page.encode()))


@pytest.fixture
def manager() -> OneManager:
    """A manager that has just started over PEs of which `left` and `right` fly what it does not know."""
    starting = OneManager()
    starting.live("left", PeState.ACTIVE, epoch=EPOCH, digest=DIGEST)
    starting.live("right", PeState.ACTIVE, epoch=EPOCH, digest=DIGEST)
    starting.live("middle")
    starting.pass_time(START_UP_WINDOW_NS)
    starting.answer()
    return starting


def order(manager: OneManager, said: Order) -> Reply:
    (reply,) = (action for action in manager.give(OperatorSaid(7, said)) if isinstance(action, Reply))
    return reply


def test_a_pe_that_flies_is_dropped_from_the_epoch_and_no_loss_is_held_against_it(manager: OneManager) -> None:
    refuse(manager, "left")
    assert manager.of(events.PeLost) == []
    assert manager.steps() == []
    assert order(manager, EnterPhase("glide")).sentence.startswith("left flies with another table, so nothing is")
    refuse(manager, "right")
    assert order(manager, EnterPhase("glide")).sentence.startswith("left, right fly with another table")


def test_what_others_have_staged_is_abandoned_while_one_flies(manager: OneManager) -> None:
    refuse(manager, "left")
    manager.stage("middle")
    manager.stage("right")
    (abandoned,) = manager.of(events.EpochAbandoned)
    assert abandoned.reason == "left flies with another table"
    assert manager.steps() == []


def test_a_plan_is_sought_again_when_the_last_of_them_is_given_up(manager: OneManager) -> None:
    refuse(manager, "left")
    manager.stage("middle")
    manager.stage("right")
    requests = len(manager.requests)
    assert order(manager, FailElement("device:servo_right")).done
    manager.pass_time(100 * MS)
    assert len(manager.requests) == requests
    assert order(manager, FailElement("pe:left")).done
    manager.pass_time(100 * MS)
    assert len(manager.requests) == requests + 1
    request = manager.requests[-1]
    manager.give(PlanReady(request.request, plan(manager.spec, request.now, request.running)))
    for pe in ("middle", "right"):
        manager.stage(pe)
    assert manager.steps() != []


def test_a_pe_that_runs_nothing_is_left_out_and_the_others_fly() -> None:
    manager = OneManager()
    for pe in manager.spec.pes:
        manager.live(pe)
    manager.pass_time(START_UP_WINDOW_NS)
    manager.answer()
    refuse(manager, "left", PeState.UNCONFIGURED)
    assert [told.pe for told in manager.of(events.PeLost)] == ["left"]
    assert "pe:left" in manager.requests[-1].now.down
