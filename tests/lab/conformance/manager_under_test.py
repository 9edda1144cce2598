"""One real manager; the test plays its PEs: they send, stage, take steps and answer, until the test changes that.

The test decides what the manager's planner answers, and when (`planning`): by default the right answer, immediately.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from heronry_dg import loader
from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.memory import NOTHING, Memory
from heronry_manager.core.vocabulary import ManagerEvent, Order, PlanFailed, PlanReady, Reply, RequestPlan
from heronry_manager.planning_policy import FromPlanner, PlannerAnswered
from heronry_tools.console.spec_files import spec_path
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.disk import Disk
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.planning import Planners, Prepared, best_plan, prepared
from heronry_tools.sim.world.planning_driver import PlanningDriver
from heronry_tools.sim.world.simulated_manager import SimulatedManager
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identifiers import (
    FIRST_MANAGER,
    MANAGER_NODES,
    Command,
    emcy_id,
    management_id,
    sdo_request_id,
    sdo_response_id,
    state_id,
)
from heronry_wire.management import (
    NO_EPOCH,
    SLICE_BYTES_PER_FRAME,
    Activate,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    ManagementMessage,
    Ping,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
    decode_command,
    is_newer,
)
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1
from lab.conformance.player import MS, Heard, Player, UnderTest, demand
from lab.peers import PlayedObjects

PERIOD_NS, LEASE_NS = 20 * MS, 100 * MS
_STATES = {Step.BREAK: PeState.BROKEN, Step.GO: PeState.ACTIVE, Step.GO_ALL: PeState.ACTIVE}


def example(name: str) -> Spec:
    """Return a shipped spec, or an example."""
    is_example = name not in ("big_blue", "elevator_and_chute")
    return loader.load(spec_path(f"dg_specs/examples/{name}.dg.yaml" if is_example else name))


@dataclass(eq=False)
class PlayedPe:
    """A PE that behaves correctly, unless the test changes that."""

    name: str
    node: int
    say: Callable[[Frame], None]
    speaks: bool = True
    hears: bool = True  # LEASE, and reports that
    stages: bool = True  # answers PREPARE and SLICE
    steps: bool = True  # takes steps
    holds: bool = False  # has a new branch of a DEMUX, so that it is PARTIAL at GO
    refuses: Reason | None = None
    has_on_board: bool = True  # every contingency
    incarnation: int = 1
    state: PeState = PeState.UNCONFIGURED
    epoch: int = NO_EPOCH
    digest: int = 0
    runs: tuple[int, int] = (0, 0)  # digest and length of its slice
    sequence: int = 0
    _prepare: Prepare | None = None
    _head: SliceHead | None = None
    _bodies: dict[int, bytes] = field(default_factory=dict)
    _staged: tuple[int, int] = (NO_EPOCH, 0)

    def beat(self) -> None:
        """Send the page 0 of this PE."""
        if self.speaks:
            self.say(Frame(state_id(self.node), self.page_0().encode()))
            self.sequence = (self.sequence + 1) % 256

    def page_0(self) -> StatePage0:
        """Return the page 0 that this PE sends now."""
        flags = PeFlags.HEARS_LEASE if self.hears else PeFlags(0)
        return StatePage0(self.state, flags, self.incarnation, self.epoch, self.sequence, self.digest)

    def answer(self, reason: Reason = Reason.NONE) -> None:
        """Send page 1 on the epoch of the last PREPARE."""
        epoch = NO_EPOCH if self._prepare is None else self._prepare.epoch
        staged = self._staged if self._staged[0] == epoch else (epoch, 0)
        flags = PeFlags.HEARS_LEASE if self.hears else PeFlags(0)
        self.say(Frame(state_id(self.node), StatePage1(self.state, flags, *staged, reason, 0).encode()))

    def reboot(self) -> None:
        """Begin anew, as the next incarnation."""
        self.incarnation += 1
        self.state, self.epoch, self.digest, self.runs = PeState.UNCONFIGURED, NO_EPOCH, 0, (0, 0)
        self._staged, self._prepare = (NO_EPOCH, 0), None

    def goes_on_as(self, other: "PlayedPe") -> None:
        """Run what this PE ran under another manager."""
        self.epoch, self.digest, self.state, self.runs = other.epoch, other.digest, other.state, other.runs

    def take(self, message: ManagementMessage) -> None:
        """Execute a command of the manager."""
        match message:
            case Prepare():
                self._take_prepare(message)
            case SliceHead(node) if node == self.node:
                self._head = message
                self._stage()
            case SliceBody(node, _, index, body) if node == self.node:
                self._bodies[index] = body
                self._stage()
            case Activate() | Lease() if self.steps and self.speaks:
                self._take_step(message)
            case Ping(node=node) if node in (0, self.node):
                self.beat()

    def _take_prepare(self, prepare: Prepare) -> None:
        wanted, before = (prepare.epoch, prepare.digest), self._prepare
        if before is not None and before.term == prepare.term and is_newer(before.epoch, prepare.epoch):
            self.answer(Reason.STALE_EPOCH)
            return
        if self._prepare is None or (self._prepare.epoch, self._prepare.digest) != wanted:
            self._prepare, self._head, self._bodies = prepare, None, {}
        if not self.stages or not self.speaks:
            return
        if prepare.contingency and self.has_on_board:
            self._staged = wanted
        if self._staged == wanted or prepare.contingency:
            self.answer(Reason.NONE if self._staged == wanted else Reason.NOT_ON_BOARD)

    def _stage(self) -> None:
        head = self._head
        if head is None or self._prepare is None or not self.stages or not self.speaks:
            return
        count = -(-head.length // SLICE_BYTES_PER_FRAME)
        if self.runs != (head.digest, head.length) and not all(n in self._bodies for n in range(1, count + 1)):
            return
        if self.refuses is not None:
            self.answer(self.refuses)
            return
        self._staged = self._prepare.epoch, self._prepare.digest
        self.answer()

    def _take_step(self, order: Activate | Lease) -> None:
        wanted = order.epoch, order.digest
        if order.step is Step.PREPARED or wanted not in (self._staged, (self.epoch, self.digest)):
            return
        state = PeState.PARTIAL if order.step is Step.GO and self.holds else _STATES[order.step]
        if (self.epoch, self.digest) == wanted and state <= self.state:
            return
        if (self.epoch, self.digest) != wanted and self._head is not None:
            self.runs = self._head.digest, self._head.length
        self.epoch, self.digest, self.state = *wanted, state
        self.beat()


class _PlayedPlanner(PlanningDriver):
    """One planner behind the policy, which gives the answers that the test sets."""

    def __init__(self, manager: "_Manager", clock: Clock, spec: Spec) -> None:
        super().__init__(clock, spec, Planners.BEST, None, decide_ns=lambda: MS, tell=manager.tell)
        self._manager = manager

    def ask_planner(self, request: RequestPlan) -> None:
        self._manager.plan_requests.append(request)
        answer = self._manager.planning(request)
        if answer is not None:
            self.answer(MS, PlannerAnswered(answer))


class _Manager(SimulatedManager):
    """A manager whose planner gives the answers that the test sets."""

    planning: Callable[[RequestPlan], PlanReady | PlanFailed | None]
    plan_requests: list[RequestPlan]

    def tell(self, event: ManagerEvent | FromPlanner) -> None:
        """Give the core an event."""
        self._told(event)


_E = TypeVar("_E", bound=events.Event)


class ManagerUnderTest(UnderTest):
    """The manager under test, and its aircraft."""

    def __init__(
        self,
        spec: Spec | None = None,
        *,
        node: int = FIRST_MANAGER,
        standby: bool = False,
        advise: bool = False,
        key: Key | None = None,
        ahead: Prepared | None = None,
        disk: Disk | None = None,
        contingencies: int | None = None,
        objects: PlayedObjects | None = None,
    ) -> None:
        """Start the manager; the PEs send from now on.

        objects: what the PEs store for people, which the manager reads by SDO; None: it reads nothing.
        """
        self.spec = spec = example("demux_actuators") if spec is None else spec
        super().__init__(PERIOD_NS)
        self.node = node
        self.main = Player(self.clock, spec.manager.bus, spec.buses[spec.manager.bus].bitrate)
        self.events: list[events.Event] = []
        self.disk = Disk(spec) if disk is None else disk
        self._objects = objects
        self._node_of_request = {sdo_request_id(pe.node_id): pe.node_id for pe in spec.pes.values()}
        self.manager = self._started(node, standby, advise, key, ahead or prepared(spec, contingencies))
        self.pes: Mapping[str, PlayedPe] = {
            pe.name: PlayedPe(pe.name, pe.node_id, self.main.say) for pe in spec.pes.values()
        }
        self.main.hears = self._hear
        self.hears: list[tuple[int, ManagementMessage]] = []  # every command, and when
        self._played_by = {management_id(n, c): c for n in MANAGER_NODES for c in Command}
        for pe in self.pes.values():
            place_ns = (pe.node - 92) * PERIOD_NS // 34
            self.clock.at(place_ns, lambda pe=pe: self._beat(pe))  # type: ignore[misc]

    def _started(self, node: int, standby: bool, advise: bool, key: Key | None, ahead: Prepared) -> _Manager:
        manager = _Manager(
            self.clock,
            LocalClock(self.clock),
            self.spec,
            (self.main.bus,),
            node=node,
            disk=self.disk,
            name=f"manager {node}",
            decide_ns=lambda: MS,
            tell=self.events.append,
            planned=lambda _: None,
            advise=advise,
            standby=standby,
            key=key,
            ahead=ahead,
            witness=lambda _: None,
            reads_objects=self._objects is not None,
        )
        manager.planning_driver = _PlayedPlanner(manager, self.clock, self.spec)
        manager.planning, manager.plan_requests = self.plans, []
        return manager

    def plans(self, request: RequestPlan) -> PlanReady | PlanFailed | None:
        """Answer a request with the best plan."""
        return PlanReady(request.request, best_plan(self.spec, request.now, request.running))

    @staticmethod
    def fails(request: RequestPlan) -> PlanReady | PlanFailed | None:
        """Answer a request with a failure."""
        return PlanFailed(request.request, "told to fail")

    def _beat(self, pe: PlayedPe) -> None:
        pe.beat()
        self.clock.at(self.clock.now_ns + PERIOD_NS, lambda: self._beat(pe))

    def _hear(self, frame: Frame) -> None:
        if self._objects is not None and frame.can_id in self._node_of_request:
            node = self._node_of_request[frame.can_id]
            self.main.say(Frame(sdo_response_id(node), self._objects.answer(node, frame.data)))
        command = self._played_by.get(frame.can_id)
        message = None if command is None else decode_command(command, frame.data)
        if message is None or isinstance(message, Malformed):
            return
        self.hears.append((self.clock.now_ns, message))
        for pe in self.pes.values():
            pe.take(message)

    def validate(self) -> None:
        """Validate the manager's core, while it runs."""
        if self.manager.running:
            self.manager.core.validate()

    def flies(self) -> "ManagerUnderTest":
        """Let the first configuration be deployed; gives this object."""
        self.run(600)
        demand(bool(self.told(events.Reconfigured)), "no configuration is deployed")
        return self

    # What it sends

    def said(self, kind: type[ManagementMessage], since_ns: int = -1) -> list[tuple[int, Any]]:
        """Return the manager's commands of a kind, with their times, in nanoseconds."""
        return [(t_ns, message) for t_ns, message in self.hears if isinstance(message, kind) and t_ns > since_ns]

    def told(self, kind: type[_E], since_ns: int = -1) -> list[_E]:
        """Return the manager's events of a kind."""
        return [one for one in self.events if isinstance(one, kind) and one.t_ns > since_ns]

    def has_available(self) -> set[str]:
        """Return the PEs that the manager's last ALIVE names."""
        nodes = self.said(Alive)[-1][1].nodes
        return {pe.name for pe in self.pes.values() if pe.node in nodes}

    def lease(self) -> Lease:
        """Return the manager's last LEASE."""
        lease = self.said(Lease)[-1][1]
        assert isinstance(lease, Lease)
        return lease

    def plan_requests(self, since: int = 0) -> list[RequestPlan]:
        """Return the requests to the manager's planner."""
        return self.manager.plan_requests[since:]

    def accept(self, order: Order) -> Reply:
        """Give the manager an order; returns its reply."""
        reply = self.manager.say(order)
        demand(reply.status is not None or len(reply.sentence) > 10, f"{order} is answered with '{reply.sentence}'")
        return reply

    def heard(self, since_ns: int, *commands: Command) -> list[Heard]:
        """Return the manager's command frames, with their times, in nanoseconds."""
        return self.main.since(since_ns, [management_id(self.node, command) for command in commands])

    # What others send

    def emergency(self, pe: str, kind: ElementKind, index: int, detail: int = 0, code: FaultCode | None = None) -> None:
        """Let a PE send an EMCY."""
        said = Emergency(FaultCode.REPORTED if code is None else code, 0x81, kind, index, detail)
        self.main.say(Frame(emcy_id(self.pes[pe].node), said.encode()))

    def acknowledged(self, since_ns: int) -> list[Control]:
        """Return the manager's CONTROLs."""
        return [message for _, message in self.said(Control, since_ns)]

    def until(self, holds: Callable[[], bool], within_ms: float, what: str) -> int:
        """Let time pass until a condition holds; gives the moment, in nanoseconds."""
        end_ns = self.now_ns + round(within_ms * MS)
        while not holds():
            demand(self.now_ns < end_ns, f"within {within_ms} ms {what}")
            self.clock.run_until(self.now_ns + MS // 4)
        return self.now_ns


def remembering(spec: Spec, memory: Memory = NOTHING) -> Disk:
    """Return a disk on which a manager finds this memory."""
    disk = Disk(spec)
    for record in memory.records():
        disk.write(record, 0)
    return disk
