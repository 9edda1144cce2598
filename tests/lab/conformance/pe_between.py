"""A PE as a gateway, to a wire or to a radio: what it forwards, when, and its reports on radios (protocol rule 9)."""

from dataclasses import replace

from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.frame import Frame
from heronry_wire.gateway_report import LinkReport, LinkState, decode_link
from heronry_wire.identifiers import (
    GATEWAY_IDS,
    Command,
    actuator_echo_id,
    emcy_id,
    emergency_event_id,
    heartbeat_id,
    management_id,
    state_id,
)
from heronry_wire.management import (
    Activate,
    Alive,
    Control,
    Lease,
    Operation,
    Ping,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
)
from heronry_wire.pe_table import Port
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1
from lab.conformance import puppets
from lab.conformance.pe_under_test import (
    DEMAND,
    DEMAND_ID,
    FAR,
    HEIGHT_ID,
    HELP,
    HELP_ID,
    HELPER,
    LAMP,
    MAIN,
    NEIGHBOUR,
    NODE,
    NOTHING,
    OTHER_HEIGHT,
    OTHER_HEIGHT_ID,
    TABLE,
    PeUnderTest,
    datum,
    gaps,
    moments,
)
from lab.conformance.player import MS, demand, equal
from lab.peers import command_frame

_FAR_PORT = Port("far", 500_000, 50 * MS, 3, wireless=False, channels=1, nodes=(FAR,))
_LINK_ID = GATEWAY_IDS[0]
_RADIO_PORT = Port("radio", 100_000, 100 * MS, 4, wireless=True, channels=1, nodes=(FAR,), link_id=_LINK_ID)
_GATEWAY = replace(TABLE, ports=(MAIN, _FAR_PORT))
_RADIO = replace(TABLE, ports=(MAIN, _RADIO_PORT))
_EPOCH, _DIGEST = 17, 0x111111
_FORWARDS = Slice(forward={OTHER_HEIGHT: (NEIGHBOUR, 2)})
_LEASE_ID, _ALIVE_ID = management_id(126, Command.LEASE), management_id(126, Command.ALIVE)


def commands_are_handed_on() -> None:
    """The gateway forwards commands that it accepts itself: slices toward their node only, all others immediately."""
    pe = PeUnderTest(_GATEWAY).attended()
    handed_on = (
        Prepare(5, 9, 9),
        SliceHead(FAR, 9, 0, 1),
        SliceBody(FAR, 9, 1, b"\1"),
        Activate(5, 9, Step.BREAK, 9),
        Ping(5, FAR, 0),
        Ping(5, NODE, 0),
        Control(5, FAR, Operation.CLEAR, 1, 1),
    )
    kept = (SliceHead(NODE, 9, 0, 1), SliceHead(FAR + 1, 9, 0, 1), Ping(4, FAR, 0), Prepare(4, 9, 9))
    for messages, is_handed_on in ((handed_on, True), (kept, False)):
        for message in messages:
            began_ns = pe.run_into_next_period(8)
            pe.main.command(message)
            pe.run(3)
            frame = command_frame(message)
            found = [one.frame for one in pe.far.since(began_ns, [frame.can_id])]
            equal(found, [frame] if is_handed_on else [], f"on the far bus, after {message}")
    began_ns = pe.run_into_next_period(8)
    pe.main.command(Ping(5, 0, 0), manager=127)
    pe.run(3)
    equal(pe.far.since(began_ns, [management_id(127, Command.PING)]), [], "from a deposed manager, on the far bus")


def lease_and_alive_go_on_at_the_far_pace() -> None:
    """They go on once in the far heartbeat period while their content is the same, and immediately when it changes."""
    pe = PeUnderTest(_GATEWAY).attended()
    began_ns = pe.run(2000)
    for identifier in (_LEASE_ID, _ALIVE_ID):
        times = moments(pe.far.since(began_ns, [identifier]))
        demand(39 <= len(times) <= 41, f"{len(times)} frames under {identifier} on a bus of 50 ms in two seconds")
        demand(max(gaps(times)) <= 62 * MS, f"frames under {identifier} are {max(gaps(times)) / MS} ms apart")
    pe.lease = Lease(5, 0, Step.PREPARED, 7)
    pe.alive = frozenset((NODE, FAR))
    began_ns = pe.run(25)
    for identifier in (_LEASE_ID, _ALIVE_ID):
        first_ns = pe.far.since(began_ns, [identifier])[0].t_ns
        demand(first_ns - began_ns < 22 * MS, f"a change of {identifier} waits for {(first_ns - began_ns) / MS} ms")


