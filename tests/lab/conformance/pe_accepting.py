"""Which commands a PE accepts (protocol rules 4, 7 and 11)."""

from heronry_wire.canopen_objects import COUNTERS
from heronry_wire.frame import Frame
from heronry_wire.identifiers import LAST_MANAGER, Command, management_id
from heronry_wire.management import Activate, Alive, Lease, Ping, Prepare, Step
from heronry_wire.state_frames import PeFlags, PeState, Reason
from lab.conformance.pe_under_test import LEASE_NS, NODE, NOTHING, PeUnderTest
from lab.conformance.player import MS, demand, equal
from lab.peers import command_frame

_EPOCH, _DIGEST = 17, 0x111111


def _is_answered(pe: PeUnderTest, term: int, manager: int = 126) -> bool:
    """Tell whether the PE answers a PING of this term with a page 0."""
    began_ns = pe.run_into_next_period(8)
    pe.main.command(Ping(term, NODE, 0), manager=manager)
    pe.run(3)
    return bool(pe.pages_0(began_ns))


def the_highest_term_is_accepted() -> None:
    """Terms from 1 to 4095 are accepted; then no lower term, and never the same term of another manager."""
    pe = PeUnderTest()
    pe.run(10)
    answered = [
        (term, manager, _is_answered(pe, term, manager))
        for term, manager in ((0, 126), (1, 126), (1, 127), (2, 127), (2, 126), (1, 126), (4095, 126), (4096, 126))
    ]
    wanted = [False, True, False, True, False, False, True, False]
    equal([one[2] for one in answered], wanted, f"answered of {answered}")
    equal(_is_answered(pe, 2, LAST_MANAGER), False, "a deposed manager is answered")


def a_deposed_manager_is_told_once() -> None:
    """The PE reports STALE_TERM in page 1 the first time only; the next true PREPARE clears it."""
    pe = PeUnderTest().attended()
    pe.run(7)
    for told in (True, False, False):
        began_ns = pe.now_ns
        pe.main.command(Lease(4, 3, Step.GO_ALL, 0x42), manager=LAST_MANAGER)
        pe.run(2)
        reasons = [page.reason for _, page in pe.pages_1(began_ns)]
        equal(reasons, [Reason.STALE_TERM] if told else [], "a deposed manager is told")
    pe.prepare(_EPOCH, NOTHING, _DIGEST)
    pe.run(4)
    equal(pe.page_1().reason, Reason.NONE, "after the next epoch its reason is")


def a_stale_term_is_not_reported_before_the_first_manager() -> None:
    """A PE without a manager so far reports no STALE_TERM, nor does a PE that collects a slice."""
    pe = PeUnderTest()
    pe.run(7)
    began_ns = pe.now_ns
    pe.main.say(Frame(management_id(126, Command.LEASE), Lease(4095, 0, Step.PREPARED, 0).encode()[:7]))
    pe.main.command(Ping(9, NODE + 1, 0))
    pe.run(2)
    pe.says_nothing_of_it(began_ns)
    pe = PeUnderTest().attended()
    pe.run(7)
    pe.main.command(Prepare(5, _EPOCH, _DIGEST))
    pe.run(1)
    began_ns = pe.now_ns
    pe.main.command(Ping(4, NODE, 0))
    pe.run(2)
    pe.says_nothing_of_it(began_ns)
    equal(pe.object(COUNTERS, 1) > 0, True, "refused commands are counted")


def a_new_term_goes_on_where_the_old_one_was() -> None:
    """An epoch that was staged in one term can be activated in the next; then ALIVE of the old term is refused."""
    pe = PeUnderTest().attended().flies()
    pe.term, pe.manager = 6, LAST_MANAGER
    pe.lease = Lease(6, _EPOCH, Step.GO_ALL, _DIGEST)
    pe.run(60)
    page = pe.page_0()
    equal((page.state, page.epoch, page.digest), (PeState.ACTIVE, _EPOCH, _DIGEST), "under a new manager it runs")
    demand(PeFlags.HEARS_LEASE in page.flags, "the new manager is not heard")
    pe.main.command(Alive(5, 0, frozenset()))  # of the old term: it must be refused
    pe.run(3)
    demand(PeFlags.OUTPUT_HELD not in pe.pinged().flags, "a deposed manager's ALIVE takes the outputs away")


def malformed_commands_change_nothing() -> None:
    """A command that is cut short, or has an unknown step or operation, is counted and has no other effect."""
    pe = PeUnderTest().attended().flies()
    pe.run(5)
    before, counted = pe.page_0(), pe.object(COUNTERS, 1)
    for message in (
        Lease(5, _EPOCH + 1, Step.GO_ALL, 1),
        Alive(5, 0, frozenset()),
        Activate(5, _EPOCH + 1, Step.GO_ALL, 1),
        Prepare(5, _EPOCH + 1, 2),
        Ping(5, NODE, 0),
    ):
        frame = command_frame(message)
        pe.main.say(frame._replace(data=frame.data[:-1]))
    wrong_step = bytearray(Lease(5, _EPOCH + 1, Step.GO_ALL, 1).encode())
    wrong_step[4] = 9
    pe.main.say(Frame(management_id(126, Command.LEASE), bytes(wrong_step)))
    pe.main.say(Frame(management_id(126, Command.CONTROL), bytes((0, 5, 0, 77, 0, 0, 0, 0))))
    began_ns = pe.run(6)
    pe.says_nothing_of_it(began_ns)
    page = pe.pinged()
    equal((page.epoch, page.state, page.flags), (before.epoch, before.state, before.flags), "after malformed commands")
    equal(pe.object(COUNTERS, 1), counted + 7, "malformed commands are counted")


def other_people_s_frames_are_no_commands() -> None:
    """29-bit, remote and error frames under this protocol's identifiers are counted, and change nothing."""
    pe = PeUnderTest().attended()
    pe.run(7)
    counted, began_ns = pe.object(COUNTERS, 1), pe.now_ns
    ping = command_frame(Ping(5, NODE, 0))
    pe.main.say(ping._replace(extended=True), ping._replace(remote=True, data=b""))
    pe.run(3)
    equal(len(pe.pages_0(began_ns)), 0, "pages 0 after 29 bits")
    equal(pe.object(COUNTERS, 1), counted + 2, "frames of other protocols are counted")


def a_lease_is_heard_for_t_lease_after_a_pause_too() -> None:
    """A frame that waited while the processor stood still keeps its age: T_lease counts from its arrival."""
    pe = PeUnderTest().attended()
    pe.run(5)
    pe.lease = None
    pe.alive = None
    paused_ns = pe.now_ns
    pe.pe.pause(90 * MS)
    pe.main.command(Lease(5, 0, Step.PREPARED, 0))
    pe.run_until(paused_ns + 95 * MS)
    demand(PeFlags.HEARS_LEASE in pe.pinged().flags, "a LEASE that came 95 ms ago is not heard")
    pe.run_until(paused_ns + LEASE_NS + 3 * MS)
    demand(PeFlags.HEARS_LEASE not in pe.pinged().flags, "a LEASE is heard from the end of a pause on, not as it came")
