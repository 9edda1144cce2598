"""The driver of a simulated manager, with the manager's core, stations on the bus, disk and planners.

The core is the same code as on an aircraft. The invariants of the core are checked after each call in which it did more
than send frames, and after every sixteenth call.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement
from heronry_manager.core.manager import ManagerCore
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
    Settled,
    Stop,
)
from heronry_manager.events import Event
from heronry_manager.planning_policy import FromPlanner
from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.disk import Disk
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.node import VALIDATED_EVERY, Node
from heronry_tools.sim.world.planning import Planners, Prepared
from heronry_tools.sim.world.planning_driver import PlanningDriver
from heronry_tools.sim.world.planning_seen import PlanGiven, PlanningSeen, PlanRequested
from heronry_tools.sim.world.replicated_port import Copy
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.sansio import Received, Send, Tick

_ROUTINE = frozenset((Send,))


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
        tables: Mapping[str, bytes] | None = None,
        bundles: tuple[CodeBundle, ...] = (),
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
        tables: the table of each PE as it goes over the bus, for a node without one; None: none is brought
        bundles: code for PEs that lack it
        """
        super().__init__(clock, time)
        self._tell, self._planned, self._name = tell, planned, name
        self._ran: Placement | None = None  # what ran when a plan was requested last
        self.planning_driver = PlanningDriver(clock, spec, planners, ahead.made, decide_ns=decide_ns, tell=self._told)
        self._ready: list[ManagerEvent | FromPlanner] = []
        self._replies: list[Reply] = []
        self._handed = 0
        self.stopped: str | None = None  # why the core has ended; None: it has not
        memory = disk.opened()
        self.core = ManagerCore(
            spec,
            node,
            memory,
            time.now_ns(),
            advise=advise,
            on_board=ahead.numbers,
            key=key,
            standby=standby,
            tells_departures=True,
            reads_objects=reads_objects,
            tables=tables,
            bundles=bundles,
            compiler=ahead.compiler,
        )
        self.disk = disk
        self._journal_problem: str | None = None
        self._join(name, bus, spec.buses[spec.manager.bus], witness, _Heard(self.core))
        self._ears[0].left = self._left
        self._set_alarm()

    def say(self, order: Order) -> Reply:
        """Give the core an order of the operator; return the core's answer."""
        self._hand_over(OperatorSaid(0, order))
        return self._replies.pop()

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
            case Emit(event):
                self._tell(replace(event, t_ns=self._clock.now_ns))
            case Keep(record):
                self.disk.write(record, self._clock.now_ns)
            case Reply():
                self._replies.append(action)
            case Stop(reason):
                self.stopped = reason
                self.stop()

    def _left(self, frame: Frame) -> None:
        """Tell an awake core that its ALIVE has left the controller."""
        if frame.can_id == self.core.alive_id and self.is_awake:
            self._hand_over(AliveLeft(frame))

    def _channels_lost(self, _: int, lost: frozenset[int]) -> None:
        self._told(ChannelsLost(lost))

    def _told(self, ready: ManagerEvent | FromPlanner) -> None:
        """Give the planning policy an answer of a planner (`FromPlanner`), or the core any other event.

        If the processor is paused, the event is given when the pause ends.
        """
        if not self.is_awake:
            self._ready.append(ready)
        elif isinstance(ready, FromPlanner):
            self.planning_driver.take(ready)
        else:
            if isinstance(ready, PlanReady | PlanFailed):
                is_new = isinstance(ready, PlanReady) and placement(ready.plan.configuration) != self._ran
                self._planned(PlanGiven(self._clock.now_ns, self._name, ready.request, is_new))
            self._hand_over(ready)

    def _caught_up(self) -> None:
        waiting, self._ready = self._ready, []
        for ready in waiting:
            self._told(ready)


class _Heard:
    """The set of identifiers that a manager's core receives."""

    def __init__(self, core: ManagerCore) -> None:
        self._core = core

    def __contains__(self, identifier: object) -> bool:
        return isinstance(identifier, int) and self._core.hears(identifier)
