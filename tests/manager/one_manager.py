"""A manager of a small spec; the test plays its PEs, gives it frames, reads its actions, and sets the time.

Three PEs on one bus: `left` and `right` can each drive one servo of the elevator (branches of one DEMUX), `left` and
`middle` can compute its demand. The heartbeat period is 20 ms.
"""

from collections import Counter
from dataclasses import replace
from typing import Any, TypeVar

from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_manager import events
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import NOTHING, Memory
from heronry_manager.core.settings import CodeBundle
from heronry_manager.core.tables import Compiler, PeTables
from heronry_manager.core.vocabulary import Emit, Keep, ManagerAction, ManagerEvent, PlanReady, RequestPlan, Stop
from heronry_manager.events import Event
from heronry_manager.planner.exact import plan
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identifiers import Command, emcy_id, management_id, state_id
from heronry_wire.management import Control, Emergency, ManagementMessage, Operation, SliceHead, Step, decode_command
from heronry_wire.sansio import Send, Tick
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1
from lab.peers import SteppedCore

MS = 1_000_000
BEAT_NS = 20 * MS
NODE, TERM = 126, 1

SPEC_TEXT = """
dg: 1
name: two_tails
buses: {can0: {bitrate: 1000000}}
pes:
  left:   {node_id: 92, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  middle: {node_id: 93, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  right:  {node_id: 94, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
devices:
  servo_left:  {kind: actuator, pe: left}
  servo_right: {kind: actuator, pe: right}
variables:
  demand: {type: FLOAT}
gates:
  elevator_out: {demux: demand}
modules:
  control: {image: state_estimator, runs_on: [left, middle], gives: {demand: 1}, cpu: 0.1,
            ram: 4KiB, flash: 8KiB, rate_hz: 40}
  drive_left:  {image: servo_driver_1, needs: elevator_out, device: servo_left,
                cpu: 0.1, ram: 1KiB, flash: 2KiB, rate_hz: 40}
  drive_right: {image: servo_driver_1, needs: elevator_out, device: servo_right,
                cpu: 0.1, ram: 1KiB, flash: 2KiB, rate_hz: 40}
functions:
  elevator: {output: elevator_out, criticality: A, priority: 100}
"""


def two_tails() -> Spec:
    return loads(SPEC_TEXT, "two_tails.dg.yaml")


E = TypeVar("E", bound=Event)


