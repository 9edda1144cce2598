"""A PE of a small spec; the test plays the manager and the neighbours.

Node 93 has one bus with a heartbeat period of 20 ms and can run all of `control` (movable), `servo_1` and `servo_2`
(branches of a DEMUX) and `monitor`. Node 92 is its neighbour and runs `gyro`.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.authority import Secret
from heronry_agent.core.carried_over import read_beside
from heronry_agent.core.vocabulary import (
    Action,
    Drive,
    Driven,
    Event,
    PrepareTable,
    StartModule,
    StepModule,
    Stepped,
    StopModule,
    SwitchTable,
    TablePrepared,
)
from heronry_agent.module import Value
from heronry_wire.canaerospace import DataType, Datum, encode_data
from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import emcy_id, state_id
from heronry_wire.management import (
    Activate,
    Alive,
    Control,
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
    Port,
    SourceEntry,
    TableError,
    VariableEntry,
)
from heronry_wire.protocol_version import PROTOCOL
from heronry_wire.sansio import Send
from heronry_wire.state_frames import PeFlags, PeState, StatePage0, StatePage1, decode_state
from lab import peers
from lab.peers import SteppedCore, command_frame

MS = 1_000_000
BEAT_NS = 20 * MS
LEASE_NS = 5 * BEAT_NS

GYRO, CONTROL, SERVO_1, SERVO_2, MONITOR = range(5)
RATE, DEMAND, ALARM = range(3)
RATE_ID, DEMAND_ID, ALARM_ID = 300, 1536, 1537
NEIGHBOUR, NODE, FAR = 92, 93, 94
MANAGER = 126

_DEMAND_LEAF = LeafEntry("", "demand", 1, 1)
_RATE_LEAF = LeafEntry("", "rate", 1, 2)


def mode(name: str, *leaves: LeafEntry, rate_mhz: int = 40_000, **gives: int) -> ModeEntry:
    return ModeEntry(name, rate_mhz, 100, leaves, gives)


MODULES = (
    ModuleEntry(
        CONTROL,
        "control",
        "control",
        None,
        demux=False,
        movable=True,
        modes=(mode("full", _RATE_LEAF, demand=1), mode("blind", demand=2)),
    ),
    ModuleEntry(SERVO_1, "servo_1", "servo", "left", demux=True, movable=False, modes=(mode("only", _DEMAND_LEAF),)),
    ModuleEntry(SERVO_2, "servo_2", "servo", "right", demux=True, movable=False, modes=(mode("only", _DEMAND_LEAF),)),
    ModuleEntry(
        MONITOR,
        "monitor",
        "monitor",
        None,
        demux=False,
        movable=False,
        modes=(mode("only", LeafEntry("0", "rate", 1, 2), LeafEntry("1", "alarm", 1, 1), rate_mhz=30_000, alarm=1),),
    ),
)

TABLE = PeTable(
    protocol=PROTOCOL,
    spec="small",
    spec_digest="00" * 32,
    name="tail",
    node_id=NODE,
    cpu_millis=500,
    without_manager="keep",
    uplink=0,
    ports=(Port("can0", 1_000_000, BEAT_NS, 3, wireless=False, channels=1, nodes=(NEIGHBOUR, FAR)),),
    modules=MODULES,
    sources=(
        SourceEntry("gyro", "rate", RATE_ID, 25 * MS),
        SourceEntry("control", "demand", DEMAND_ID, 25 * MS),
        SourceEntry("monitor", "alarm", ALARM_ID, 33 * MS),
    ),
    variables={
        "rate": VariableEntry("FLOAT", None),
        "demand": VariableEntry("FLOAT", None),
        "alarm": VariableEntry("UCHAR", 7),
    },
    devices=(
        DeviceEntry("gyro_chip", "sensor", NEIGHBOUR),
        DeviceEntry("left", "actuator", NODE),
        DeviceEntry("right", "actuator", NODE),
        DeviceEntry("rudder", "actuator", FAR),
    ),
    module_names=("gyro", "control", "servo_1", "servo_2", "monitor"),
)

# A gateway: node 93 between can0 (uplink, 20 ms) and radio (100 ms), beyond which sits node 94.
GATEWAY_TABLE = replace(
    TABLE,
    ports=(
        Port("can0", 1_000_000, BEAT_NS, 3, wireless=False, channels=1, nodes=(NEIGHBOUR,)),
        Port("radio", 19_200, 100 * MS, 3, wireless=True, channels=1, nodes=(FAR,)),
    ),
)

RUN_CONTROL = ModuleSlice(CONTROL, 0, (RATE,))
RUN_SERVO_1 = ModuleSlice(SERVO_1, 0, (DEMAND,))
RUN_SERVO_2 = ModuleSlice(SERVO_2, 0, (DEMAND,))
RUN_MONITOR = ModuleSlice(MONITOR, 0, (RATE, ALARM))

WATCHED = Slice((RUN_CONTROL, RUN_MONITOR), remote={RATE: NEIGHBOUR})
FLYING = Slice((RUN_CONTROL, RUN_SERVO_1), remote={RATE: NEIGHBOUR}, publish={DEMAND: 1})

Message = Lease | Alive | Prepare | SliceHead | SliceBody | Activate | Ping | Control


def slice_messages(wanted: Slice, epoch: int, digest: int, term: int = 1, *, table: PeTable = TABLE) -> list[Message]:
    """PREPARE, head and bodies, as a manager sends them that has compiled `table`."""
    return [Prepare(term, epoch, digest), *peers.slice_messages(NODE, epoch, wanted, table.identity)]


class OnePe(SteppedCore[Event, Action]):
    """The core of one PE, its clock, and all its actions."""

    def __init__(
        self,
        table: PeTable = TABLE,
        *,
        missing_images: Mapping[str, str] = MappingProxyType({}),
        secret: Secret | None = None,
        takes_tables: bool = False,
        slow_to_rest: frozenset[int] = frozenset(),
    ) -> None:
        now_ns = 1_000 * MS
        vars(table)["identity"] = TABLE.identity  # `slice_messages` makes slices for TABLE, and for every variant of it
        core = AgentCore(
            table,
            5,
            now_ns,
            missing_images=missing_images,
            secret=secret,
            takes_tables=takes_tables,
            slow_to_rest=slow_to_rest,
        )
        super().__init__(core, now_ns)
        self.core: AgentCore
        self.done: list[tuple[int, Action]] = []
        self.outputs: dict[int, dict[str, Value]] = {}  # what each module answers
        self.reports: dict[int, tuple[tuple[str, int], ...]] = {}  # what each module reports in every step
        self.phases: dict[int, tuple[str, ...]] = {}  # what each module requests in every step
        self.priorities: dict[int, tuple[tuple[str, int], ...]] = {}  # the same
        self.running: dict[int, int] = {}
        self.seen: dict[int, dict[str, object]] = {}  # what each module saw last, by leaf
        self.steps: dict[int, list[int]] = {}
        self.missing: dict[str, str] = {}  # images of a table that comes beside, whose code is not here
        self.problem: str | None = None  # why this PE cannot fly by a table that comes beside
        self.spent_ns = 0  # time that each step spends

    def give(self, event: Event) -> list[Action]:
        """Give an event now, and answer the steps as the modules would."""
        actions = super().give(event)
        self.core.validate()
        self.done += [(self.now_ns, action) for action in actions]
        for action in list(actions):
            match action:
                case StartModule(module, _, chosen):
                    self.running[module] = chosen
                case StopModule(module):
                    self.running.pop(module, None)
                case PrepareTable(text, number):
                    actions += self.give(self.prepared(text, number))
                case SwitchTable(_, modules):
                    self.running = {modules[module]: mode for module, mode in self.running.items()}
                    self.steps = {modules[module]: times for module, times in self.steps.items() if module in modules}
                case Drive(module, value):
                    actions += self.give(Driven(module, value))
                case StepModule(module, release, inputs):
                    self.steps.setdefault(module, []).append(self.now_ns)
                    self.seen[module] = {path: datum.value for path, (_, datum) in inputs.items()}
                    actions += self.answer(module, release)
        return actions

    def prepared(self, text: bytes, number: int) -> TablePrepared:
        try:
            table = read_beside(text, self.core.table, number)
        except TableError as error:
            return TablePrepared(None, problem=str(error))
        return TablePrepared(table, self.missing, problem=self.problem)

    def answer(self, module: int, release: int) -> list[Action]:
        writes = (1.5,) if module == SERVO_1 else ()
        reports, phases = self.reports.get(module, ()), self.phases.get(module, ())
        priorities, outputs = self.priorities.get(module, ()), self.outputs.get(module, {})
        return self.give(Stepped(module, release, outputs, writes, reports, phases, self.spent_ns, priorities))

    def command(self, *messages: Message, manager: int = MANAGER) -> list[Action]:
        return self.hear(*(command_frame(message, manager) for message in messages))

    def fly(self, duration_ns: int, *, epoch: int, digest: int, step: Step = Step.GO_ALL) -> list[Action]:
        """Let time pass with an active manager, and a neighbour that is alive and sends its data."""
        actions = []
        for _ in range(duration_ns // BEAT_NS):
            actions += self.command(Lease(1, epoch, step, digest), Alive(1, 0, frozenset({NEIGHBOUR, NODE})))
            actions += self.hear(neighbour_state(epoch, digest))
            actions += self.hear(rate_frame(1.0))
            actions += self.pass_time(BEAT_NS)
        return actions

    def configure(self, wanted: Slice, epoch: int, step: Step = Step.GO_ALL) -> list[Action]:
        """Let a manager stage and activate a slice, with this PE available; the digest of the whole is 1000 + epoch."""
        actions = self.command(Alive(1, 0, frozenset({NEIGHBOUR, NODE})))
        actions += self.command(*slice_messages(wanted, epoch, 1000 + epoch))
        actions += self.command(Activate(1, epoch, step, 1000 + epoch))
        return actions + self.command(Alive(1, 1, frozenset({NEIGHBOUR, NODE})))

    def ask(self) -> tuple[StatePage0, StatePage1]:
        """PING, and both pages of the answer."""
        states = pages(
            self.command(
                Ping(self.core.followed_manager.term or 1, NODE, 0),
                manager=self.core.followed_manager.manager or MANAGER,
            )
        )
        page_0, page_1 = states
        assert isinstance(page_0, StatePage0)
        assert isinstance(page_1, StatePage1)
        return page_0, page_1


def neighbour_state(epoch: int, digest: int = 1, node: int = NEIGHBOUR) -> Frame:
    page = StatePage0(PeState.ACTIVE if epoch else PeState.UNCONFIGURED, PeFlags(0), 1, epoch, 0, digest)
    return Frame(state_id(node), page.encode())


def rate_frame(value: float, *, node: int = NEIGHBOUR, status: int = 0x11, code: int = 0) -> Frame:
    return encode_data(RATE_ID, Datum(node, DataType.FLOAT, status, code, value))


def sent(actions: list[Action], identifier: int, port: int | None = None) -> list[Frame]:
    """Frames under an identifier, on any port or one."""
    sends = [action for action in actions if isinstance(action, Send)]
    return [s.frame for s in sends if s.frame.can_id == identifier and port in (None, s.port)]


def emergencies(actions: list[Action], code: FaultCode | None = None, port: int | None = None) -> list[Emergency]:
    """Return the EMCYs that go out: those with this code, if one is given."""
    told = [decode_emergency(frame.data) for frame in sent(actions, emcy_id(NODE), port)]
    return [one for one in told if isinstance(one, Emergency) and code in (None, one.code)]


def pages(actions: list[Action], port: int = 0) -> list[StatePage0 | StatePage1]:
    """State frames, decoded."""
    decoded = [decode_state(frame.data) for frame in sent(actions, state_id(NODE), port)]
    assert all(isinstance(page, StatePage0 | StatePage1) for page in decoded)
    return [page for page in decoded if isinstance(page, StatePage0 | StatePage1)]


def started(actions: list[Action]) -> list[int]:
    return [action.module for action in actions if isinstance(action, StartModule)]


def stopped(actions: list[Action]) -> list[int]:
    return [action.module for action in actions if isinstance(action, StopModule)]