def commands_from_beyond_are_refused() -> None:
    """A command from the far bus is counted, and neither executed nor forwarded."""
    pe = PeUnderTest(_GATEWAY).attended()
    began_ns = pe.run_into_next_period(8)
    pe.far.command(Ping(5, NODE, 0), Lease(9, 1, Step.GO_ALL, 1), Alive(5, 0, frozenset()), Prepare(9, 1, 1))
    pe.far.say(Frame(0, bytes((2, NODE))))
    pe.run(4)
    equal(pe.pages_0(began_ns), [], "pages 0 after a PING from beyond")
    equal(pe.main.since(began_ns, [management_id(126, command) for command in Command]), [], "commands from beyond")
    pe.run(25)
    demand(PeFlags.HEARS_LEASE in pe.pinged().flags, "a term from beyond is accepted")


def what_nodes_beyond_say_is_handed_up() -> None:
    """It forwards states, EMCY, emergency events, heartbeats and echoes of nodes beyond, and gateways' reports only."""
    pe = PeUnderTest(_GATEWAY).attended()
    page = StatePage0(PeState.ACTIVE, PeFlags.HEARS_LEASE, 1, 0, 0, 0).encode()
    told = (state_id, emcy_id, emergency_event_id, heartbeat_id, actuator_echo_id)
    for node, is_beyond in ((FAR, True), (FAR + 1, False), (NEIGHBOUR, False)):
        for identify in told:
            began_ns = pe.run_into_next_period(8)
            frame = Frame(identify(node), page)
            pe.far.say(frame)
            pe.run(3)
            found = [one.frame for one in pe.main.since(began_ns, [frame.can_id])]
            equal(found, [frame] if is_beyond else [], f"handed up of {frame.can_id}")
            equal(pe.far.since(began_ns, [frame.can_id]), [], "handed back")
            began_ns = pe.run_into_next_period(8)
            pe.main.say(frame)
            pe.run(3)
            equal(pe.far.since(began_ns, [frame.can_id]), [], f"handed down of {frame.can_id}")
    report = Frame(GATEWAY_IDS[3], LinkReport(FAR, LinkState.UP, 1, 1000, 100, 0, 0).encode())
    began_ns = pe.run_into_next_period(8)
    pe.far.say(report)
    pe.run(3)
    equal([one.frame for one in pe.main.since(began_ns, [report.can_id])], [report], "a report from beyond")


def data_are_handed_on_as_wired() -> None:
    """It forwards sources that the slice names, from the node and to the buses that it names, and never back."""
    pe = PeUnderTest(_GATEWAY).attended()
    pe.flies(Slice(forward={OTHER_HEIGHT: (NEIGHBOUR, 2), DEMAND: (FAR, 3)}))
    began_ns = pe.run_into_next_period(8)
    wired, others = datum(OTHER_HEIGHT_ID, 1.0), datum(OTHER_HEIGHT_ID, 2.0, node=NEIGHBOUR + 1)
    pe.main.say(wired, others, datum(HEIGHT_ID, 3.0))
    pe.far.say(datum(DEMAND_ID, 4.0, node=FAR))
    pe.run(5)
    data = [OTHER_HEIGHT_ID, HEIGHT_ID, DEMAND_ID]
    equal([one.frame for one in pe.far.since(began_ns, data)], [wired], "data on the far bus")
    equal([one.frame.can_id for one in pe.main.since(began_ns, data)], [DEMAND_ID], "data on the main bus")
    pe.flies(Slice((ModuleSlice(0, 0, ()),), publish={0: 3}), _EPOCH + 1, _DIGEST + 1)
    puppets.behave_normally()
    began_ns = pe.run_into_next_period(8)
    pe.main.say(wired)
    pe.run(200)
    equal(pe.far.since(began_ns, [OTHER_HEIGHT_ID]), [], "data that are not wired any more")
    equal(len(pe.data(HEIGHT_ID, began_ns, pe.far)), len(pe.data(HEIGHT_ID, began_ns)), "data on both buses")
    demand(len(pe.data(HEIGHT_ID, began_ns)) >= 9, "data on both buses")


def what_it_reads_itself_is_handed_on_too() -> None:
    """From GO on its own inputs are forwarded, too; at BREAK no frame is on the far bus that was not there before."""
    pe = PeUnderTest(_GATEWAY).attended()
    reads = Slice((ModuleSlice(LAMP, 0, (DEMAND,)),), remote={DEMAND: NEIGHBOUR})
    pe.flies(reads)
    pe.prepare(_EPOCH + 1, replace(reads, forward={DEMAND: (NEIGHBOUR, 2)}), _DIGEST + 1)
    pe.run(10)
    read = datum(DEMAND_ID, 1.0)
    for step, handed_on in ((Step.BREAK, []), (Step.GO, [read])):
        pe.activate(_EPOCH + 1, step, _DIGEST + 1)
        began_ns = pe.run_into_next_period(8)
        pe.main.say(read)
        pe.run(3)
        found = [one.frame for one in pe.far.since(began_ns, [DEMAND_ID])]
        equal(found, handed_on, f"what it reads itself, on the far bus after {step.name}")


