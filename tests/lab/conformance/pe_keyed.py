"""A PE with a key: which commands it accepts, how it proves its states, and its lock (protocol rule 11)."""

from dataclasses import replace

from heronry_wire.authentication import KEY_BYTES, NO_EMERGENCY, PAGE_1_BEAT, Key, Session
from heronry_wire.canopen_objects import COUNTERS, HEARTBEAT_TIME
from heronry_wire.command_tags import CommandSigner
from heronry_wire.frame import Frame
from heronry_wire.identifiers import (
    Command,
    emcy_id,
    heartbeat_id,
    management_id,
    sdo_request_id,
    sdo_response_id,
    state_id,
)
from heronry_wire.management import (
    NUMBER_SPAN,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    Ping,
    Step,
)
from heronry_wire.pe_table import Port
from heronry_wire.sdo import DOWNLOAD, EXPEDITED, SIZE_GIVEN, with_data
from heronry_wire.state_frames import PeFlags, PeState, StatePage0, split_state
from lab.conformance import puppets
from lab.conformance.pe_under_test import (
    EVERYTHING,
    FAR,
    LEASE_NS,
    MAIN,
    NEIGHBOUR,
    NODE,
    PERIOD_NS,
    SERVO_DEVICE,
    TABLE,
    PeUnderTest,
    moments,
)
from lab.conformance.player import MS, demand, equal
from lab.peers import command_frame

KEY = Key(bytes(range(KEY_BYTES)))
OTHER_KEY = Key(bytes(KEY_BYTES))
_EPOCH, _DIGEST = 17, 0x111111
_TAG_ID = management_id(126, Command.TAG)


class Keyed(PeUnderTest):
    """A PE with a key, and a manager that has it too."""

    def __init__(self, **more: object) -> None:
        super().__init__(more.get("table", TABLE), key=KEY)  # type: ignore[arg-type]
        self.signer = CommandSigner(KEY, 126, 5)
        self.main.sign = self._sign
        self.session: Session | None = None

    def _sign(self, frame: Frame) -> Frame | None:
        return self.signer.tag(frame)

    def welcomes(self) -> Session:
        """Answer the last nonce of the PE; gives the session."""
        nonce = self.pages_2(-1)[-1][1].nonce
        self.main.say(*self.signer.welcome(NODE, nonce))
        self.session = Session(126, self.signer.term, self.signer.number)
        self.run(1.5)
        return self.session

    def attended(self) -> "Keyed":
        """Let a manager be active that has welcomed the PE."""
        self.lease = Lease(5, 0, Step.PREPARED, 0)
        self.alive = frozenset((NODE, NEIGHBOUR))
        self.neighbour = StatePage0(PeState.UNCONFIGURED, PeFlags.HEARS_LEASE, 1, 0, 0, 0)
        self.run(25)
        self.welcomes()
        self.run(45)
        return self

    def believes(self) -> bool:
        """Tell whether the PE answers a PING."""
        began_ns = self.run_into_next_period(8)
        self.main.command(Ping(self.signer.term, NODE, 0))
        self.run(3)
        return bool(self.pages_0(began_ns))


def _is_tagged(frame: Frame, session: Session, beat: int, digest: int, emergency: bytes = NO_EMERGENCY) -> bool:
    said, tag = split_state(frame.data)
    return KEY.state_tag(NODE, session, beat, said, digest, emergency=emergency) == tag


def it_asks_before_it_believes() -> None:
    """It sends a nonce with its first beat, then once in a period while a manager is heard; it accepts none before."""
    pe = Keyed()
    pe.run(100)
    equal(len(pe.pages_2(-1)), 1, "nonces while no manager is heard")
    demand(not pe.believes(), "a PE that has just started accepts a command")
    pe.lease, pe.alive = Lease(5, 0, Step.PREPARED, 0), frozenset((NODE,))
    began_ns = pe.run(400)
    times = moments(pe.pages_2(began_ns))
    demand(10 <= len(times) <= 21, f"{len(times)} nonces in twenty periods")
    nonces = {page.nonce for _, page in pe.pages_2(-1)}
    demand(2 <= len(nonces) <= 6, f"{len(nonces)} different nonces in half a second, each good for T_lease")
    demand(0 not in nonces, "a nonce is 0")
    page = pe.page_0()
    equal((page.flags, page.digest, page.state), (PeFlags(0), 0, PeState.UNCONFIGURED), "before its session it says")
    pe.welcomes()
    demand(pe.believes(), "a PE that was welcomed accepts no command")
    began_ns = pe.run(500)
    equal(pe.pages_2(began_ns), [], "nonces of a PE that was welcomed")


