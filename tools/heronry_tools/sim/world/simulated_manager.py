"""The driver of a simulated manager, with the manager's core, stations on the bus, disk and planners.

The core is the same code as on an aircraft. The invariants of the core are checked after each call in which it did more
than send frames, and after every sixteenth call.

When the PEs have changed to another spec (`reload`), a core of that spec takes the place of the present one, as in the
driver that flies; what planners of the spec before still answer is dropped.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import Memory
from heronry_manager.core.settings import CodeBundle
from heronry_manager.core.vocabulary import (
    AliveLeft,
    ChannelsLost,
    Emit,
    JournalTold,
    Keep,
    ManagerAction,
    ManagerEvent,
    OperatorSaid,
    Order,
    PlanFailed,
    PlanReady,
    Reply,
    RequestPlan,
    RequestSwitch,
    Settled,
    SpecSwitched,
    Stop,
)
from heronry_manager.events import Event
from heronry_manager.planning_policy import FromPlanner
from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.disk import Disk
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.next_spec import NextSpec
from heronry_tools.sim.world.node import VALIDATED_EVERY, Node
from heronry_tools.sim.world.planning import Planners, Prepared
from heronry_tools.sim.world.planning_driver import PlanningDriver
from heronry_tools.sim.world.planning_seen import PlanGiven, PlanningSeen, PlanRequested
from heronry_tools.sim.world.replicated_port import Copy
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import PE_NODES, state_id
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.state_frames import page_of

_ROUTINE = frozenset((Send,))
_STATE_IDS = frozenset(map(state_id, PE_NODES))


class SimulatedManager(Node):
    """One manager from its start to its end."""

    def __init__(
        self,
        clock: Clock,
        time: LocalClock,
        spec: Spec,
        bus: Sequence[SimulatedBus],
        *,
        node: int,
        disk: Disk,
        name: str,
        decide_ns: Callable[[], int],
        tell: Callable[[Event], None],
        planned: Callable[[PlanningSeen], None],
        ahead: Prepared,
        witness: Callable[[Copy], None],
        advise: bool = False,
        standby: bool = False,
        key: Key | None = None,
        planners: Planners = Planners.BEST,
        reads_objects: bool = False,
        brings_tables: bool = False,
        bundles: tuple[CodeBundle, ...] = (),
        switched: Callable[[NextSpec], None] = lambda _: None,
    ) -> None:
        """Join the bus on each of its channels, and start the manager.

        disk: the disk with the manager's journal
        name: name of the manager's station
        decide_ns: returns the time that the next planning run takes
        tell: is called with every event of the manager
        planned: is called with every request for a plan, and with every answer that the core is given
        ahead: the contingencies; its `made` and `numbers` are None if there are none
        reads_objects: whether the manager reads by SDO the details that PEs store for people, for example why a module
            has failed (`pe_details`)
        brings_tables: whether it brings a table to a node without one
        bundles: code for PEs that lack it
        switched: is called with the spec by which the PEs and this manager fly from now on, when they have changed
        """
        super().__init__(clock, time)
        self._tell, self._planned, self._name = tell, planned, name
        self._ran: Placement | None = None  # what ran when a plan was requested last
        self._ready: list[tuple[int, ManagerEvent | FromPlanner]] = []
        self._replies: list[Reply] = []
        self._handed = 0
        self.stopped: str | None = None  # why the core has ended; None: it has not
        self._planners, self._decide_ns, self._brings_tables = planners, decide_ns, brings_tables
        self._common: dict[str, Any] = {
            "advise": advise,
            "key": key,
            "standby": standby,
            "tells_departures": True,
            "reads_objects": reads_objects,
            "bundles": bundles,
        }
        self._node, self._switched = node, switched
        self._next: NextSpec | None = None
        self._states: dict[int, tuple[int, Frame]] = {}  # last page 0 of each PE, and when it came
        self._cores = 0
        self.disk = disk
        self._journal_problem: str | None = None
        self._begin(spec, ahead, disk.opened())
        self._join(name, bus, spec.buses[spec.manager.bus], witness, _Heard(self))
        self._ears[0].left = self._left
        self._set_alarm()

    def _begin(self, spec: Spec, ahead: Prepared, memory: Memory) -> None:
        """Begin with a core of this spec, and with planners of its own."""
        self._cores += 1
        self.spec = spec
        self.planning_driver = PlanningDriver(
            self._clock,
            spec,
            self._planners,
            ahead.made,
            decide_ns=self._decide_ns,
            tell=partial(self._told, of=self._cores),
        )
        self.core = ManagerCore(
            spec,
            self._node,
            memory,
            self.time.now_ns(),
            on_board=ahead.numbers,
            tables=ahead.contents if self._brings_tables else None,
            compiler=ahead.compiler,
            **self._common,
        )

    def say(self, order: Order) -> Reply:
        """Give the core an order of the operator; return the core's answer."""
        self._hand_over(OperatorSaid(0, order))
        return self._replies.pop()

    def reload(self, following: NextSpec) -> Reply:
        """Give the core the operator's order to change to another spec; return the answer."""
        order = following.other.order(self.spec)
        if isinstance(order, str):
            return Reply(0, done=False, sentence=order)
        reply = self.say(order)
        if reply.done:
            self._next = following
        return reply

    def jump(self, ahead_ns: int) -> None:
        """Let the manager's clock jump ahead by `ahead_ns`."""
        self.time.jump(ahead_ns)
        self._wake()

    def _set_alarm(self) -> None:
        due_ns = self.core.next_deadline_ns()
        if due_ns is not None and due_ns < self._armed_ns:
            self._arm(due_ns)

    def _wake(self) -> None:
        if not self.is_awake:
            return
        due_ns = self.core.next_deadline_ns()
        if due_ns is not None and due_ns <= self.time.now_ns():
            self._hand_over(Tick())
        else:
            self._set_alarm()

    def _take(self, event: Received) -> None:
        frame = event.frame
        if self._next is not None and frame.can_id in _STATE_IDS and page_of(frame.data) == 0:
            self._states[frame.can_id] = self.time.now_ns(), frame
        self._hand_over(event)

    def _hand_over(self, event: ManagerEvent) -> None:
        if not self.running:
            return
        actions = self.core.step(self.time.now_ns(), event)
        for action in actions:
            self._do(action)
        self._handed += 1
        if self._handed % VALIDATED_EVERY == 0 or not _ROUTINE.issuperset(map(type, actions)):
            self.core.validate()
        if self.disk.problem != self._journal_problem:
            self._journal_problem = self.disk.problem
            self._hand_over(JournalTold(self._journal_problem))
        if self.running:
            self._set_alarm()

    def _do(self, action: ManagerAction) -> None:
        match action:
            case Send(_, frame):
                self._offers[0](frame, self._clock.now_ns + self.core.lease_ns)
            case RequestPlan(request, _, running):
                self._ran = running
                self._planned(PlanRequested(self._clock.now_ns, self._name, request))
                self.planning_driver.take(action)
            case Settled():
                self.planning_driver.take(action)
            case RequestSwitch():
                assert self._next is not None
                self._told(self._next.other.first(action))
            case SpecSwitched():
                self._succeed(action)
            case Emit(event):
                self._tell(replace(event, t_ns=self._clock.now_ns))
            case Keep(record):
                self.disk.write(record, self._clock.now_ns)
            case Reply():
                self._replies.append(action)
            case Stop(reason):
                self.stopped = reason
                self.stop()

    def _succeed(self, switched: SpecSwitched) -> None:
        """Go on with a core of the spec by which all PEs fly now; stations and disk stay."""
        following, self._next = self._next, None
        assert following is not None
        memory = following.other.memory(self.core.memory, switched)
        self.disk.is_of(following.spec, memory)
        heard_ns = self.time.now_ns() - 2 * self.core.heartbeat_ns
        self._ran = None
        self._begin(following.spec, following.ahead, memory)
        self._switched(following)
        self.core.succeed(frame for at_ns, frame in self._states.values() if at_ns >= heard_ns)
        self._states.clear()
        self._hand_over(Tick())

    def _left(self, frame: Frame) -> None:
        """Tell an awake core that its ALIVE has left the controller."""
        if frame.can_id == self.core.alive_id and self.is_awake:
            self._hand_over(AliveLeft(frame))

    def _channels_lost(self, _: int, lost: frozenset[int]) -> None:
        self._told(ChannelsLost(lost))

    def _told(self, ready: ManagerEvent | FromPlanner, of: int = 0) -> None:
        """Give the planning policy an answer of a planner (`FromPlanner`), or the core any other event.

        If the processor is paused, the event is given when the pause ends.

        of: number of the core whose planners answer; what those of an earlier core answer is dropped. 0: of any core.
        """
        if of not in (0, self._cores):
            return
        if not self.is_awake:
            self._ready.append((of, ready))
        elif isinstance(ready, FromPlanner):
            self.planning_driver.take(ready)
        else:
            if isinstance(ready, PlanReady | PlanFailed):
                is_new = isinstance(ready, PlanReady) and placement(ready.plan.configuration) != self._ran
                self._planned(PlanGiven(self._clock.now_ns, self._name, ready.request, is_new))
            self._hand_over(ready)

    def _caught_up(self) -> None:
        waiting, self._ready = self._ready, []
        for of, ready in waiting:
            self._told(ready, of)


class _Heard:
    """The set of identifiers that a manager's core receives."""

    def __init__(self, manager: SimulatedManager) -> None:
        self._manager = manager

    def __contains__(self, identifier: object) -> bool:
        return isinstance(identifier, int) and self._manager.core.hears(identifier)