class OneManager(SteppedCore[ManagerEvent, ManagerAction]):
    """The core, its clock, and all that it has requested."""

    def __init__(
        self,
        spec: Spec | None = None,
        *,
        node: int = NODE,
        term: int = TERM,
        memory: Memory = NOTHING,
        key: Key | None = None,
        reads_objects: bool = False,
        brings_tables: bool = False,
        bundles: tuple[CodeBundle, ...] = (),
    ) -> None:
        self.spec = spec or two_tails()
        self.memory, now_ns = replace(memory, term=max(memory.term, term - 1)), 1_000 * MS  # as a journal would have it
        tables = PeTables(Compiler(self.spec), ()).contents() if brings_tables else None
        core = ManagerCore(
            self.spec,
            node,
            self.memory,
            now_ns,
            key=key,
            reads_objects=reads_objects,
            tables=tables,
            bundles=bundles,
        )
        super().__init__(core, now_ns)
        self.core: ManagerCore
        self.node = node
        self.events: list[Event] = []
        self.requests: list[RequestPlan] = []
        self.commands: list[ManagementMessage] = []
        self.frames: list[Frame] = []
        self.stops: list[str] = []
        self.compiler = Compiler(self.spec)
        self.flags = PeFlags.HEARS_LEASE  # of every state
        self.running: dict[str, StatePage0] = {}  # the page that each live PE sends in each beat
        self.sequences: Counter[str] = Counter()

    def give(self, event: ManagerEvent) -> list[ManagerAction]:
        """Give an event to the core now."""
        actions = super().give(event)
        self.core.validate()
        for action in actions:
            match action:
                case Emit(told):
                    self.events.append(told)
                case RequestPlan():
                    self.requests.append(action)
                case Stop(reason):
                    self.stops.append(reason)
                case Keep(record):
                    self.memory = self.memory.after(record)
                case Send(_, frame):
                    self._note(frame)
        return actions

    def _note(self, frame: Frame) -> None:
        self.frames.append(frame)
        message = decode_command(frame.can_id - management_id(self.node, Command.LEASE), frame.data)
        if not isinstance(message, Malformed):
            self.commands.append(message)

    def pass_time(self, duration_ns: int) -> None:
        """Let time pass, deadline by deadline; live PEs go on beating."""
        end_ns = self.now_ns + duration_ns
        beat_ns = self.now_ns - self.now_ns % BEAT_NS + BEAT_NS
        while True:
            due_ns = self.core.next_deadline_ns()
            at_ns = min(beat_ns, end_ns if due_ns is None else max(self.now_ns, due_ns))
            if at_ns > end_ns or (at_ns == end_ns and beat_ns > end_ns):
                break
            self.now_ns = at_ns
            if at_ns == beat_ns:
                beat_ns += BEAT_NS
                for pe in self.running:
                    self.beat(pe)
            else:
                self.give(Tick())
        self.now_ns = end_ns

    def beat(self, pe: str) -> None:
        self.hear(Frame(self.state_id(pe), self.running[pe].encode()))

    def state_id(self, pe: str) -> int:
        return state_id(self.spec.pes[pe].node_id)

    def live(self, pe: str, state: PeState = PeState.UNCONFIGURED, *, epoch: int = 0, digest: int = 0) -> None:
        """Let a PE send this state from now on, the first time now."""
        incarnation = self.running[pe].incarnation if pe in self.running else 1
        self.running[pe] = StatePage0(state, self.flags, incarnation, epoch, 0, digest)
        self.beat(pe)

    def reboot(self, pe: str) -> None:
        incarnation = self.running[pe].incarnation + 1
        self.running[pe] = StatePage0(PeState.UNCONFIGURED, self.flags, incarnation, 0, 0, 0)
        self.beat(pe)

    def die(self, pe: str) -> None:
        del self.running[pe]

    def stage(self, pe: str, reason: Reason = Reason.NONE) -> None:
        """Let a PE report that it has staged what is being prepared, or why not."""
        epoch, digest = self.prepared()
        page = StatePage1(
            PeState.UNCONFIGURED, PeFlags.HEARS_LEASE, epoch, digest if reason is Reason.NONE else 0, reason, 0
        )
        self.hear(Frame(self.state_id(pe), page.encode()))

    def report(self, pe: str, emergency: Emergency) -> None:
        self.hear(Frame(emcy_id(self.spec.pes[pe].node_id), emergency.encode()))

    def take(self, pe: str, state: PeState) -> None:
        """Let a PE report that it has taken a step of what was prepared last."""
        epoch, digest = self.prepared()
        self.live(pe, state, epoch=epoch, digest=digest)

    def prepared(self) -> tuple[int, int]:
        """Epoch and digest of the last PREPARE."""
        told = self.last(events.EpochPrepared)
        return told.epoch, int(told.digest, 16)

    def answer(self) -> Plan:
        """Answer the last request as the planner does."""
        request = self.requests[-1]
        found = plan(self.spec, request.now, request.running)
        self.give(PlanReady(request.request, found))
        return found

    def start(self, *, fly: bool = True) -> None:
        """Become active over three live PEs; with `fly` until the first epoch is active everywhere."""
        for pe in self.spec.pes:
            self.live(pe)
        self.pass_time(110 * MS)
        if fly:
            self.answer()
            for pe in self.spec.pes:
                self.stage(pe)
            for pe in self.spec.pes:
                self.take(pe, PeState.ACTIVE)

    def of(self, kind: type[E]) -> list[E]:
        """Events of one kind."""
        return [told for told in self.events if isinstance(told, kind)]

    def last(self, kind: type[E]) -> E:
        return self.of(kind)[-1]

    def said(self, message_type: type[ManagementMessage]) -> list[Any]:
        """Commands of one type."""
        return [message for message in self.commands if isinstance(message, message_type)]

    def answers(self) -> list[Control]:
        """What the manager has sent in CONTROL to PEs, and not to a standby manager."""
        return [one for one in self.said(Control) if one.operation is not Operation.HOLDS]

    def heads_to(self, pe: str) -> int:
        node = self.spec.pes[pe].node_id
        return sum(1 for head in self.said(SliceHead) if head.node == node)

    def steps(self) -> list[str]:
        return [told.step for told in self.of(events.EpochStep)]


__all__ = ["BEAT_NS", "MS", "NODE", "TERM", "OneManager", "Step", "two_tails"]
