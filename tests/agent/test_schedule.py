"""A partition receives all due steps; chains pass values within the instant; a late module delays its partition."""

from agent.one_pe import MS
from heronry_agent.core.modules.schedule import Schedule
from heronry_agent.core.step_times import HUNG_NS
from heronry_wire.sansio import NEVER_NS

PRODUCER, CONSUMER, THIRD = 1, 2, 3
PERIOD_NS = 25 * MS
PATIENCE_NS = PERIOD_NS // 4


def chained() -> Schedule:
    schedule = Schedule()
    schedule.start(PRODUCER, 40_000, 0, "one")
    schedule.start(CONSUMER, 40_000, 0, "two")
    schedule.chain({CONSUMER: frozenset({PRODUCER})})
    return schedule


def begun(schedule: Schedule, now_ns: int) -> list[tuple[int, int]]:
    """Begin all due modules; gives modules and releases."""
    return [(module, schedule.begin(module, now_ns)) for module in schedule.due(now_ns)]


def test_modules_that_are_due_begin_together_in_the_order_of_the_spec() -> None:
    schedule = Schedule()
    for module, partition in ((CONSUMER, "two"), (THIRD, "one"), (PRODUCER, "one")):
        schedule.start(module, 40_000, 0, partition)
    assert [module for module, _ in begun(schedule, 0)] == [PRODUCER, CONSUMER, THIRD]


def test_a_partition_that_has_not_answered_everything_is_asked_for_nothing_else() -> None:
    schedule = Schedule()
    schedule.start(PRODUCER, 40_000, 0, "one")
    schedule.start(CONSUMER, 40_000, 0, "one")
    schedule.start(THIRD, 40_000, 1 * MS, "one")
    (first, second) = begun(schedule, 0)
    assert schedule.end(*first, 0)
    assert begun(schedule, 1 * MS) == []
    assert schedule.end(*second, 0)
    assert [module for module, _ in begun(schedule, 1 * MS)] == [THIRD]


def test_a_consumer_waits_for_its_producer_in_its_own_partition_too() -> None:
    schedule = Schedule()
    for module in (PRODUCER, CONSUMER, THIRD):
        schedule.start(module, 40_000, 0, "one")
    schedule.chain({CONSUMER: frozenset({PRODUCER})})
    (first, third) = begun(schedule, 0)
    assert (first[0], third[0]) == (PRODUCER, THIRD)
    assert schedule.end(*first, 0)
    assert schedule.end(*third, 0)
    assert [module for module, _ in begun(schedule, 0)] == [CONSUMER]


def test_a_module_that_is_left_out_delays_no_other_module() -> None:
    schedule = chained()
    assert [module for module in schedule.due(0) if module != PRODUCER and schedule.begin(module, 0)] == [CONSUMER]
    assert schedule.next_ns == min(PERIOD_NS, HUNG_NS)


def test_a_consumer_waits_for_the_answer_of_its_producer_in_another_partition() -> None:
    schedule = chained()
    ((module, release),) = begun(schedule, 0)
    assert module == PRODUCER
    assert schedule.end(PRODUCER, release, 0)
    assert [module for module, _ in begun(schedule, 1 * MS)] == [CONSUMER]


def test_it_waits_a_quarter_of_its_period_and_no_longer() -> None:
    schedule = chained()
    begun(schedule, 0)
    assert schedule.next_ns == PATIENCE_NS
    assert begun(schedule, PATIENCE_NS - 1) == []
    assert [module for module, _ in begun(schedule, PATIENCE_NS)] == [CONSUMER]


def test_it_does_not_wait_for_a_release_of_long_ago() -> None:
    schedule = Schedule()
    schedule.start(PRODUCER, 1_000, 0, "one")
    begun(schedule, 0)
    schedule.start(CONSUMER, 40_000, 10 * MS, "two")
    schedule.chain({CONSUMER: frozenset({PRODUCER, THIRD})})
    assert [module for module, _ in begun(schedule, 10 * MS)] == [CONSUMER]


def test_a_module_waits_for_a_producer_that_was_due_first_and_whose_partition_is_busy() -> None:
    schedule = chained()
    schedule.start(0, 40_000, -1 * MS, "one")
    ((module, release),) = begun(schedule, -1 * MS)
    assert module == 0
    assert begun(schedule, 0) == []
    assert schedule.end(0, release, 0)
    assert [module for module, _ in begun(schedule, 0)] == [PRODUCER]


def test_a_step_that_has_not_ended_is_asked_for_and_asked_again_when_it_has_time_left() -> None:
    schedule = Schedule()
    schedule.start(THIRD, 40_000, 0)
    ((_, release),) = begun(schedule, 0)
    assert schedule.next_ns == HUNG_NS
    assert schedule.overdue(HUNG_NS - 1) == []
    assert schedule.overdue(HUNG_NS) == [(THIRD, release)]
    assert not schedule.hangs(THIRD, release, 60 * MS, HUNG_NS)
    assert schedule.next_ns == HUNG_NS + 40 * MS
    assert schedule.hangs(THIRD, release, HUNG_NS, HUNG_NS + 40 * MS)


def test_a_slow_module_may_spend_three_of_its_periods() -> None:
    schedule = Schedule()
    schedule.start(THIRD, 1_000, 0)
    ((_, release),) = begun(schedule, 0)
    assert schedule.next_ns == 3_000 * MS
    assert not schedule.hangs(THIRD, release, 2_999 * MS, 3_000 * MS)


def test_what_was_not_asked_or_was_stopped_since_neither_ends_nor_hangs_nor_begins_again() -> None:
    schedule = Schedule()
    schedule.start(THIRD, 40_000, 0)
    ((_, release),) = begun(schedule, 0)
    schedule.stop(THIRD)
    assert schedule.next_ns == NEVER_NS
    assert not schedule.end(THIRD, release, 0)
    assert not schedule.hangs(THIRD, release, HUNG_NS, 0)
    assert not schedule.again(THIRD, release, 0)


def test_a_step_that_could_not_be_taken_is_due_immediately_and_keeps_its_grid() -> None:
    schedule = Schedule()
    schedule.start(THIRD, 40_000, 0)
    ((_, release),) = begun(schedule, 0)
    assert schedule.again(THIRD, release, 60 * MS)
    ((_, release),) = begun(schedule, 60 * MS)
    assert schedule.end(THIRD, release, 0)
    assert schedule.next_ns == 75 * MS