def _reports(pe: PeUnderTest, since_ns: int) -> list[tuple[int, LinkReport]]:
    found = []
    for t_ns, frame in pe.main.since(since_ns, [_LINK_ID]):
        report = decode_link(frame.data)
        assert isinstance(report, LinkReport)
        found.append((t_ns, report))
    return found


class _Beyond:
    """Node 100 beyond the radio, which sends every 100 ms."""

    def __init__(self, pe: PeUnderTest) -> None:
        self.speaks, self.skips, self.loses = True, 0, 0  # loses: so many frames before each that comes
        self.beside: tuple[Frame, ...] = ()  # what it sends beside its page 0
        self.said_ns = 0
        self._pe, self._sequence = pe, 0
        self._beat()

    def _beat(self) -> None:
        self._sequence += 1 + self.loses
        if self.skips and self._sequence % self.skips == 0:
            self._sequence += 1
        if self.speaks:
            page = StatePage0(PeState.UNCONFIGURED, PeFlags.HEARS_LEASE, 1, 0, self._sequence % 256, 0)
            self._pe.far.say(Frame(state_id(FAR), page.encode()))
            self._pe.far.say(*self.beside)
            self.said_ns = self._pe.now_ns
        self._pe.clock.at(self._pe.now_ns + 25 * MS, self._beat)


def a_radio_is_reported_on() -> None:
    """A report comes once in the radio's period, with a sequence; without a gap, all bandwidth is usable."""
    pe = PeUnderTest(_RADIO)
    _Beyond(pe)
    pe.attended()
    began_ns = pe.run(3000)
    reports = _reports(pe, began_ns)
    demand(29 <= len(reports) <= 31, f"{len(reports)} reports in three seconds")
    apart = gaps(moments(reports))
    demand(all(abs(gap - 100 * MS) < 2 * MS for gap in apart), f"reports are {apart} ns apart")
    sequences = [report.sequence for _, report in reports]
    equal(sequences, [(sequences[0] + number) % 64 for number in range(len(sequences))], "sequences")
    equal({one.state for _, one in _reports(pe, -1)}, {LinkState.UP}, "what is said of a good radio from the start")
    for _, report in reports[12:]:
        told = report.node, report.state, report.usable, report.delivered, report.dropped
        equal(
            told,
            (NODE, LinkState.UP, 1000, 100, 0),
            "node, state, usable, delivered and dropped of a good radio",
        )


def a_radio_that_loses_frames_is_told_so() -> None:
    """Gaps in the sequences are losses: if every fourth frame is lost, three quarters are reported."""
    pe = PeUnderTest(_RADIO)
    beyond = _Beyond(pe)
    pe.attended()
    pe.run(2000)
    beyond.skips = 4
    pe.run(1500)
    report = _reports(pe, -1)[-1][1]
    demand(70 <= report.delivered <= 80, f"with every fourth frame lost {report.delivered} % are delivered")
    demand(700 <= report.usable <= 800, f"with every fourth frame lost {report.usable} thousandths are usable")
    beyond.skips = 0
    pe.run(1500)
    equal(_reports(pe, -1)[-1][1].delivered, 100, "delivered, when nothing is lost any more")
    beyond.loses = 4
    pe.run(400)
    report = _reports(pe, -1)[-1][1]
    demand(report.usable < 250, f"four of five are lost, and {report.usable} thousandths are reported as usable")
    demand(report.delivered > 30, "a window of ten periods forgets in four what came before")


def a_slow_radio_is_told_so() -> None:
    """The radio's capacity is the bits that it carries while a frame is in the controller, divided by that time."""
    pe = PeUnderTest(_RADIO)
    _Beyond(pe)
    pe.attended()
    pe.run(1500)
    pe.far.bus.slowdown = 4
    pe.run(350)
    demand(_reports(pe, -1)[-1][1].usable < 500, "that a radio becomes much slower is reported too late")
    pe.run(1150)
    report = _reports(pe, -1)[-1][1]
    demand(200 <= report.usable <= 330, f"of a radio that is four times slower {report.usable} thousandths are usable")
    pe.far.bus.slowdown = 1
    pe.run(1500)
    demand(_reports(pe, -1)[-1][1].usable >= 950, "a radio that is well again is not told so")


