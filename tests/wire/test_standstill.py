"""Standstills: what is late by more than a quarter period and not by its own work, and which of them are told."""

import pytest

from heronry_wire.standstill import TELL_AGAIN_NS, LatenessMeter, Standstills, StoodStill

MS = 1_000_000
PERIOD = 20 * MS


@pytest.mark.parametrize(
    ("due_ms", "woke_ms", "used_ms", "stood_still_ms"),
    [
        (10, 10, 0, None),  # in time
        (10, 3, 0, None),  # early: a frame has come
        (10, 15, 0, None),  # late by the slack
        (10, 150, 0, 140),
        (10, 150, 100, 40),  # most of it is the process's own work
        (10, 150, 140, None),
        (0, 150, 0, 150),
        (None, 150, 0, None),  # nothing was due
    ],
)
def test_a_wake_up(due_ms: int | None, woke_ms: int, used_ms: int, stood_still_ms: int | None) -> None:
    meter = LatenessMeter(PERIOD, 0, 5 * MS)
    meter.waits(None if due_ms is None else due_ms * MS, 0)
    found = meter.woke(woke_ms * MS, (5 + used_ms) * MS)
    assert found == (None if stood_still_ms is None else StoodStill(stood_still_ms * MS))


def test_processor_time_counts_since_the_last_wake_up() -> None:
    meter = LatenessMeter(PERIOD, 0, 0)
    meter.waits(0, 0)
    assert meter.woke(100 * MS, 100 * MS) is None
    meter.waits(100 * MS, 100 * MS)
    assert meter.woke(200 * MS, 110 * MS) == StoodStill(90 * MS)


def test_who_is_stopped_while_it_works_is_late_too_and_has_a_new_deadline_by_then() -> None:
    meter = LatenessMeter(PERIOD, 0, 0)
    meter.waits(10 * MS, 0)
    assert meter.woke(10 * MS, 0) is None
    meter.waits(530 * MS, 512 * MS)  # 2 ms of its own work
    assert meter.woke(530 * MS, 2 * MS) == StoodStill(500 * MS)
    meter.waits(550 * MS, 532 * MS)
    assert meter.woke(540 * MS, 4 * MS) is None


def test_before_the_first_wait_nothing_is_late() -> None:
    assert LatenessMeter(PERIOD, 0, 0).woke(100 * MS, 0) is None


def test_every_standstill_is_counted_and_few_are_told() -> None:
    count = Standstills(PERIOD)
    told = [count.count(StoodStill(ms * MS), at * MS) for ms, at in ((6, 0), (30, 1), (30, 2), (31, 3), (25, 4))]
    assert told == [False, True, False, True, False]
    assert count.count(StoodStill(25 * MS), 3 * MS + TELL_AGAIN_NS)
    assert (count.times, count.long_times, count.last_long_ns, count.longest_ns) == (6, 5, 25 * MS, 31 * MS)
