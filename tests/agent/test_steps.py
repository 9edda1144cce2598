"""How a configuration takes over from the one before, step by step, and what is lost or doubled on the way."""

from agent.one_pe import (
    CONTROL,
    FLYING,
    MONITOR,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_CONTROL,
    RUN_MONITOR,
    RUN_SERVO_1,
    RUN_SERVO_2,
    SERVO_1,
    SERVO_2,
    OnePe,
    pages,
    slice_messages,
    started,
    stopped,
)
from heronry_agent.core.vocabulary import StartFailed
from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.management import Activate, Alive, Lease, Step
from heronry_wire.state_frames import PeState, StatePage0

OTHER_BRANCH = Slice((RUN_CONTROL, RUN_SERVO_2, RUN_MONITOR), remote={RATE: NEIGHBOUR})
BLIND = Slice((ModuleSlice(CONTROL, 1, ()), RUN_SERVO_1))


def states(actions: list) -> list[PeState]:
    return [page.state for page in pages(actions) if isinstance(page, StatePage0)]


def test_one_go_all_takes_everything_and_says_active_once() -> None:
    pe = OnePe()
    actions = pe.configure(FLYING, 7)
    assert pe.running == {CONTROL: 0, SERVO_1: 0}
    assert states(actions) == [PeState.ACTIVE]
    page = pe.ask()[0]
    assert (page.epoch, page.digest) == (7, 1007)


def test_a_branch_moves_break_go_go_all() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    pe.command(*slice_messages(OTHER_BRANCH, 8, 1008))

    broken = pe.command(Activate(1, 8, Step.BREAK, 1008))
    assert (stopped(broken), started(broken), states(broken)) == ([SERVO_1], [], [PeState.BROKEN])
    assert pe.running == {CONTROL: 0}

    partial = pe.command(Activate(1, 8, Step.GO, 1008))
    assert (started(partial), states(partial)) == ([MONITOR], [PeState.PARTIAL])

    active = pe.command(Activate(1, 8, Step.GO_ALL, 1008))
    assert (started(active), states(active)) == ([SERVO_2], [PeState.ACTIVE])


def test_a_step_taken_is_not_taken_again_and_never_goes_back() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    for step in Step:
        assert pe.command(Activate(1, 7, step, 1007)) == []
        assert pe.command(Lease(1, 7, step, 1007)) == []


def test_a_lost_activate_is_made_up_by_lease() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    pe.command(*slice_messages(OTHER_BRANCH, 8, 1008))
    assert states(pe.command(Lease(1, 8, Step.PREPARED, 1008))) == []
    assert states(pe.command(Lease(1, 8, Step.BREAK, 1008))) == [PeState.BROKEN]
    assert states(pe.command(Lease(1, 8, Step.BREAK, 1008))) == []
    assert states(pe.command(Lease(1, 8, Step.GO_ALL, 1008))) == [PeState.ACTIVE]


def test_the_same_lease_works_once_the_slice_has_come() -> None:
    pe = OnePe()
    lease = Lease(1, 7, Step.GO_ALL, 1007)
    assert states(pe.command(lease)) == []
    pe.command(*slice_messages(FLYING, 7, 1007))
    assert states(pe.command(lease)) == [PeState.ACTIVE]


def test_a_branch_that_stays_is_not_held() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    both = Slice((RUN_CONTROL, RUN_SERVO_1, RUN_MONITOR), remote={RATE: NEIGHBOUR})
    pe.command(*slice_messages(both, 8, 1008))
    assert states(pe.command(Activate(1, 8, Step.GO, 1008))) == [PeState.ACTIVE]
    assert pe.running.keys() == {CONTROL, SERVO_1, MONITOR}


def test_a_branch_held_under_one_epoch_is_held_again_under_the_next() -> None:
    pe = OnePe()
    pe.configure(OTHER_BRANCH, 7, Step.GO)
    assert SERVO_2 not in pe.running
    pe.command(*slice_messages(FLYING, 8, 1008), Activate(1, 8, Step.GO, 1008))
    pe.command(*slice_messages(OTHER_BRANCH, 9, 1009))
    assert states(pe.command(Activate(1, 9, Step.GO, 1009))) == [PeState.PARTIAL]
    assert SERVO_2 not in pe.running


def test_a_new_mode_stops_at_break_and_is_built_anew_at_go() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    pe.command(*slice_messages(BLIND, 8, 1008))
    assert stopped(pe.command(Activate(1, 8, Step.BREAK, 1008))) == [CONTROL]
    assert started(pe.command(Activate(1, 8, Step.GO, 1008))) == [CONTROL]
    assert pe.running == {CONTROL: 1, SERVO_1: 0}


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


def test_the_load_is_that_of_the_modules_that_run() -> None:
    pe = OnePe()
    assert pe.ask()[1].load == 0
    pe.configure(FLYING, 7)
    assert pe.ask()[1].load == 40


def test_an_unknown_configuration_changes_nothing_here() -> None:
    pe = OnePe()
    pe.command(Alive(1, 0, frozenset({NODE})))
    assert pe.command(Activate(1, 9, Step.GO_ALL, 9)) == []
    assert pe.ask()[0].state is PeState.UNCONFIGURED
