"""One real PE; the test plays the rest of its aircraft: a manager, a neighbour, the nodes beyond a gateway.

The PE is node 95 on `main` (1 Mbit/s, 20 ms). The played nodes send by themselves in each period, until the test
changes that: `lease` and `alive` of manager 126, and the page 0 of neighbour 93. Setting one of them to None stops it.

    module       where            does
    gauge        fixed, sensor    gives height
    servo        DEMUX branch     drives the actuator
    control      movable          in `fine` reads height and gives demand 1; in `coarse` gives demand 2
    lamp         fixed            an output that drives nothing: reads demand, of either version
    helper       fixed            gives help; built anew twice if it fails
    other        on node 93       gives its own height
"""

from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from heronry_agent.core.authority import Secret
from heronry_agent.core.vocabulary import Action, Event, Heard, ModuleEvent, Note, NotReady, StepModule
from heronry_agent.module import Value
from heronry_tools.aircraft.plant import Plant
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.simulated_pe import SimulatedPe
from heronry_wire.authentication import Key
from heronry_wire.canaerospace import DataType, Datum, Status, Validity, decode_data, encode_data, pack_status
from heronry_wire.canopen_objects import COUNTERS
from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.contingency_block import Preloaded, write_block
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identifiers import FIRST_MANAGER, actuator_echo_id, emcy_id, sdo_request_id, sdo_response_id, state_id
from heronry_wire.management import (
    Activate,
    Alive,
    Emergency,
    FaultCode,
    Lease,
    Ping,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
    decode_emergency,
)
from heronry_wire.pe_table import (
    DeviceEntry,
    LeafEntry,
    ModeEntry,
    ModuleEntry,
    PeTable,
    PhaseEntry,
    Port,
    SourceEntry,
    VariableEntry,
)
from heronry_wire.protocol_version import PROTOCOL
from heronry_wire.sdo import UPLOAD, with_data
from heronry_wire.silence import Silence
from heronry_wire.state_frames import (
    PeFlags,
    PeState,
    Reason,
    StatePage0,
    StatePage1,
    StatePage2,
    StatePage3,
    decode_state,
)
from lab.conformance import puppets
from lab.conformance.player import MS, SOON_NS, Player, UnderTest, demand, equal
from lab.peers import slice_messages

NODE, NEIGHBOUR, FAR = 95, 93, 100
PERIOD_NS, LEASE_NS = 20 * MS, 100 * MS
PLACE_NS = 3 * PERIOD_NS // 34  # of node 95 in the period: (n - 92) / 34 of it
INCARNATION = 7
GIVEN_BACK_NS = 5 * MS

GAUGE, SERVO, CONTROL, LAMP, HELPER, OTHER = range(6)
HEIGHT, DEMAND, HELP, OTHER_HEIGHT, CALL = range(5)  # sources
HEIGHT_ID, DEMAND_ID, HELP_ID, OTHER_HEIGHT_ID, CALL_ID = 322, 1536, 1537, 1538, 1539
SERVO_DEVICE, RUDDER_DEVICE = 1, 2
_PUPPET = "lab.conformance.puppets:Puppet"


def _module(index: int, name: str, *modes: ModeEntry, **more: object) -> ModuleEntry:
    plain = ModuleEntry(index, name, _PUPPET, None, False, False, modes, partition=name)
    return replace(plain, **more)  # type: ignore[arg-type]


def _mode(name: str, rate_mhz: int, *leaves: LeafEntry, **gives: int) -> ModeEntry:
    return ModeEntry(name, rate_mhz, 100, leaves, gives)


