"""Which modules a PE stops while no manager is heard, and how they start again (`without_manager: safe_mode`)."""

from dataclasses import replace

from agent.one_pe import (
    BEAT_NS,
    CONTROL,
    DEMAND,
    FLYING,
    LEASE_NS,
    MONITOR,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_CONTROL,
    RUN_MONITOR,
    RUN_SERVO_1,
    SERVO_1,
    TABLE,
    OnePe,
    slice_messages,
    started,
    stopped,
)
from heronry_agent.core.vocabulary import StartFailed
from heronry_wire.configuration_slice import Slice
from heronry_wire.management import Activate, Alive, Lease, Step

WATCHED = Slice(
    (RUN_CONTROL, RUN_SERVO_1, RUN_MONITOR),
    remote={RATE: NEIGHBOUR},
    publish={DEMAND: 1},
    expendable=frozenset({MONITOR}),
)
ALL = {CONTROL: 0, SERVO_1: 0, MONITOR: 0}
CRITICAL = {CONTROL: 0, SERVO_1: 0}


def flying(wanted: Slice = WATCHED, step: Step = Step.GO_ALL) -> OnePe:
    pe = OnePe(replace(TABLE, without_manager="safe_mode"))
    pe.configure(wanted, 7, step)
    pe.fly(2 * BEAT_NS, epoch=7, digest=1007, step=step)
    return pe


def lease(step: Step = Step.GO_ALL, *, epoch: int = 7, term: int = 1) -> Lease:
    return Lease(term, epoch, step, 1000 + epoch if epoch else 0)


def alone(pe: OnePe) -> list:
    return pe.pass_time(2 * LEASE_NS)


def test_with_nothing_that_is_expendable_nothing_rests() -> None:
    pe = flying(replace(WATCHED, expendable=frozenset()))
    assert stopped(alone(pe)) == []
    assert pe.running == ALL


def test_a_command_that_is_no_lease_starts_nothing() -> None:
    pe = flying()
    alone(pe)
    actions = pe.command(Alive(1, 0, frozenset({NODE})), Activate(1, 7, Step.GO_ALL, 1007))
    assert started(actions) == []
    assert pe.running == CRITICAL


def test_a_new_configuration_starts_what_it_wants() -> None:
    pe = flying()
    alone(pe)
    pe.command(lease(), *slice_messages(replace(WATCHED, publish={}), 8, 1008))
    alone(pe)
    assert started(pe.command(Activate(1, 8, Step.BREAK, 1008))) == []
    assert pe.running == CRITICAL
    pe.command(lease(Step.GO_ALL, epoch=8))
    assert pe.running == ALL


def test_one_that_does_not_want_it_forgets_it() -> None:
    pe = flying()
    alone(pe)
    pe.command(lease(epoch=0), *slice_messages(FLYING, 8, 1008), Activate(1, 8, Step.GO_ALL, 1008))
    assert started(pe.command(lease(epoch=8))) == []
    assert pe.running == CRITICAL


def test_what_has_failed_is_not_started_by_a_lease() -> None:
    pe = flying()
    pe.give(StartFailed(MONITOR, "broken"))
    assert stopped(alone(pe)) == []
    assert started(pe.command(lease())) == []


def test_at_break_what_stays_rests_and_comes_back_at_break() -> None:
    pe = flying()
    pe.command(*slice_messages(replace(WATCHED, publish={}), 8, 1008), Activate(1, 8, Step.BREAK, 1008))
    assert stopped(alone(pe)) == [MONITOR]
    assert started(pe.command(lease(Step.BREAK, epoch=8))) == [MONITOR]
    pe.command(lease(Step.GO_ALL, epoch=8))
    assert pe.running == ALL
