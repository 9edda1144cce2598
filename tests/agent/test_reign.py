"""Whom a PE obeys, and what it says when nobody reigns."""

from agent.one_pe import BEAT_NS, FLYING, LEASE_NS, NODE, OnePe, command_frame, pages, slice_messages
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, management_id
from heronry_wire.management import Activate, Lease, Ping, Prepare, Step
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage1


def test_a_lower_term_is_rejected_told_once_and_counted() -> None:
    pe = OnePe()
    pe.command(Lease(5, 0, Step.PREPARED, 0))
    (page,) = pages(pe.command(Prepare(4, 7, 1007), manager=127))
    assert isinstance(page, StatePage1)
    assert page.reason is Reason.STALE_TERM
    assert pe.command(Lease(4, 7, Step.GO_ALL, 1007), Ping(4, NODE, 1), manager=127) == []
    assert sum(n for (what, _), n in pe.core.counts.items() if what == "stale term") == 3


def test_a_higher_term_takes_over_with_any_command() -> None:
    pe = OnePe()
    pe.command(Lease(5, 0, Step.PREPARED, 0))
    pe.command(Ping(6, NODE, 1), manager=127)
    assert (pe.core.reign.term, pe.core.reign.manager) == (6, 127)
    assert pages(pe.command(Ping(5, NODE, 2)))[0].state is PeState.UNCONFIGURED, "told that its term is stale"
    assert pe.command(Ping(5, NODE, 3)) == []


def test_a_term_belongs_to_the_manager_first_heard_with_it() -> None:
    pe = OnePe()
    pe.command(Lease(5, 0, Step.PREPARED, 0))
    pe.command(*slice_messages(FLYING, 7, 1007, term=5), manager=127)
    assert pe.core.staging.staged.epoch == 0


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
    assert pe.core.reconfiguration.running.epoch == 7


def test_no_term_and_a_term_beyond_twelve_bits_are_nobodys() -> None:
    pe = OnePe()
    for term in (0, 0x1000, 0xFFFF):
        pe.hear(command_frame(Lease(term, 0, Step.PREPARED, 0)))
    assert pe.core.reign.term == 0


def test_losing_the_lease_shows_in_the_flags_and_stops_nothing() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    pe.fly(100_000_000, epoch=7, digest=1007)
    assert PeFlags.HEARS_LEASE in pe.ask()[0].flags
    pe.pass_time(LEASE_NS + BEAT_NS)
    page = pe.ask()[0]
    assert PeFlags.HEARS_LEASE not in page.flags
    assert (page.state, page.epoch) == (PeState.ACTIVE, 7)
    pe.command(Lease(1, 7, Step.GO_ALL, 1007))
    assert PeFlags.HEARS_LEASE in pe.ask()[0].flags


def test_a_lease_settled_under_one_manager_is_no_short_cut_for_the_next() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    lease = Lease(1, 7, Step.GO_ALL, 1007)
    pe.command(lease)
    pe.command(Lease(2, 7, Step.GO_ALL, 1007), manager=127)
    pe.command(lease)
    assert pe.core.counts["stale term", management_id(126, Command.LEASE)] == 1


def test_malformed_commands_are_counted_and_change_nothing() -> None:
    pe = OnePe()
    for manager in (126, 127):
        for command in Command:
            for data in (b"", b"\xff" * 7, bytes(8)):
                assert pe.hear(Frame(management_id(manager, command), data)) == []
    assert pe.core.reign.term == 0
