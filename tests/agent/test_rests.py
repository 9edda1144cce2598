"""Break before make with devices that come to rest later than their modules stop: BROKEN is told when they have."""

from dataclasses import replace

import pytest

from agent.one_pe import (
    FLYING,
    LEASE_NS,
    MS,
    NEIGHBOUR,
    NODE,
    RUN_CONTROL,
    RUN_SERVO_1,
    RUN_SERVO_2,
    SERVO_1,
    SERVO_2,
    OnePe,
    pages,
    stopped,
)
from heronry_agent.core.vocabulary import AtRest, Note, StepFailed, StepModule
from heronry_wire.management import Activate, Alive, Step
from heronry_wire.state_frames import PeState

WITHOUT, OTHER, BOTH = (
    replace(FLYING, modules=(RUN_CONTROL, *branches)) for branches in ((), (RUN_SERVO_2,), (RUN_SERVO_1, RUN_SERVO_2))
)


@pytest.fixture
def pe() -> OnePe:
    """A PE that drives a branch, whose devices are slow."""
    pe = OnePe(slow_to_rest=frozenset({SERVO_1, SERVO_2}))
    pe.configure(FLYING, 7)
    assert reported(pe) == (PeState.ACTIVE, 7, 1007)
    return pe


def reported(pe: OnePe) -> tuple[PeState, int, int]:
    page = pe.ask()[0]
    return page.state, page.epoch, page.digest


def stays_named(pe: OnePe, duration_ns: int) -> None:
    """Let time pass, in which the manager names this PE."""
    pe.command(Alive(1, 0, frozenset({NEIGHBOUR, NODE})))
    pe.pass_time(duration_ns)


def test_broken_is_told_when_the_device_is_at_rest_and_at_once(pe: OnePe) -> None:
    assert stopped(pe.configure(WITHOUT, 8, Step.BREAK)) == [SERVO_1]
    assert reported(pe) == (PeState.ACTIVE, 7, 1007), "as if BREAK had not come"
    assert [page.state for page in pages(pe.give(AtRest(SERVO_1)))] == [PeState.BROKEN]
    assert reported(pe) == (PeState.BROKEN, 8, 1008)
    assert pages(pe.give(AtRest(SERVO_1))) == [], "doubled"


def test_the_wait_for_one_that_hangs_ends_with_t_lease_and_is_noted(pe: OnePe) -> None:
    pe.configure(WITHOUT, 8, Step.BREAK)
    pe.pass_time(LEASE_NS - MS)
    assert reported(pe) == (PeState.ACTIVE, 7, 1007)
    actions = pe.pass_time(2 * MS)
    assert {page.state for page in pages(actions)} == {PeState.BROKEN}
    assert Note("output", "the device of module servo_1 does not come to rest") in actions
    assert pages(pe.give(AtRest(SERVO_1))) == [], "late"


def test_all_steps_in_one_are_told_when_the_device_is_at_rest(pe: OnePe) -> None:
    pe.configure(WITHOUT, 8)
    assert reported(pe) == (PeState.ACTIVE, 7, 1007)
    pe.give(AtRest(SERVO_1))
    assert reported(pe) == (PeState.ACTIVE, 8, 1008)


def test_another_branch_on_this_pe_waits(pe: OnePe) -> None:
    pe.configure(OTHER, 8)
    pe.steps.clear()
    stays_named(pe, 50 * MS)
    assert SERVO_2 not in pe.steps
    pe.give(AtRest(SERVO_1))
    stays_named(pe, 50 * MS)
    assert SERVO_2 in pe.steps


def test_a_module_that_fails_and_starts_again_delays_nothing(pe: OnePe) -> None:
    pe.fly(50 * MS, epoch=7, digest=1007)
    release = next(a.release for _, a in reversed(pe.done) if isinstance(a, StepModule) and a.module == SERVO_1)
    pe.give(StepFailed(SERVO_1, release, "it raised"))
    pe.command(Activate(1, 7, Step.GO_ALL, 1007))
    assert reported(pe) == (PeState.ACTIVE, 7, 1007)


def test_two_devices_are_awaited(pe: OnePe) -> None:
    pe.configure(BOTH, 8)
    pe.configure(WITHOUT, 9, Step.BREAK)
    assert pages(pe.give(AtRest(SERVO_2))) == []
    assert reported(pe) == (PeState.ACTIVE, 8, 1008)
    pe.give(AtRest(SERVO_1))
    assert reported(pe) == (PeState.BROKEN, 9, 1009)


def test_a_branch_that_comes_back_before_it_was_at_rest_is_not_awaited(pe: OnePe) -> None:
    pe.configure(WITHOUT, 8, Step.BREAK)
    pe.configure(FLYING, 9)
    assert reported(pe) == (PeState.ACTIVE, 9, 1009)
