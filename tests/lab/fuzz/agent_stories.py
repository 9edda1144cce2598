"""Stories for the cores of a PE: frames of any kind, true commands, time, and the answers of modules.

A story encodes events in single bytes, so that cutting it, doubling a piece or changing a byte gives another story.
After each event the core's invariants are checked. A PE with a key has been welcomed before the story begins, and true
commands are tagged: otherwise no command would pass the first check.
"""

from functools import cache, partial

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.authority import Secret
from heronry_agent.core.canopen import SdoServer
from heronry_agent.core.vocabulary import (
    Action,
    Drive,
    DriveFailed,
    Driven,
    Event,
    ImagesMissing,
    Left,
    NotReady,
    PartitionEnded,
    StartFailed,
    StepFailed,
    StepMeasured,
    StepModule,
    Stepped,
)
from heronry_agent.shell.table_waiting import WaitingCore
from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_manager.core.tables import Compiler
from heronry_tools.sim.world.planning import immediate_plan
from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import (
    FIRST_PE,
    GATEWAY_IDS,
    MANAGER_NODES,
    NMT_ID,
    Command,
    emcy_id,
    management_id,
    sdo_request_id,
    state_id,
)
from heronry_wire.management import (
    Activate,
    Alive,
    Control,
    Lease,
    ManagementMessage,
    Operation,
    Ping,
    Prepare,
    SliceHead,
    Step,
)
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Received, Tick
from heronry_wire.sdo import MESSAGE_BYTES, Abort
from lab.fuzz.target import Story, Target
from lab.peers import PlayedManager, SteppedCore, nonces_in, slice_messages

KEY = Key(bytes(KEY_BYTES))
MOST_EVENTS = 96
_MOST_TICKS = 200
_MS = 1_000_000
_TERM = 1
_OUTPUTS = (0.5, 7, -1, "text", b"bytes", (1, 2), float("nan"), 1e300, 1 << 70)
_STRANGE = (NMT_ID, 1, 92, 128, 129, 300, 326, 1536, 1920, GATEWAY_IDS[0], 2000, 2047)
_OPERATIONS = tuple(Operation)


