"""Which manager a PE follows, and what it reports when no manager is active."""

from agent.one_pe import FLYING, OnePe, slice_messages
from heronry_wire.identifiers import Command, management_id
from heronry_wire.management import Activate, Lease, Step


def test_slice_frames_of_the_other_manager_are_not_taken() -> None:
    pe = OnePe()
    prepare, head, *bodies = slice_messages(FLYING, 7, 1007)
    pe.command(prepare, head)
    pe.command(*bodies, manager=127)
    assert pe.core.staging.staged.epoch == 0


def test_a_new_manager_takes_over_what_the_old_one_staged() -> None:
    pe = OnePe()
    pe.command(*slice_messages(FLYING, 7, 1007))
    pe.command(Activate(2, 7, Step.GO_ALL, 1007), manager=127)
    assert pe.core.active_configuration.running.epoch == 7


def test_a_lease_settled_under_one_manager_is_no_short_cut_for_the_next() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    lease = Lease(1, 7, Step.GO_ALL, 1007)
    pe.command(lease)
    pe.command(Lease(2, 7, Step.GO_ALL, 1007), manager=127)
    pe.command(lease)
    assert pe.core.counts["stale term", management_id(126, Command.LEASE)] == 1