_DEMAND_LEAF = LeafEntry("", "demand", 1, 2)
MAIN = Port("main", 1_000_000, PERIOD_NS, 3, wireless=False, channels=1, nodes=(NEIGHBOUR,))
TABLE = PeTable(
    protocol=PROTOCOL,
    spec="trial",
    spec_digest="5e" * 32,
    name="one",
    node_id=NODE,
    cpu_millis=500,
    without_manager="keep",
    uplink=0,
    ports=(MAIN,),
    modules=(
        _module(GAUGE, "gauge", _mode("only", 50_000, height=1), device="gauge_sensor"),
        _module(SERVO, "servo", _mode("only", 50_000, _DEMAND_LEAF), device="servo_motor", demux=True),
        _module(
            CONTROL,
            "control",
            _mode("fine", 50_000, LeafEntry("", "height", 1, 1), demand=1),
            _mode("coarse", 25_000, demand=2),
            movable=True,
        ),
        _module(LAMP, "lamp", _mode("only", 10_000, _DEMAND_LEAF), silent_output=True),
        _module(HELPER, "helper", _mode("only", 50_000, help=1, call=1), restarts=2),
    ),
    sources=(
        SourceEntry("gauge", "height", HEIGHT_ID, 20 * MS),
        SourceEntry("control", "demand", DEMAND_ID, 40 * MS),
        SourceEntry("helper", "help", HELP_ID, 20 * MS),
        SourceEntry("other", "height", OTHER_HEIGHT_ID, 20 * MS),
        SourceEntry("helper", "call", CALL_ID, 20 * MS),
    ),
    variables={
        "height": VariableEntry("FLOAT", None),
        "demand": VariableEntry("FLOAT", 0.25),
        "help": VariableEntry("UCHAR", None),
        "call": VariableEntry("NODATA", None),
    },
    devices=(
        DeviceEntry("gauge_sensor", "sensor", NODE),
        DeviceEntry("servo_motor", "actuator", NODE),
        DeviceEntry("rudder_motor", "actuator", NEIGHBOUR),
    ),
    module_names=("gauge", "servo", "control", "lamp", "helper", "other"),
    phases=(
        PhaseEntry("climb"),
        PhaseEntry("cruise", "height", above=100.0, hold_ns=200 * MS),
        PhaseEntry("land", "height", below=10.0, hold_ns=100 * MS),
    ),
    flight_critical=("module:servo", "device:servo_motor"),
)

EVERYTHING = Slice(
    (
        ModuleSlice(GAUGE, 0, ()),
        ModuleSlice(SERVO, 0, (DEMAND,)),
        ModuleSlice(CONTROL, 0, (HEIGHT,)),
        ModuleSlice(LAMP, 0, (DEMAND,)),
        ModuleSlice(HELPER, 0, ()),
    ),
    publish={HEIGHT: 1, DEMAND: 1, HELP: 1, CALL: 1},
)
NOTHING = Slice()


def with_plans_on_board(table: PeTable, *plans: tuple[Slice, int]) -> PeTable:
    """Return a table that has these slices on board, from number 1 on, with the digests of their configurations."""
    block = write_block([Preloaded(part.encode(), digest) for part, digest in plans])
    return replace(table, contingencies=b64encode(block).decode())


class PuppetPlant(Plant):
    """A plant whose devices read and accept what the test sets."""

    def __init__(self) -> None:
        super().__init__(0)
        self.written: list[Value] = []
        self.readings: dict[str, Value] = {}
        self.takes = True

    def read(self, device: str, now_ns: int) -> Value | None:  # noqa: ARG002
        """Return the reading of a device, as the test has set it."""
        return self.readings.get(device)

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:  # noqa: ARG002
        """Move an actuator."""
        if not self.takes:
            raise TypeError(f"{device} takes nothing")
        self.written.append(value)
        return value


class _Pe(SimulatedPe):
    """A PE that keeps its notes and the echoes that move its plant; it can refuse to execute a step."""

    notes: list[tuple[str, str]]
    followed: list[tuple[str, float]]
    gives_back: list[int]  # modules whose next step is given back after GIVEN_BACK_NS

    def _do(self, action: Action) -> ModuleEvent | None:
        if isinstance(action, StepModule) and action.module in self.gives_back:
            self.gives_back.remove(action.module)
            again = NotReady(action.module, action.release)
            self._clock.at(self._clock.now_ns + GIVEN_BACK_NS, lambda: self.give(again))
            return None
        if isinstance(action, Note):
            self.notes.append((action.kind, action.text))
        if isinstance(action, Heard):
            self.followed.append((action.device, action.value))
        return super()._do(action)

    def tell(self, event: Event) -> None:
        """Give an event to the core."""
        self.give(event)