class _Pe(SteppedCore[Event, Action]):
    """One core, its time, and the commands that a true manager could send to it."""

    def __init__(self, spec: str, pe: str, key: Key | None) -> None:
        self.table, self._slices = _prepared(spec, pe)
        secret = None if key is None else Secret(key, b"salt")
        super().__init__(AgentCore(self.table, 1, _MS, secret=secret), _MS)
        self.core: AgentCore
        self._managers = {term: PlayedManager(term=term, key=key) for term in range(_TERM, _TERM + 3)}
        self._steps: list[tuple[int, int]] = []  # not answered yet
        self._drives: list[Drive] = []
        if key is not None:
            nonces: list[int] = []
            while not nonces:
                nonces = self.nonces(20 * _MS, self.table.node_id)
            self.hear(*self._managers[_TERM].welcome(self.table.node_id, nonces[0]), port=self.table.uplink)

    def give(self, event: Event | Received | Tick) -> list[Action]:
        """Process an event at the present time."""
        actions = super().give(event)
        self.core.validate()
        self._steps += [(one.module, one.release) for one in actions if isinstance(one, StepModule)]
        self._drives += [one for one in actions if isinstance(one, Drive)]
        return actions

    def tell(self, story: Story) -> None:
        """Make the next event of the story happen."""
        match story.number(16):
            case 0 | 1:
                self.pass_time(story.number(1 << 16) * 10_000, most_ticks=_MOST_TICKS)
            case 2 | 3 | 4 | 5:
                self._command(story)
            case 6 | 7:
                self._hear(story, self._known_id(story))
            case 8:
                self._hear(story, story.number(0x800))
            case 9 | 10 | 11:
                self._answer(story)
            case 12:
                self._fail(story)
            case 13 if self._drives:
                drive = self._drives.pop()
                self.give(DriveFailed(drive.module, "oops") if story.number(2) else Driven(drive.module, drive.value))
            case 14 if self.core.radio_ports:
                self.give(Left(min(self.core.radio_ports), story.number(1 << 24) * 10))
            case _:
                self.give(Tick())

    def _known_id(self, story: Story) -> int:
        node = story.number(34) + 92
        of_nodes = (state_id(node), emcy_id(node), sdo_request_id(self.table.node_id))
        manager = MANAGER_NODES[story.number(2)]
        known = (*of_nodes, *_STRANGE, *(management_id(manager, command) for command in Command))
        sources = [source.identifier for source in self.table.sources]
        return (*known, *sources)[story.number(256) % (len(known) + len(sources))]

    def _hear(self, story: Story, identifier: int) -> None:
        kind, port = story.number(32), story.number(256) % len(self.table.ports)
        frame = Frame(identifier, story.bytes(kind % 9), extended=kind == 31, remote=kind == 30, error=kind == 29)
        self.give(Received(port, frame, story.number(4) * _MS))

    def _command(self, story: Story) -> None:
        term = _TERM + story.number(3)
        self.hear(*self._managers[term].frames(*self._messages(story, term)), port=self.table.uplink)

    def _messages(self, story: Story, term: int) -> list[ManagementMessage]:
        """Return a command that a manager might send; most digests belong to epochs, and most slices are whole."""
        epoch, node = story.number(4), self.table.node_id
        digest, step = 1000 + epoch, Step(story.number(4))
        match story.number(8):
            case 0:
                return [Lease(term, epoch, step, digest)]
            case 1:
                return [Alive(term, 0, frozenset({node} if story.number(4) else ()))]
            case 2:
                return [Prepare(term, epoch, digest, story.number(3))]
            case 3 | 4:
                body = self._slices[story.number(256) % len(self._slices)]
                head, *bodies = slice_messages(node, epoch, body, self.table.identity)
                return [Prepare(term, epoch, digest), head, *bodies[story.number(2) :]]
            case 5:
                return [Activate(term, epoch, step, digest)]
            case 6:
                return [Ping(term, node, 0), SliceHead(node, epoch, story.number(2000), digest)]
            case _:
                operation = _OPERATIONS[story.number(256) % len(_OPERATIONS)]
                return [Control(term, node * story.number(2), operation, story.number(5), story.number(1 << 16))]

    def _answer(self, story: Story) -> None:
        """Let a module end a step, with correct outputs or wrong ones."""
        if not self._steps:
            return
        module, release = self._steps.pop()
        names = list(self.table.variables)
        given = [names[story.number(256) % len(names)] for _ in range(story.number(4))]
        outputs = {name: _OUTPUTS[story.number(256) % len(_OUTPUTS)] for name in given}
        reports = ((f"device:{self.table.devices[0].name}", story.number(1 << 16)),) if story.number(8) == 1 else ()
        phases = ("cruise",) if story.number(8) == 1 else ()
        writes = (_OUTPUTS[story.number(256) % len(_OUTPUTS)],) if story.number(2) else ()
        self.give(Stepped(module, release, outputs, writes, reports, phases, story.number(1 << 16) * 1_000))

    def _fail(self, story: Story) -> None:
        module, release = self._steps.pop() if self._steps else (story.number(64), story.number(64))
        events: tuple[Event, ...] = (
            StepFailed(module, release, "oops"),
            StartFailed(module, "oops"),
            NotReady(module, release),
            StepMeasured(module, release, story.number(1 << 24)),
            PartitionEnded("flight", "it ended", module if story.number(2) else None),
            ImagesMissing({"servo_driver_1": "no\x1b[2J such code"}),
        )
        self.give(events[story.number(256) % len(events)])


@cache
def _prepared(name: str, pe: str) -> tuple[PeTable, list[bytes]]:
    """Return the table of a PE of a shipped spec, and its slices of some configurations."""
    spec = load(shipped_spec_path(name))
    compiler, phase = Compiler(spec), spec.initial_phase()
    table = compiler.table(pe)
    lost = [frozenset[str](), *(frozenset({f"device:{device}"}) for device in spec.devices)]
    plans = [immediate_plan(spec, Situation(down, {}, phase), None) for down in lost]
    return table, [b"", *(compiler.configuration(one.configuration).slices[table.node_id] for one in plans)]


def _agent(spec: str, pe: str, key: Key | None, data: bytes) -> None:
    """Tell a story to the agent of a PE."""
    one, story = _Pe(spec, pe, key), Story(data)
    for _ in range(MOST_EVENTS):
        if not story:
            break
        one.tell(story)


