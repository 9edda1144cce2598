"""One aircraft on one bus in virtual time: real cores of the manager and of the PEs, with a fault at any frame.

Modules answer each step at once with a constant for each output. A frame reaches every other node after 0.3 ms. The
world swaps the manager's core when the PEs have changed to another spec, as the driver of a manager does. A standby
manager (node 127) can be there, too.
"""

import heapq
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import count

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.authority import Secret
from heronry_agent.core.carried_over import read_beside
from heronry_agent.core.vocabulary import (
    Drive,
    Driven,
    PrepareTable,
    StartModule,
    StepModule,
    Stepped,
    StopModule,
    SwitchTable,
    TablePrepared,
)
from heronry_dg.model import Spec
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import NOTHING, Memory
from heronry_manager.core.tables import Compiler
from heronry_manager.core.vocabulary import (
    AskStatus,
    Emit,
    Keep,
    OperatorSaid,
    Order,
    PlanReady,
    Reply,
    RequestPlan,
    RequestSwitch,
    SpecAtHand,
    SpecFollowed,
    SpecSwitched,
)
from heronry_manager.planner.greedy.planner import Greedy
from heronry_manager.shell.other_spec import OtherSpec
from heronry_wire.authentication import Key
from heronry_wire.canaerospace import DataType
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Use, classify, state_id
from heronry_wire.pe_table import PeTable, TableError
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.state_frames import page_of

MS = 1_000_000
DELAY_NS = 300_000


@dataclass
class Pe:
    """One PE: its core, its modules by name, and when each was stepped."""

    core: AgentCore
    table: PeTable
    incarnation: int
    beside: bytes = b""  # identity of its table beside
    steps: dict[str, list[int]] = field(default_factory=dict)
    running: dict[str, int] = field(default_factory=dict)  # by name: since when


@dataclass
class Standby:
    """The standby manager: its spec, and the spec that it has at hand."""

    spec: Spec
    core: ManagerCore
    memory: Memory = NOTHING
    at_hand: OtherSpec | None = None
    cores: int = 1
    events: list[object] = field(default_factory=list)


