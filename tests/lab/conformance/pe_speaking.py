"""What a PE sends without a request, and how often (protocol rules 1, 3 and 12)."""

from dataclasses import replace

from heronry_wire.frame import Frame
from heronry_wire.identifiers import NMT_ID, heartbeat_id, state_id
from heronry_wire.management import NO_EPOCH, Control, Lease, Operation, Ping, Step
from heronry_wire.pe_table import Port
from heronry_wire.sansio import NEVER_NS
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0
from lab.conformance.pe_under_test import (
    FAR,
    INCARNATION,
    MAIN,
    NODE,
    PERIOD_NS,
    PLACE_NS,
    TABLE,
    PeUnderTest,
    gaps,
    immediate,
    moments,
)
from lab.conformance.player import MS, SOON_NS, demand, equal

_S = 1000


def it_speaks_at_its_place_in_the_period() -> None:
    """Page 0 goes out every period at (n - 92) / 34 of it, with a sequence; page 1 with the first and every tenth."""
    pe = PeUnderTest()
    pe.run(2 * _S)
    pages = pe.pages_0(-1)
    equal(len(pages), 100, "pages 0 in two seconds")
    for number, (t_ns, page) in enumerate(pages):
        equal(page, StatePage0(PeState.UNCONFIGURED, PeFlags(0), INCARNATION, NO_EPOCH, number, 0), f"page 0, {number}")
        late_ns = t_ns - number * PERIOD_NS - PLACE_NS
        demand(0 < late_ns < SOON_NS, f"page 0 number {number} comes {late_ns} ns after its place")
    seconds = pe.pages_1(-1)
    equal(len(seconds), 10, "pages 1 in two seconds")
    for number, (t_ns, page_1) in enumerate(seconds):
        told = (page_1.staged_epoch, page_1.staged_digest, page_1.reason, page_1.load, page_1.state, page_1.flags)
        equal(told, (0, 0, Reason.NONE, 0, PeState.UNCONFIGURED, PeFlags(0)), f"page 1, {number}")
        demand(immediate(t_ns, pages[10 * number][0]), f"page 1 does not follow page 0 number {10 * number}")


def it_counts_to_255_and_on() -> None:
    """The sequence of page 0 counts modulo 256."""
    pe = PeUnderTest()
    pe.run(6 * _S)
    equal([page.sequence for _, page in pe.pages_0(-1)], [number % 256 for number in range(300)], "sequences")