def a_radio_that_is_silent_is_gone() -> None:
    """Silence for the allowed periods and an eighth is reported; the first frame ends it, and measuring begins anew."""
    pe = PeUnderTest(_RADIO)
    beyond = _Beyond(pe)
    pe.attended()
    pe.run(2000)
    beyond.speaks = False
    last_ns = beyond.said_ns + 1_350_000  # when its last frame had come
    began_ns = pe.run(700)
    gone = [(t_ns, one) for t_ns, one in _reports(pe, began_ns) if one.state is LinkState.GONE]
    demand(bool(gone), "a radio that is silent is not gone")
    after_ms = (gone[0][0] - last_ns) / MS
    demand(411.4 < after_ms < 414.5, f"a radio that is silent is gone after {after_ms} ms")
    equal({one.usable for _, one in gone}, {0}, "usable of a radio that is gone")
    beyond.speaks = True
    began_ns = pe.run(30)
    back = _reports(pe, began_ns)
    demand(bool(back) and back[0][1].state is LinkState.UP, "that a radio is back is not reported immediately")
    demand(back[0][0] - began_ns < 28 * MS, "a radio that is back is told so late")
    pe.run(600)
    equal(_reports(pe, -1)[-1][1].usable, 1000, "usable of a radio that is back")


def what_goes_to_a_radio_waits_in_turn() -> None:
    """Only the newest datum of each source waits, and the most urgent goes first; newer data displace no command."""
    pe = PeUnderTest(_RADIO)
    _Beyond(pe)
    pe.attended()
    pe.flies(Slice(forward={OTHER_HEIGHT: (NEIGHBOUR, 2), 0: (NEIGHBOUR, 2)}))
    pe.run(1000)
    pe.far.bus.break_wire()
    began_ns = pe.run(20)
    for number in range(6):
        pe.main.say(datum(OTHER_HEIGHT_ID, float(number), code=number))
        pe.run(3)
        if number == 2:
            pe.main.say(datum(HEIGHT_ID, 9.0))
    pe.main.command(Control(5, FAR, Operation.CLEAR, 1, 1), Control(5, FAR, Operation.CLEAR, 1, 2))
    pe.run(3)
    pe.far.bus.mend_wire()
    pe.run(60)
    equal([d.value for _, d in pe.data(HEIGHT_ID, began_ns, pe.far)], [9.0], "what a radio gets of another source")
    values = [d.value for _, d in pe.data(OTHER_HEIGHT_ID, began_ns, pe.far)]
    demand(len(values) <= 2 and values[-1:] == [5.0], f"what a radio gets of a source after a break: {values}")
    controls = [one.frame.data[7] for one in pe.far.since(began_ns, [management_id(126, Command.CONTROL)])]
    equal(controls, [1, 2], "commands after a break")


def what_moves_away_is_not_sent_by_radio() -> None:
    """At BREAK, frames of a source that moves away, which wait because the radio carries nothing, are withdrawn."""
    pe = PeUnderTest(_RADIO)
    _Beyond(pe)
    pe.attended()
    puppets.behave_normally()
    pe.flies(Slice((ModuleSlice(HELPER, 0, ()),), publish={HELP: 3}))
    pe.prepare(_EPOCH + 1, NOTHING, _DIGEST + 1)
    began_ns = pe.run(500)
    demand(bool(pe.data(HELP_ID, began_ns, pe.far)), "nothing goes by radio")
    pe.far.bus.break_wire()
    pe.run(30)
    pe.activate(_EPOCH + 1, Step.BREAK, _DIGEST + 1)
    pe.run(3)
    pe.far.bus.mend_wire()
    began_ns = pe.run(60)
    equal(pe.data(HELP_ID, began_ns, pe.far), [], "data of what has moved away, on the radio")


def commands_wait_longer_than_data() -> None:
    """Commands wait for five periods of the radio; frames that are useless when they are old wait for T_lease."""
    for silent_ms, comes in ((400, True), (600, False)):
        pe = PeUnderTest(_RADIO)
        _Beyond(pe)
        pe.attended()
        pe.run(1000)
        pe.far.bus.break_wire()
        began_ns = pe.run(20)
        pe.main.command(Control(5, FAR, Operation.CLEAR, 1, 1))
        pe.run(silent_ms)
        pe.far.bus.mend_wire()
        pe.run(300)
        found = pe.far.since(began_ns, [management_id(126, Command.CONTROL)])
        equal(len(found), int(comes), f"commands after a radio that carried nothing for {silent_ms} ms")