class PeUnderTest(UnderTest):
    """The PE and its surroundings; the test can change all that is played at any time."""

    def __init__(self, table: PeTable = TABLE, *, key: Key | None = None, clock_ppm: int = 0) -> None:
        """Start the PE; it hears no frame yet."""
        puppets.reset()
        super().__init__(PERIOD_NS)
        self.world, self.table = PuppetPlant(), table
        self.players = [Player(self.clock, port.bus, port.bitrate) for port in table.ports]
        self.main, self.far = self.players[0], self.players[-1]
        self.drives: list[int] = []  # when a branch was driven
        secret = None if key is None else Secret(key, b"salt")
        self.broken: dict[str, str] = {}
        self.pe = _Pe(
            self.clock,
            LocalClock(self.clock, 0, clock_ppm),
            table,
            {player.bus.name: (player.bus,) for player in self.players},
            incarnation=INCARNATION,
            secret=secret,
            world=self.world,
            drive=lambda _: None,
            look=lambda _: None,
            withheld=lambda _: None,
            state=lambda _: None,
            move=lambda moved: self.drives.append(moved.t_ns),
            broken=self.broken,
            broke=lambda _: None,
            witness=lambda _: None,
        )
        self.pe.notes, self.pe.followed, self.pe.gives_back = [], [], []
        self.term, self.manager = 5, FIRST_MANAGER
        self.lease: Lease | None = None
        self.alive: frozenset[int] | None = None
        self.neighbour: StatePage0 | None = None
        self.said: Callable[[], None] | None = None  # called with every beat, to send more
        self._beats = 0
        self._beat()

    def tell(self, event: Event) -> None:
        """Give the core an event, as its driver or its modules would."""
        self.pe.tell(event)

    # Time, and what goes on by itself

    def validate(self) -> None:
        """Raise where an invariant of the core does not hold."""
        self.pe.core.validate()

    def _beat(self) -> None:
        self._beats += 1
        if self.lease is not None:
            self.main.command(self.lease, manager=self.manager)
        if self.alive is not None:
            self.main.command(Alive(self.term, self._beats % 256, self.alive), manager=self.manager)
        if self.neighbour is not None:
            page = replace(self.neighbour, sequence=self._beats % 256)
            self.main.say(Frame(state_id(NEIGHBOUR), page.encode()))
        if self.said is not None:
            self.said()
        self.clock.at(self.now_ns + PERIOD_NS, self._beat)

    def attended(self) -> "PeUnderTest":
        """Let a manager be active that has the PE available, and a neighbour be alive; gives this object."""
        self.lease = Lease(self.term, 0, Step.PREPARED, 0)
        self.alive = frozenset((NODE, NEIGHBOUR))
        self.neighbour = StatePage0(PeState.UNCONFIGURED, PeFlags.HEARS_LEASE, 1, 0, 0, 0)
        self.run(50)
        return self

    # What the manager does

    def prepare(self, epoch: int, part: Slice, digest: int, *, contingency: int = 0, body: bool = True) -> None:
        """Send PREPARE, and the slice with its body."""
        self.main.command(Prepare(self.term, epoch, digest, contingency), manager=self.manager)
        self.main.command(*self.slice_frames(epoch, part)[: None if body else 1], manager=self.manager)

    def slice_frames(self, epoch: int, part: Slice | bytes) -> list[SliceHead | SliceBody]:
        """Return head and body of a slice as frames."""
        return slice_messages(NODE, epoch, part, self.table.identity)

    def activate(self, epoch: int, step: Step, digest: int) -> None:
        """Send ACTIVATE, and repeat it in LEASE from now on."""
        self.main.command(Activate(self.term, epoch, step, digest), manager=self.manager)
        if self.lease is not None:
            self.lease = Lease(self.term, epoch, step, digest)
        if self.neighbour is not None:
            state = PeState.BROKEN if step is Step.BREAK else PeState.ACTIVE
            self.neighbour = replace(self.neighbour, state=state, epoch=epoch, digest=digest)

    def flies(self, part: Slice = EVERYTHING, epoch: int = 17, digest: int = 0x111111) -> "PeUnderTest":
        """Let the PE run a configuration; gives this object."""
        self.prepare(epoch, part, digest)
        self.run(15)
        self.activate(epoch, Step.GO_ALL, digest)
        self.run(45)
        equal(self.page_0().state, PeState.ACTIVE, "after GO_ALL it says")
        return self

    def pinged(self) -> StatePage0:
        """Send PING; gives page 0 of the answer, which must come immediately."""
        began_ns = self.now_ns
        self.main.command(Ping(self.term, NODE, 0), manager=self.manager)
        self.run(1.5)
        found = self.pages_0(began_ns)
        demand(bool(found), "a PING is not answered immediately")
        return found[-1][1]

    # What the PE sends

    def pages(self, since_ns: int, player: Player | None = None) -> list[tuple[int, object]]:
        """Return every page of the PE's state, with its time."""
        heard = (player or self.main).since(since_ns, [state_id(NODE)])
        return [(t_ns, decode_state(frame.data)) for t_ns, frame in heard]

    def pages_0(self, since_ns: int, player: Player | None = None) -> list[tuple[int, StatePage0]]:
        """Return the PE's pages 0."""
        return [(t_ns, page) for t_ns, page in self.pages(since_ns, player) if isinstance(page, StatePage0)]

    def pages_1(self, since_ns: int, player: Player | None = None) -> list[tuple[int, StatePage1]]:
        """Return the PE's pages 1."""
        return [(t_ns, page) for t_ns, page in self.pages(since_ns, player) if isinstance(page, StatePage1)]

    def pages_2(self, since_ns: int) -> list[tuple[int, StatePage2]]:
        """Return the PE's pages 2."""
        return [(t_ns, page) for t_ns, page in self.pages(since_ns) if isinstance(page, StatePage2)]

    def pages_3(self, since_ns: int) -> list[tuple[int, StatePage3]]:
        """Return the PE's pages 3."""
        return [(t_ns, page) for t_ns, page in self.pages(since_ns) if isinstance(page, StatePage3)]

    def page_0(self) -> StatePage0:
        """Return the last page 0 that the PE has sent."""
        return self.pages_0(-1)[-1][1]

    def page_1(self) -> StatePage1:
        """Return the last page 1 that the PE has sent."""
        return self.pages_1(-1)[-1][1]

    def data(self, identifier: int, since_ns: int, player: Player | None = None) -> list[tuple[int, Datum]]:
        """Return the data frames under an identifier."""
        found = []
        for t_ns, frame in (player or self.main).since(since_ns, [identifier]):
            datum = decode_data(frame)
            assert not isinstance(datum, Malformed)
            found.append((t_ns, datum))
        return found

    def echoes(self, since_ns: int) -> list[tuple[int, Datum]]:
        """Return the PE's output echoes."""
        return self.data(actuator_echo_id(NODE), since_ns)

    def emergencies(self, since_ns: int) -> list[tuple[int, Emergency]]:
        """Return every EMCY of the PE, but those of silences (`stale`): most puppets give nothing."""
        return [(t_ns, said) for t_ns, said in self._emcys(since_ns) if said.code is not FaultCode.STALE]

    def stale(self, since_ns: int) -> list[tuple[int, int, Silence]]:
        """Return the time, the index of the module, and what is silent, of each report of a silence."""
        stale = [(t_ns, said) for t_ns, said in self._emcys(since_ns) if said.code is FaultCode.STALE]
        return [(t_ns, said.index, Silence.of(said.detail)) for t_ns, said in stale]

    def _emcys(self, since_ns: int) -> Iterator[tuple[int, Emergency]]:
        for t_ns, frame in self.main.since(since_ns, [emcy_id(NODE)]):
            said = decode_emergency(frame.data)
            assert not isinstance(said, Malformed)
            yield t_ns, said

    def object(self, index: int, sub_index: int = 0) -> int:
        """Read a number of the PE's object dictionary, of up to four bytes."""
        began_ns = self.now_ns
        self.main.say(Frame(sdo_request_id(NODE), with_data(UPLOAD, index, sub_index)))
        self.run(6)
        found = self.main.since(began_ns, [sdo_response_id(NODE)])
        demand(len(found) == 1, f"object {index:04X}h, {sub_index} is not read")
        data = found[0].frame.data
        demand(data[0] & 0xE3 == 0x43, f"object {index:04X}h, {sub_index} is answered with {data.hex(' ')}")
        return int.from_bytes(data[4 : 8 - (data[0] >> 2 & 3)], "little")

    def notes(self, kind: str) -> list[str]:
        """Return the texts of the PE's notes of a kind."""
        return [text for one, text in self.pe.notes if one == kind]

    @property
    def counted(self) -> int:
        """Return the number of malformed and refused frames, as the PE's object dictionary has it."""
        return self.object(COUNTERS, 1)

    # Demands

    def answers_in_page_1(self, since_ns: int, epoch: int, digest: int, reason: Reason) -> None:
        """Demand one page 1 since a moment, with this content."""
        found = [page for _, page in self.pages_1(since_ns)]
        told = [(page.staged_epoch, page.staged_digest, page.reason) for page in found]
        equal(told, [(epoch, digest, reason)], "pages 1 name (epoch, digest, reason)")

    def says_nothing_of_it(self, since_ns: int) -> None:
        """Demand that the PE sends no page 1 out of turn."""
        equal([page for _, page in self.pages_1(since_ns)], [], "pages 1")


def datum(identifier: int, value: float, *, node: int = NEIGHBOUR, version: int = 1, code: int = 0) -> Frame:
    """Return a FLOAT datum of another node."""
    status = pack_status(Status(version, Validity.VALID))
    return encode_data(identifier, Datum(node, DataType.FLOAT, status, code, value))


def gaps(times: Sequence[int]) -> list[int]:
    """Return the differences between successive times."""
    return [later - earlier for earlier, later in pairwise(times)]


def moments(heard: Sequence[tuple[int, object]]) -> list[int]:
    """Return the times of frames."""
    return [one[0] for one in heard]


def immediate(t_ns: int, since_ns: int) -> bool:
    """Tell whether a time follows another one immediately."""
    return since_ns < t_ns <= since_ns + SOON_NS