def _waiting(key: Key | None, data: bytes) -> None:
    """Tell a story to a node that waits for its table: frames under the identifiers that it receives, and time."""
    story, node = Story(data), FIRST_PE
    core = WaitingCore(node, 1_000_000, _MS, None if key is None else Secret(key, b"salt"))
    one, manager, known = SteppedCore(core, _MS), PlayedManager(term=_TERM, key=KEY), list(core.identifiers)
    for _ in range(MOST_EVENTS):
        kind = story.number(8)
        if kind == 0:
            one.now_ns = max(one.now_ns + story.number(1 << 16) * 10_000, core.next_deadline_ns())
            actions = one.give(Tick())
        elif kind == 1:
            operation = _OPERATIONS[story.number(256) % len(_OPERATIONS)]
            actions = one.hear(*manager.frames(Control(_TERM, node, operation, 9)))
        elif kind < 5:
            actions = one.hear(Frame(sdo_request_id(node), story.bytes(MESSAGE_BYTES)))
        else:
            actions = one.hear(Frame(known[story.number(256) % len(known)], story.bytes(story.number(9))))
        for nonce in nonces_in(actions, node):
            one.hear(*manager.welcome(node, nonce))


class _Shelf:
    """One object of each kind: readable, writable, too long, missing."""

    def __init__(self) -> None:
        self.values = {0x2000: b"\1\2\3\4", 0x2001: b"a text", 0x2002: bytes(300)}

    def read(self, index: int, sub_index: int) -> bytes | Abort:
        """Return the value of an object, or the abort code."""
        return Abort.NO_SUB_INDEX if sub_index else self.values.get(index, Abort.NO_OBJECT)

    def room(self, index: int, sub_index: int, length: int | None) -> int | Abort:
        """Return the largest number of bytes that may be written, or the abort code."""
        found = self.read(index, sub_index)
        if isinstance(found, Abort):
            return found
        return Abort.LENGTH if length is not None and length > len(found) else len(found)

    def write(self, index: int, _sub_index: int, data: bytes) -> Abort | None:
        """Store a value, which fits: `room` was called before."""
        if len(data) > len(self.values[index]):
            raise AssertionError(f"{len(data)} bytes were written where there is room for {len(self.values[index])}")
        return None


def _sdo(data: bytes) -> None:
    """Give requests, and time, to an SDO server alone."""
    server, story, now_ns = SdoServer(_Shelf(), _MS), Story(data), _MS
    for _ in range(MOST_EVENTS):
        if not story:
            break
        answer = server.request(story.bytes(MESSAGE_BYTES), now_ns)
        if answer is not None and len(answer) != MESSAGE_BYTES:
            raise AssertionError(f"an answer has {len(answer)} bytes")
        now_ns += story.number(1 << 16) * 20_000
        server.tick(now_ns)


def _whole_flight() -> list[bytes]:
    """Return a story in which a slice is staged and activated, modules answer, and time passes."""
    prepared = bytes((2, 0, 1, 0, 3, 1, 0))  # term, epoch, step, what: PREPARE, head and all bodies of slice 1
    activated = bytes((2, 0, 1, 3, 5))
    lease = bytes((2, 0, 1, 3, 0))
    alive = bytes((2, 0, 1, 3, 1, 1))
    passes = bytes((0, 8, 0))
    answers = bytes((9, 1, 0, 0, 1, 0, 0, 0, 1))
    return [prepared + activated + (alive + lease + passes + answers * 3) * 4]


_READS, _WRITES = ("4001200000000000", "6000000000000000"), ("2101200006000000", "0b61206e6577206f")
_BLOCK = ("c602200009000000", "0131323334353637", "8238390000000000", "d500000000000000")
_FETCHES = ("a4022000200a0000", "a300000000000000", "a20a200000000000", "a100000000000000")


def _transfers() -> list[bytes]:
    """Return requests of whole transfers, each with a pause after it: by segment and by block, both ways."""
    return [b"".join(bytes.fromhex(text) + b"\0\1" for text in one) for one in (_READS, _WRITES, _BLOCK, _FETCHES)]


def _table_is_given() -> list[bytes]:
    """Return a story in which a manager sends, unlocks the node, and a client begins to write and to read a table."""
    unlocks = bytes((1, 4))
    begins = [bytes((2, *bytes.fromhex(text))) for text in ("2120200009000000", "c620200009000000", "4020200000000000")]
    return [unlocks * 3 + begin + bytes((3, 0)) + bytes(7) for begin in begins]


STORIES = (
    Target("agent", partial(_agent, "elevator_and_chute", "tail_pe", None), _whole_flight),
    Target("keyed_agent", partial(_agent, "elevator_and_chute", "tail_pe", KEY), _whole_flight),
    Target("gateway", partial(_agent, "big_blue", "comms", None), _whole_flight),
    Target("keyed_gateway", partial(_agent, "big_blue", "comms", KEY), _whole_flight),
    Target("waiting", partial(_waiting, None), _table_is_given),
    Target("keyed_waiting", partial(_waiting, KEY), _table_is_given),
    Target("sdo", _sdo, _transfers),
)