def after_a_pause_a_radio_is_reported_on_again() -> None:
    """The first report comes immediately, the next in the old period; reports that were missed are not made up."""
    pe = PeUnderTest(_RADIO)
    _Beyond(pe)
    pe.attended()
    pe.run(1000)
    pe.pe.pause(350 * MS)
    pe.run(350)
    reports = _reports(pe, pe.run(700))
    demand(7 <= len(reports) <= 9, f"{len(reports)} reports in the seven periods after a pause")


def data_keep_to_their_share_of_a_radio() -> None:
    """Of a radio of 100 kbit/s data take 70 kbit/s, in longest frames, and eight frames more after any silence."""
    pe = PeUnderTest(_RADIO)
    _Beyond(pe)
    pe.attended()
    pe.flies(Slice(forward=dict.fromkeys(range(5), (NEIGHBOUR, 2))))
    identifiers = [source.identifier for source in TABLE.sources]
    count = [0]

    def flood() -> None:
        count[0] += 1
        pe.main.say(*(datum(identifier, 1.0, code=count[0] % 256) for identifier in identifiers))
        pe.clock.at(pe.now_ns + 4 * MS, flood)

    pe.run(2000)
    began_ns = pe.now_ns
    flood()
    pe.run(200)
    bits = 135 * len(pe.far.since(began_ns, identifiers))
    demand(bits <= 70_000 // 5 + 9 * 135, f"data took {bits} bits of a radio in 200 ms")
    pe.run(800)
    began_ns = pe.run(2000)
    bits = 135 * len(pe.far.since(began_ns, identifiers))
    demand(120_000 <= bits <= 145_000, f"data took {bits / 2} bits a second of a radio that leaves them 70000")
    leases = len(pe.far.since(began_ns, [_LEASE_ID]))
    demand(18 <= leases <= 22, f"{leases} LEASEs in two seconds beside a flood of data")
    dropped = [one.dropped for _, one in _reports(pe, began_ns)]
    demand(dropped == sorted(dropped) and dropped[-1] > dropped[0], "what is given up for a radio is not counted")


def a_frame_that_cannot_leave_is_given_up() -> None:
    """It is dropped after a period; if frames were heard meanwhile, new frames go, and little bandwidth is lost."""
    pe = PeUnderTest(_RADIO)
    _Beyond(pe)
    pe.attended()
    pe.run(2000)
    began_ns = pe.now_ns

    def flood() -> None:
        """Keep the radio full of more urgent frames."""
        pe.far.say(Frame(1, bytes(8)), Frame(1, bytes(8)))
        if pe.now_ns < began_ns + 250 * MS:
            pe.clock.at(pe.now_ns + 2 * MS, flood)

    flood()
    pe.run(400)
    usable = [one.usable for _, one in _reports(pe, began_ns)]
    demand(min(usable) >= 900, f"of a radio that is full {usable} thousandths are usable")
    began_ns = pe.run(500)
    demand(len(pe.pages_0(began_ns, pe.far)) >= 4, "after a flood its pages 0 do not come")
    demand(min(one.usable for _, one in _reports(pe, began_ns)) >= 900, "a flood has made the radio worse")


def only_what_is_numbered_shows_losses() -> None:
    """Pages 1, frames of a few bytes and heartbeats have no sequence: what stands in its byte is no gap."""
    pe = PeUnderTest(_RADIO)
    beyond = _Beyond(pe)
    page_1 = StatePage1(PeState.UNCONFIGURED, PeFlags.HEARS_LEASE, 0, 0x77, Reason.NONE, 0).encode()
    beyond.beside = (Frame(state_id(FAR), page_1), Frame(state_id(FAR), b"\0\1\2"), Frame(heartbeat_id(FAR), bytes(8)))
    pe.attended()
    pe.run(2500)
    equal({report.delivered for _, report in _reports(pe, 1500 * MS)}, {100}, "delivered, of what is not numbered")


def a_gateway_s_own_word_goes_by_radio_too() -> None:
    """It sends both pages of its state over the radio, the newest of each, and its heartbeat once a second."""
    pe = PeUnderTest(_RADIO)
    _Beyond(pe)
    pe.attended()
    began_ns = pe.run(4000)
    demand(38 <= len(pe.pages_0(began_ns, pe.far)) <= 41, "its pages 0 on the radio")
    demand(3 <= len(pe.pages_1(began_ns, pe.far)) <= 5, "its pages 1 on the radio")
    demand(3 <= len(pe.far.since(began_ns, [heartbeat_id(NODE)])) <= 5, "its heartbeats on the radio")