@dataclass
class World:
    """The aircraft; `lost`: called with the number and the content of each frame, whether it is lost."""

    spec: Spec
    lost: Callable[[int, Frame], bool] = lambda _number, _frame: False
    watches: Callable[[int, Frame, str], None] = lambda _ns, _frame, _sender: None
    key: Key | None = None
    takes_tables: bool = True
    lacking: dict[str, str] = field(default_factory=dict)  # images of a table beside, whose code is missing
    unread: int = 0  # how many tables that come beside are lost by their PE

    def __post_init__(self) -> None:
        """Start all."""
        self.now_ns = 1_000 * MS
        self.sent = 0
        self._queue: list[tuple[int, int, Frame, str]] = []
        self._order = count()
        self.compiler = Compiler(self.spec)
        self.pes: dict[str, Pe] = {}
        self.events: list[object] = []
        self.replies: list[Reply] = []
        self.memory = NOTHING
        self.other: OtherSpec | None = None
        self.cores = 1
        self._states: dict[int, tuple[int, Frame]] = {}
        self.dead: set[str] = set()
        for pe in self.spec.pes:
            self.boot(pe, self.compiler.table(pe), 1)
        self._begin(self.spec, NOTHING)
        self.standby: Standby | None = None

    def boot(self, pe: str, table: PeTable, incarnation: int) -> None:
        self.dead.discard(pe)
        secret = None if self.key is None else Secret(self.key, f"{pe} {incarnation}".encode().ljust(16)[:16])
        core = AgentCore(table, incarnation, self.now_ns, takes_tables=self.takes_tables, secret=secret)
        self.pes[pe] = Pe(core, table, incarnation)

    def _begin(self, spec: Spec, memory: Memory) -> None:
        self.manager = ManagerCore(
            spec, 126, memory, self.now_ns, tables=OtherSpec(spec).contents, key=self.key, standby=True
        )
        self.spec, self._greedy = spec, Greedy(spec)

    def restart(self, spec: Spec) -> None:
        """Start the manager again, with what its journal holds."""
        self.dead.discard("manager")
        self._begin(spec, self.memory if spec.digest == self.spec.digest else self.memory.numbers())

    def add_standby(self, spec: Spec, memory: Memory = NOTHING) -> Standby:
        """Start a standby manager with this spec, and with what its journal holds."""
        self.standby = Standby(spec, self._standby_core(spec, memory), memory)
        return self.standby

    def _standby_core(self, spec: Spec, memory: Memory) -> ManagerCore:
        tables = OtherSpec(spec).contents
        return ManagerCore(spec, 127, memory, self.now_ns, tables=tables, key=self.key, standby=True)

    def give_standby(self, other: Spec) -> None:
        """Let the standby manager have another spec at hand."""
        assert self.standby is not None
        self.standby.at_hand = OtherSpec(other)
        self._standby(SpecAtHand(other.digest))

    # Time

    def run(self, duration_ns: int, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass; tells whether `until` came true."""
        end_ns = self.now_ns + duration_ns
        while self.now_ns < end_ns:
            if until():
                return True
            due = [end_ns, *(pe.core.next_deadline_ns() for name, pe in self.pes.items() if name not in self.dead)]
            manager_ns = self.manager.next_deadline_ns() if "manager" not in self.dead else None
            standby_ns = None if self.standby is None else self.standby.core.next_deadline_ns()
            due += [one for one in (manager_ns, standby_ns) if one is not None]
            due += [self._queue[0][0]] if self._queue else []
            self.now_ns = max(self.now_ns, min(due))
            while self._queue and self._queue[0][0] <= self.now_ns:
                _, _, frame, sender = heapq.heappop(self._queue)
                self.deliver(frame, sender)
            for name, pe in list(self.pes.items()):
                if name not in self.dead and pe.core.next_deadline_ns() <= self.now_ns:
                    self._pe(name, Tick())
            manager_ns = self.manager.next_deadline_ns()
            if manager_ns is not None and manager_ns <= self.now_ns and "manager" not in self.dead:
                self._manager(Tick())
            if standby_ns is not None and standby_ns <= self.now_ns:
                self._standby(Tick())
        return until()

    def deliver(self, frame: Frame, sender: str) -> None:
        for name, pe in list(self.pes.items()):
            if name != sender and name not in self.dead and frame.can_id in pe.core.identifiers:
                self._pe(name, Received(0, frame))
        if sender != "manager" and "manager" not in self.dead:
            if classify(frame.can_id).use is Use.STATE and page_of(frame.data) == 0:
                self._states[frame.can_id] = self.now_ns, frame
            if self.manager.hears(frame.can_id):
                self._manager(Received(0, frame))
        if self.standby is not None and sender != "standby" and self.standby.core.hears(frame.can_id):
            self._standby(Received(0, frame))

    def _send(self, frame: Frame, sender: str) -> None:
        self.sent += 1
        self.watches(self.now_ns, frame, sender)
        if not self.lost(self.sent, frame):
            heapq.heappush(self._queue, (self.now_ns + DELAY_NS, next(self._order), frame, sender))

    # Nodes

    def _pe(self, name: str, event: object) -> None:
        pe = self.pes[name]
        actions = list(pe.core.step(self.now_ns, event))  # type: ignore[arg-type]
        pe.core.validate()
        while actions:
            action, answer = actions.pop(0), None
            match action:
                case Send(_, frame):
                    self._send(frame, name)
                case StartModule(module):
                    pe.running[pe.table.module_names[module]] = self.now_ns
                case StopModule(module):
                    del pe.running[pe.table.module_names[module]]
                case StepModule(module, release):
                    self._stepped(pe, module)
                    answer = Stepped(module, release, self._outputs(pe, module), self._writes(pe, module))
                case Drive(module, value):
                    answer = Driven(module, value)
                case PrepareTable():
                    answer = self._prepared(pe, action)
                case SwitchTable(table):
                    pe.beside, pe.table = pe.table.identity, table
                case _:
                    pass
            if answer is not None:
                actions = list(pe.core.step(self.now_ns, answer)) + actions
        if pe.core.new_table is not None:  # its driver starts it anew, with the table that was brought
            self.boot(name, pe.core.new_table, pe.incarnation + 1)

    def _prepared(self, pe: Pe, action: PrepareTable) -> TablePrepared | None:
        try:
            table = read_beside(action.text, pe.core.table, action.number)
        except TableError as error:
            return TablePrepared(None, problem=str(error))
        if table.identity in (pe.core.table.identity, pe.beside):
            return None
        if self.unread > 0:
            self.unread -= 1
            return None
        pe.beside = table.identity
        return TablePrepared(table, self.lacking)

    def _stepped(self, pe: Pe, module: int) -> None:
        name = pe.table.module_names[module]
        pe.steps.setdefault(name, []).append(self.now_ns)
        assert name in pe.running, f"{name} is stepped and does not run"

    def _outputs(self, pe: Pe, module: int) -> Mapping[str, object]:
        entry = next(one for one in pe.table.modules if one.index == module)
        mode = entry.modes[pe.core.active_configuration.live[module]]
        return {variable: _value(pe.table.variables[variable].type) for variable in mode.gives}

    def _writes(self, pe: Pe, module: int) -> tuple[float, ...]:
        entry = next(one for one in pe.table.modules if one.index == module)
        actuators = {device.name for device in pe.table.devices if device.kind == "actuator"}
        return (1.0,) if entry.device in actuators else ()

    def _manager(self, event: object) -> None:
        actions = list(self.manager.step(self.now_ns, event))  # type: ignore[arg-type]
        self.manager.validate()
        for action in actions:
            match action:
                case Send(_, frame):
                    self._send(frame, "manager")
                case RequestPlan(number, now, running):
                    plan = self._greedy.plan(now, running)
                    self._manager(PlanReady(number, plan))
                case RequestSwitch():
                    assert self.other is not None
                    self._manager(self.other.first(action))
                case SpecSwitched():
                    self._swap(action)
                    return
                case Emit(told):
                    self.events.append(told)
                case Keep(record):
                    self.memory = self.memory.after(record)
                case Reply():
                    self.replies.append(action)

    def _swap(self, switched: SpecSwitched) -> None:
        assert self.other is not None
        self.cores += 1
        self.memory = self.other.memory(self.memory, switched)
        self._begin(self.other.spec, self.memory)
        nodes = {state_id(pe.node_id) for pe in self.spec.pes.values()}
        since_ns = self.now_ns - 2 * self.manager.heartbeat_ns
        self.manager.succeed(
            frame for can_id, (at_ns, frame) in self._states.items() if can_id in nodes and at_ns >= since_ns
        )
        self._manager(Tick())

    def _standby(self, event: object) -> None:
        one = self.standby
        assert one is not None
        actions = list(one.core.step(self.now_ns, event))  # type: ignore[arg-type]
        one.core.validate()
        for action in actions:
            match action:
                case Send(_, frame):
                    self._send(frame, "standby")
                case RequestPlan(number, now, running):
                    self._standby(PlanReady(number, Greedy(one.spec).plan(now, running)))
                case SpecFollowed(preparation):
                    assert one.at_hand is not None
                    one.spec, one.memory = one.at_hand.spec, one.at_hand.memory(one.memory, None)
                    one.cores += 1
                    one.core = self._standby_core(one.spec, one.memory)
                    one.core.catch_up(preparation)
                case Emit(told):
                    one.events.append(told)
                case Keep(record):
                    one.memory = one.memory.after(record)
                case _:
                    pass

    # The operator

    def say(self, order: Order) -> Reply:
        self._manager(OperatorSaid(1, order))
        return self.replies.pop()

    def reload(self, other: Spec) -> Reply:
        self.other = OtherSpec(other)
        order = self.other.order(self.spec)
        assert not isinstance(order, str), order
        return self.say(order)

    def status(self) -> Mapping[str, object]:
        return self.say(AskStatus()).status or {}

    def specs_that_fly(self) -> set[str]:
        """The specs by whose tables PEs run something."""
        return {
            pe.core.table.spec_digest
            for name, pe in self.pes.items()
            if name not in self.dead and pe.core.active_configuration.live
        }


def _value(type_name: str) -> object:
    kind = DataType[type_name]
    if kind is DataType.FLOAT:
        return 0.0
    return 0 if kind.payload_bytes <= 4 and not kind.name[-1].isdigit() else (0,) * int(kind.name[-1])
