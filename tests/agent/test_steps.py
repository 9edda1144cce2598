"""How a configuration replaces the one before, step by step, with commands lost and doubled."""

from agent.one_pe import (
    CONTROL,
    FLYING,
    NEIGHBOUR,
    RATE,
    RUN_CONTROL,
    RUN_MONITOR,
    RUN_SERVO_2,
    SERVO_1,
    SERVO_2,
    OnePe,
    pages,
    slice_messages,
    started,
)
from heronry_agent.core.vocabulary import StartFailed
from heronry_wire.configuration_slice import Slice
from heronry_wire.identifiers import state_id
from heronry_wire.management import Activate, Lease, Step
from heronry_wire.state_frames import PeState, StatePage0

OTHER_BRANCH = Slice((RUN_CONTROL, RUN_SERVO_2, RUN_MONITOR), remote={RATE: NEIGHBOUR})


def states(actions: list) -> list[PeState]:
    return [page.state for page in pages(actions) if isinstance(page, StatePage0)]


def test_the_same_lease_works_once_the_slice_has_come() -> None:
    pe = OnePe()
    lease = Lease(1, 7, Step.GO_ALL, 1007)
    assert states(pe.command(lease)) == []
    pe.command(*slice_messages(FLYING, 7, 1007))
    assert states(pe.command(lease)) == [PeState.ACTIVE]


def test_a_branch_held_under_one_epoch_is_held_again_under_the_next() -> None:
    pe = OnePe()
    pe.configure(OTHER_BRANCH, 7, Step.GO)
    assert SERVO_2 not in pe.running
    pe.command(*slice_messages(FLYING, 8, 1008), Activate(1, 8, Step.GO, 1008))
    pe.command(*slice_messages(OTHER_BRANCH, 9, 1009))
    assert states(pe.command(Activate(1, 9, Step.GO, 1009))) == [PeState.PARTIAL]
    assert SERVO_2 not in pe.running


def test_a_skipped_epoch_does_no_harm() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    pe.command(*slice_messages(OTHER_BRANCH, 8, 1008), Activate(1, 8, Step.BREAK, 1008))
    pe.configure(FLYING, 9)
    assert pe.running == {CONTROL: 0, SERVO_1: 0}
    assert pe.ask()[0].state is PeState.ACTIVE


def test_a_module_that_cannot_be_built_is_tried_again_by_the_next_epoch_only() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7, Step.GO)
    pe.give(StartFailed(CONTROL, "no memory"))
    assert started(pe.command(Activate(1, 7, Step.GO_ALL, 1007))) == [SERVO_1]
    pe.configure(FLYING, 8)
    assert pe.running == {CONTROL: 0, SERVO_1: 0}


def test_a_pe_takes_other_identifiers_once_it_runs_something_else() -> None:
    pe = OnePe()
    before = pe.core.identifiers
    assert state_id(NEIGHBOUR) in before
    assert pe.core.identifiers is before
    pe.configure(FLYING, 1)
    assert pe.core.identifiers is not before