def on_two_buses_each_has_its_own_period_and_count() -> None:
    """Page 0 goes out on every port in the heartbeat period of that bus; the CANopen heartbeat on both."""
    far = Port("far", 500_000, 50 * MS, 3, wireless=False, channels=1, nodes=(FAR,))
    pe = PeUnderTest(replace(TABLE, ports=(MAIN, far)))
    pe.run(2 * _S)
    for player, period_ns in ((pe.main, PERIOD_NS), (pe.far, 50 * MS)):
        pages = pe.pages_0(-1, player)
        equal([page.sequence for _, page in pages], list(range(2_000 * MS // period_ns)), "sequences of a bus")
        place_ns = 3 * period_ns // 34
        late_ns = [t_ns - number * period_ns - place_ns for number, (t_ns, _) in enumerate(pages)]
        demand(all(0 < one < SOON_NS for one in late_ns), f"pages 0 come {late_ns} ns after their places")
        equal(len(pe.pages_1(-1, player)), -(-len(pages) // 10), "pages 1 of a bus")
        beats = player.since(-1, [heartbeat_id(NODE)])
        equal([frame.data for _, frame in beats], [b"\x00", b"\x7f"], "CANopen heartbeats")


def its_canopen_heart_beats_once_a_second() -> None:
    """Boot-up comes immediately, then the NMT state every second: pre-operational, operational once configured."""
    pe = PeUnderTest().attended().flies()
    pe.run(4 * _S)
    beats = pe.main.since(-1, [heartbeat_id(NODE)])
    equal([frame.data for _, frame in beats], [b"\x00"] + 4 * [b"\x05"], "CANopen heartbeats")
    apart = gaps(moments(beats))
    demand(all(abs(gap - 1_000 * MS) < SOON_NS for gap in apart), f"CANopen heartbeats are {apart} ns apart")


def nmt_is_accepted_where_no_manager_is_heard() -> None:
    """A PE that runs nothing and hears no LEASE executes NMT; a reset is a boot-up, unknown commands change nothing."""
    pe = PeUnderTest()
    pe.run(30)
    for leads, command, state in (
        (False, 1, b"\x05"),
        (False, 2, b"\x04"),
        (False, 128, b"\x7f"),
        (True, 1, b"\x7f"),
        (True, 2, b"\x7f"),
        (False, 77, b"\x7f"),
        (False, 1, b"\x05"),
    ):
        pe.lease = Lease(5, 0, Step.PREPARED, 0) if leads else None
        pe.run(200)
        pe.main.say(Frame(NMT_ID, bytes((command, NODE))))
        pe.run(1_100)
        equal(pe.main.since(-1, [heartbeat_id(NODE)])[-1].frame.data, state, f"after NMT command {command} it says")
    began_ns = pe.now_ns
    pe.main.say(Frame(NMT_ID, bytes((130, 0))))
    pe.run(500)
    beats = [frame.data for _, frame in pe.main.since(began_ns, [heartbeat_id(NODE)])]
    equal(beats[:1], [b"\x00"], "CANopen heartbeats after a reset")


def it_answers_a_ping_at_once() -> None:
    """It sends both pages, to a PING for itself or for all PEs; none to one for another PE, or of a stale term."""
    pe = PeUnderTest().attended()
    pe.run(15)
    for ping, answered in (
        (Ping(5, NODE, 1), True),
        (Ping(5, 0, 1), True),
        (Ping(5, NODE - 1, 1), False),
        (Ping(4, NODE, 1), False),
    ):
        began_ns = pe.run_into_next_period(8)
        pe.main.command(ping)
        pe.run(4)
        said = len(pe.pages_0(began_ns)), len(pe.pages_1(began_ns))
        wanted = (1, 1) if answered else (0, 1 if ping.term == 4 else 0)  # STALE_TERM is reported
        equal(said, wanted, f"pages after {ping}")


def after_a_pause_it_does_not_make_up_for_beats() -> None:
    """The next beat comes at its place, and missed beats are not made up."""
    pe = PeUnderTest()
    pe.run(105)
    pe.pe.pause(70 * MS)
    began_ns = pe.run(200)
    times = moments(pe.pages_0(began_ns))
    late_ns = [(t_ns - PLACE_NS) % PERIOD_NS for t_ns in times[1:]]
    demand(all(0 < one < SOON_NS for one in late_ns), f"after a pause pages 0 come {late_ns} ns after their places")
    demand(immediate(times[0], began_ns + 70 * MS), "after a pause the beat that is due does not come immediately")
    equal(len(times), 1 + 7, "pages 0 in the rest of 200 ms")


def it_says_whether_it_hears_a_lease() -> None:
    """The state reports LEASE as heard from the LEASE on, until T_lease after the last one and no longer."""
    pe = PeUnderTest().attended()
    pe.run_until(pe.now_ns // PERIOD_NS * PERIOD_NS + 5 * MS)
    pe.lease, pe.alive = None, None
    leased_ns = pe.now_ns // PERIOD_NS * PERIOD_NS  # it went out with that beat
    pe.run_until(leased_ns + 98 * MS)
    demand(PeFlags.HEARS_LEASE in pe.pinged().flags, "98 ms after a LEASE it hears none")
    pe.run_until(leased_ns + 101 * MS)
    demand(PeFlags.HEARS_LEASE not in pe.pinged().flags, "101 ms after a LEASE it hears it still")


def another_node_with_its_number_is_noted() -> None:
    """A state of another node under its node-ID is a clash: exclusive outputs are held for T_lease."""
    pe = PeUnderTest().attended().flies()
    demand(PeFlags.OUTPUT_HELD not in pe.page_0().flags, "its outputs are held without a reason")
    began_ns = pe.run(3)
    page = StatePage0(PeState.UNCONFIGURED, PeFlags(0), 99, 0, 0, 0)
    pe.main.say(Frame(state_id(NODE), page.encode()))
    pe.run(2)
    demand(PeFlags.OUTPUT_HELD in pe.pinged().flags, "another node has its number, and it goes on driving")
    pe.run_until(began_ns + 95 * MS)
    demand(PeFlags.OUTPUT_HELD in pe.pinged().flags, "95 ms after a clash it drives again")
    pe.run_until(began_ns + 106 * MS)
    demand(PeFlags.OUTPUT_HELD not in pe.pinged().flags, "106 ms after a clash it still holds back")


def a_table_without_an_end_is_not_sent_by_itself() -> None:
    """Without requests a PE sends only states, heartbeats and echoes."""
    pe = PeUnderTest()
    pe.run(1.5 * _S)
    others = {one.frame.can_id for one in pe.main.heard} - {state_id(NODE), heartbeat_id(NODE)}
    equal(others, set(), "identifiers sent without a request")
    demand(pe.pe.core.next_deadline_ns() < NEVER_NS, "it has no next deadline")


def an_acknowledgement_of_nothing_does_nothing() -> None:
    """CONTROL about an element that is not pending, in all its forms, changes no state."""
    pe = PeUnderTest().attended().flies()
    pe.run(20)
    before = pe.page_0()
    for operation in (Operation.ACKNOWLEDGE, Operation.CLEAR, Operation.RENEW, Operation.UNLOCK, Operation.HOLDS):
        for node in (0, NODE, NODE + 1):
            pe.main.command(Control(5, node, operation, 2, 0))
    began_ns = pe.run(40)
    equal(pe.emergencies(began_ns), [], "EMCYs after CONTROL about nothing")
    after = pe.page_0()
    equal(replace(after, sequence=0), replace(before, sequence=0), "page 0 after CONTROL about nothing")
    demand(Step.GO_ALL > Step.GO, "steps are in order")