def its_states_are_proven() -> None:
    """Page 0 has a tag and its number in the session, page 1 a tag; the tag covers the digest, which page 3 shows."""
    pe = Keyed()
    pe.run(10 * PERIOD_NS / MS)
    beats = [t_ns for t_ns, frame in pe.main.since(-1, [state_id(NODE)]) if frame.data[0] < 0x40]
    equal(len(beats), 10, "beats in ten periods")
    equal([t_ns // PERIOD_NS for t_ns, _ in pe.pages_3(-1)], [9], "the beat that page 3 follows")
    pe.attended()
    began_ns = pe.now_ns
    pe.run(8000)
    assert pe.session is not None
    frames = [one.frame for one in pe.main.since(began_ns, [state_id(NODE)])]
    pages_0 = [frame for frame in frames if frame.data[0] < 0x40]
    first = next(beat for beat in range(1000) if _is_tagged(pages_0[0], pe.session, beat, 0))
    for number, frame in enumerate(pages_0):
        demand(_is_tagged(frame, pe.session, first + number, 0), f"page 0 number {first + number} is not proven")
    pages_1 = [frame for frame in frames if 0x40 <= frame.data[0] < 0x80]
    demand(len(pages_1) >= 39, "pages 1")
    demand(all(_is_tagged(frame, pe.session, PAGE_1_BEAT, 0) for frame in pages_1), "a page 1 is not proven")
    equal(len(pe.pages_3(began_ns)), 40, "pages 3 in 8 s, with every tenth beat")
    equal({page.digest for _, page in pe.pages_3(began_ns)}, {0}, "what page 3 says runs")
    pe.flies()
    pe.run(250)
    equal(pe.pages_3(-1)[-1][1].digest, _DIGEST, "what page 3 says runs")


def what_is_not_proven_is_refused() -> None:
    """Commands without tag, with another key, an old number, changed or cut are counted in page 3: no other effect."""
    pe = Keyed().attended()
    pe.run(220)
    before, counted = pe.pages_3(-1)[-1][1], pe.object(COUNTERS, 1)
    ping = command_frame(Ping(5, NODE, 0))
    other = CommandSigner(OTHER_KEY, 126, 5)
    other.number = pe.signer.number
    pe.lease = pe.alive = None
    pe.run(5)
    true = pe.signer.tag(ping)
    assert true is not None
    pe.main.say(ping, true)
    pe.run(25)
    began_ns = pe.now_ns
    pe.main.say(ping, true)  # once more
    pe.run(3)
    tag = other.tag(ping)
    assert tag is not None
    pe.main.say(ping, tag)
    pe.run(3)
    pe.main.say(true)  # without its command
    pe.run(3)
    changed = pe.signer.tag(command_frame(Ping(5, NODE, 77)))
    assert changed is not None
    pe.main.say(Frame(ping.can_id, Ping(5, 0, 9).encode()), changed)
    pe.run(3)
    pe.main.say(ping, Frame(_TAG_ID, b"\1\2\3"))
    pe.run(3)
    regular = [page for t_ns, page in pe.pages_0(began_ns)]
    equal(len(regular), 1, "pages 0 after commands that are not proven")
    pe.main.say(ping)  # and it stays without a tag
    pe.run(300)
    pe.lease = Lease(5, 0, Step.PREPARED, 0)
    pe.run(250)
    after = pe.pages_3(-1)[-1][1]
    equal((before.unproven, after.unproven), (0, 4), "unproven commands, before and after")
    equal((before.other, after.other), (0, 1), "other refusals, before and after")
    demand(pe.object(COUNTERS, 1) > counted + 3, "refused commands are not counted")
    demand(pe.believes(), "after all that it accepts no command")


def a_tag_must_come_in_time() -> None:
    """A command waits for its tag for T_lease, and no longer."""
    for late_ms, believed in ((95, True), (106, False)):
        pe = Keyed().attended()
        pe.lease = pe.alive = None
        pe.run_into_next_period(8)
        ping = command_frame(Ping(5, NODE, 0))
        tag = pe.signer.tag(ping)
        assert tag is not None
        pe.main.say(ping)
        pe.run(late_ms)
        began_ns = pe.now_ns
        pe.main.say(tag)
        pe.run(1.2)
        found = [page for t_ns, page in pe.pages_1(began_ns)]
        equal(bool(found), believed, f"a PING is accepted when its TAG comes after {late_ms} ms")


def numbers_may_be_missed() -> None:
    """Up to 8191 numbers may be missed; a PE that missed more sends a nonce, after T_lease without a command."""
    pe = Keyed().attended()
    pe.signer.number += NUMBER_SPAN - 60
    demand(pe.believes(), "a PE that has missed 8000 commands accepts none")
    pe.signer.number += NUMBER_SPAN + 5
    lost_ns = pe.now_ns
    demand(not pe.believes(), "a PE that has missed 8197 commands accepts the next one")
    pe.run_until(lost_ns + 95 * MS)
    equal(pe.pages_2(lost_ns), [], "nonces within T_lease of the last command")
    pe.run(60)
    demand(bool(pe.pages_2(lost_ns)), "a PE that has missed too many commands sends no nonce")
    pe.welcomes()
    demand(pe.believes(), "a PE that was welcomed anew accepts no command")


def a_welcome_answers_a_fresh_nonce() -> None:
    """WELCOME must have the PE's own nonce of the last T_lease: not that of another PE, nor an older one."""
    pe = Keyed()
    pe.run(5)
    nonce = pe.pages_2(-1)[-1][1].nonce
    pe.run_until(pe.pages_2(-1)[-1][0] + LEASE_NS + 3 * MS)
    pe.main.say(*pe.signer.welcome(NODE, nonce))
    pe.run(2)
    demand(not pe.believes(), "a WELCOME to an old nonce is accepted")
    pe.run(25)
    nonce = pe.pages_2(-1)[-1][1].nonce
    pe.main.say(*pe.signer.welcome(NODE, nonce ^ 1))
    pe.run(2)
    demand(not pe.believes(), "a WELCOME to another nonce is accepted")
    pe.run(25)
    nonce = pe.pages_2(-1)[-1][1].nonce
    pe.main.say(*pe.signer.welcome(NODE + 1, nonce))
    pe.run(2)
    demand(not pe.believes(), "a WELCOME to another node is accepted")
    pe.run(25)
    pe.welcomes()
    demand(pe.believes(), "a WELCOME is not accepted")


def a_new_session_begins_with_renew_and_with_a_new_term() -> None:
    """RENEW ends the session; the PE accepts a new term of the same manager immediately, and sends a nonce."""
    pe = Keyed().attended()
    pe.main.command(Control(5, NODE + 1, Operation.RENEW), Control(5, 0, Operation.RENEW))
    began_ns = pe.run(100)
    equal(pe.pages_2(began_ns), [], "nonces after RENEW of others")
    pe.main.command(Control(5, NODE, Operation.RENEW))
    began_ns = pe.run(25)
    demand(bool(pe.pages_2(began_ns)), "RENEW is not followed by a nonce")
    equal(pe.page_0().digest, 0, "tag of a page 0 without a session")
    pe.welcomes()
    began_ns = pe.run(60)
    equal(pe.pages_2(began_ns), [], "nonces after the welcome")
    demand(pe.page_0().digest != 0, "a page 0 is not tagged")
    pe.signer = CommandSigner(KEY, 126, 7)
    pe.term, pe.lease = 7, Lease(7, 0, Step.PREPARED, 0)
    began_ns = pe.run(45)
    demand(PeFlags.HEARS_LEASE in pe.page_0().flags, "a new term is not accepted immediately")
    demand(bool(pe.pages_2(began_ns)), "in a new term the PE sends no nonce")
    equal(pe.page_0().digest, 0, "tag of a page 0 in a new term")
    pe.welcomes()
    pe.run(45)
    demand(pe.page_0().digest != 0, "after the welcome of a new term a page 0 is not tagged")


def another_manager_has_to_welcome_it_too() -> None:
    """The PE refuses a manager that has not welcomed it, in any term; its commands make the PE send a nonce."""
    pe = Keyed().attended()
    other = CommandSigner(KEY, 127, 6)

    def speaks() -> int:
        lease = command_frame(Lease(6, 0, Step.PREPARED, 0), 127)
        tag = other.tag(lease)
        assert tag is not None
        pe.main.say(lease, tag)
        return pe.run(5)

    pe.run(120)  # its first nonce is too old by now
    began_ns = speaks()
    demand(bool(pe.pages_2(began_ns)), "to a manager that has not welcomed it the PE sends no nonce")
    demand(pe.believes(), "a manager that has not welcomed the PE is accepted")
    pe.main.say(*other.welcome(NODE, pe.pages_2(-1)[-1][1].nonce))
    pe.run(5)
    demand(not pe.believes(), "after the WELCOME of a higher term the old manager is accepted")


def an_emergency_is_proven_by_the_next_page_0() -> None:
    """That page goes out immediately; of several pending EMCYs each is proven in its turn."""
    pe = Keyed().attended()
    puppets.behave_normally()
    pe.flies(EVERYTHING)
    pe.run(1200)
    report = puppets.reporting("device:gauge_sensor", "device:servo_motor", detail=3)
    puppets.BEHAVIOUR["helper"] = lambda ctx, inputs: {**report(ctx, inputs), "help": 1, "call": 0}
    began_ns = pe.run(200)
    assert pe.session is not None
    emcys = {one.frame.data for one in pe.main.since(began_ns, [emcy_id(NODE)])}
    wanted = {Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, index, 3).encode() for index in (0, SERVO_DEVICE)}
    equal(emcys, wanted, "EMCYs")
    proven: set[bytes] = set()
    for t_ns, frame in pe.main.since(began_ns, [state_id(NODE)]):
        if frame.data[0] >= 0x40:
            continue
        beats = [
            (beat, emcy)
            for beat in range(400)
            for emcy in (*emcys, NO_EMERGENCY)
            if _is_tagged(frame, pe.session, beat, _DIGEST, emcy)
        ]
        demand(len(beats) == 1, f"a page 0 at {t_ns} is proven {len(beats)} times")
        if frame.data[0] & PeFlags.FAULT_PENDING:
            demand(beats[0][1] != NO_EMERGENCY, "a page 0 that says FAULT_PENDING proves no EMCY")
            proven.add(beats[0][1])
    equal(proven, emcys, "EMCYs that were proven")
    first_ns = pe.main.since(began_ns, [emcy_id(NODE)])[0].t_ns
    nexts = [t_ns for t_ns, page in pe.pages_0(first_ns - MS) if PeFlags.FAULT_PENDING in page.flags]
    demand(nexts[0] - first_ns < 2 * MS, "an EMCY is not followed by a page 0 immediately")
    pe.main.command(*(Control(5, NODE, Operation.ACKNOWLEDGE, 1, index) for index in (0, 1)))
    began_ns = pe.run(2.5)
    demand(bool(pe.pages_0(began_ns)), "an acknowledgement is not followed by a page 0 immediately")
    began_ns = pe.run(400)
    demand(19 <= len(pe.pages_0(began_ns)) <= 21, "pages 0 in twenty periods in which nothing changes")


def its_lock_opens_for_a_while() -> None:
    """UNLOCK for this node opens the lock for its time, 60 s at most: SDO downloads and NMT work until then."""
    pe = Keyed()
    pe.run(25)
    pe.lease = Lease(5, 0, Step.PREPARED, 0)
    pe.run(25)
    pe.welcomes()
    pe.lease = None
    equal(_writes(pe), False, "written before any UNLOCK")
    pe.main.command(Control(5, NODE + 1, Operation.UNLOCK, 30), Control(5, 0, Operation.UNLOCK, 30))
    pe.run(5)
    equal(_writes(pe), False, "written after UNLOCK of others")
    for seconds, opened_s in ((2, 2), (1000, 60)):
        pe.main.command(Control(5, NODE, Operation.UNLOCK, seconds))
        began_ns = pe.run(3)
        equal(_writes(pe), True, "written after UNLOCK")
        equal(pe.notes("unlock")[-1:], [f"NMT and SDO writes are allowed for {opened_s} s"], "notes of an UNLOCK")
        pe.main.say(Frame(0, bytes((1, NODE))))
        pe.run(1100)
        equal(pe.main.since(-1, [heartbeat_id(NODE)])[-1].frame.data, b"\x05", "NMT start after UNLOCK")
        pe.run_until(began_ns + opened_s * 1000 * MS - 40 * MS)
        equal(_writes(pe), True, f"written just before {opened_s} s are over")
        pe.run_until(began_ns + opened_s * 1000 * MS + 5 * MS)
        equal(_writes(pe), False, f"written when {opened_s} s are over")
        pe.main.say(Frame(0, bytes((128, NODE))))
        pe.run(1100)
        equal(pe.main.since(-1, [heartbeat_id(NODE)])[-1].frame.data, b"\x05", "NMT when the lock is closed")


def _writes(pe: PeUnderTest) -> bool:
    """Tell whether a client can write the heartbeat time of the PE."""
    began_ns = pe.now_ns
    command = DOWNLOAD | EXPEDITED | SIZE_GIVEN | 2 << 2
    pe.main.say(Frame(sdo_request_id(NODE), with_data(command, HEARTBEAT_TIME, 0, b"\xe8\x03")))
    pe.run(6)
    found = pe.main.since(began_ns, [sdo_response_id(NODE)])
    demand(len(found) == 1, "a write is not answered")
    return found[0].frame.data[0] == 0x60


def a_gateway_hands_on_tags() -> None:
    """It forwards tags with the commands that it accepts, and WELCOME to its node; it forwards nothing unproven."""
    far = Port("far", 500_000, 50 * MS, 3, wireless=False, channels=1, nodes=(FAR,))
    pe = Keyed(table=replace(TABLE, ports=(MAIN, far))).attended()
    began_ns = pe.run_into_next_period(8)
    pe.main.command(Control(5, FAR, Operation.CLEAR, 1, 1))
    pe.run(4)
    found = [one.frame.can_id for one in pe.far.since(began_ns, [_TAG_ID, management_id(126, Command.CONTROL)])]
    equal(found, [management_id(126, Command.CONTROL), _TAG_ID], "handed on")
    for node, handed_on in ((FAR, 2), (FAR + 1, 0)):
        began_ns = pe.run_into_next_period(8)
        pe.main.say(*pe.signer.welcome(node, 0x1234))
        pe.run(4)
        equal(len(pe.far.since(began_ns, [_TAG_ID, management_id(126, Command.CONTROL)])), handed_on, f"WELCOME {node}")
    began_ns = pe.now_ns
    lone = command_frame(Control(5, FAR, Operation.CLEAR, 1, 1))
    pe.main.say(lone, Frame(_TAG_ID, bytes((6 << 5, 1, 2, 3, 4, 5, 6, 7))))
    pe.run(4)
    before = pe.counted
    pe.far.say(lone, Frame(_TAG_ID, bytes((6 << 5, 1, 2, 3, 4, 5, 6, 7))))
    pe.run(4)
    equal(pe.counted - before, 2, "frames from beyond that are counted")
    equal(pe.far.since(began_ns, [lone.can_id]), [], "handed on without a proof")
