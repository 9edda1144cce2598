"""A module that fails is restarted a few times, later each time, and is then given up."""

from agent.one_pe import MS
from heronry_agent.core.restarts import BACK_OFF_NS, Restarts
from heronry_wire.protocol_times import FORGIVEN_AFTER_NS
from heronry_wire.sansio import NEVER_NS

MODULE, OTHER = 3, 4


def failures(restarts: Restarts, budget: int, at_ns: int) -> tuple[int | None, int]:
    """Number of failures by now, and how long the module waits."""
    times = restarts.failed(MODULE, budget, at_ns)
    wait_ns = restarts.next_ns - at_ns
    restarts.due(restarts.next_ns)
    return times, wait_ns


def test_a_failed_module_begins_immediately_then_later_and_later_and_is_given_up() -> None:
    restarts = Restarts()
    told = [failures(restarts, 3, k * MS) for k in range(3)]
    assert told == [(1, 0), (2, BACK_OFF_NS), (3, 2 * BACK_OFF_NS)]
    assert restarts.failed(MODULE, 3, 4 * MS) is None
    assert (restarts.next_ns, restarts.waiting) == (NEVER_NS, frozenset())


def test_one_that_is_wanted_again_after_it_was_given_up_has_a_new_budget() -> None:
    restarts = Restarts()
    assert [failures(restarts, 1, 0)[0], restarts.failed(MODULE, 1, 1), restarts.failed(MODULE, 1, 2)] == [1, None, 1]


def test_a_minute_without_a_failure_forgives() -> None:
    restarts = Restarts()
    assert failures(restarts, 1, 0)[0] == 1
    assert failures(restarts, 1, FORGIVEN_AFTER_NS + 1) == (1, 0)
    assert restarts.failed(MODULE, 1, 2 * FORGIVEN_AFTER_NS) is None


def test_a_module_without_a_budget_is_given_up_at_its_first_failure() -> None:
    assert Restarts().failed(MODULE, 0, 0) is None


def test_those_that_wait_begin_in_order_when_their_time_has_come() -> None:
    restarts = Restarts()
    for module, at_ns in ((OTHER, 5), (MODULE, 5), (7, 9)):
        restarts.begin_at(module, at_ns)
    restarts.cancel(7)
    assert (restarts.next_ns, restarts.waiting) == (5, {MODULE, OTHER})
    assert restarts.due(4) == []
    assert restarts.due(5) == [MODULE, OTHER]
