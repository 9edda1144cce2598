"""The drivers of the simulator: a core, its stations on the buses, its deadline on the virtual clock.

What a real driver does with a socket and a timer, these do with a `Station` and the `Clock`; the cores and the modules
are the ones that fly. Every call that makes a core do something is followed by its `validate`; what a call breaks that
does nothing shows with the next one, a beat later at most.

A PE lives on a clock of its own, ahead of virtual time by `ahead_ns`: no two processors of an aircraft were switched on
at the same moment, and how their periods lie to each other decides much. A module computes in no time at all.

A node that has been stopped is silent at once, whatever it had queued. Nothing of it survives; who comes back is new.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from heronry_agent.bench import Bench
from heronry_agent.core import AgentCore
from heronry_agent.host import Answer, ModuleHost
from heronry_agent.vocabulary import Action, StepModule
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_manager.core import ManagerCore
from heronry_manager.vocabulary import Emit, ManagerAction, ManagerEvent, PlanReady, RequestPlan, Stop
from heronry_tools.simulator.bus import SimulatedBus
from heronry_tools.simulator.clock import Clock
from heronry_tools.simulator.planning import best_plan
from heronry_tools.simulator.world import Window
from heronry_wire.identifiers import PE_NODES, actuator_echo_id
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import NEVER_NS, Received, Send, Tick, Withdraw, require

_MOST_RINGS_AT_ONCE = 1000
_ECHO_IDS = frozenset(map(actuator_echo_id, PE_NODES))


class Driven(NamedTuple):
    """A branch of a DEMUX was stepped: it drives what its rivals drive."""

    t_ns: int
    pe: str
    module: str


class Alarm:
    """One deadline on the virtual clock that moves; an alarm that has been overtaken rings for nobody."""

    def __init__(self, clock: Clock, ring: Callable[[], None]) -> None:
        """`ring` is called at the deadline, which is forgotten then."""
        self._clock, self._ring = clock, ring
        self._due_ns = NEVER_NS
        self._last_ns, self._rings = -1, 0  # at one instant

    def set(self, due_ns: int) -> None:
        """Ring no later than this; an earlier deadline stays."""
        if due_ns < self._due_ns:
            self._due_ns = due_ns
            self._clock.at(due_ns, self._fall_due)

    def stop(self) -> None:
        """Ring no more."""
        self._due_ns = -1

    def _fall_due(self) -> None:
        now_ns = self._clock.now_ns
        if not 0 <= self._due_ns <= now_ns:
            return
        self._due_ns = NEVER_NS
        self._rings = self._rings + 1 if now_ns == self._last_ns else 1
        self._last_ns = now_ns
        require(self._rings <= _MOST_RINGS_AT_ONCE, "a core wants to be called at {} ns again and again", now_ns)
        self._ring()


class SimulatedPe:
    """One PE from its start to its end."""

    def __init__(
        self,
        clock: Clock,
        table: PeTable,
        buses: Mapping[str, SimulatedBus],
        *,
        incarnation: int,
        ahead_ns: int,
        world: Bench,
        drive: Callable[[Driven], None],
    ) -> None:
        """Join the buses and start; `drive` is told of every step of a DEMUX branch."""
        self.name = table.name
        self._clock, self._ahead_ns, self._drive = clock, ahead_ns, drive
        self._host = ModuleHost(table, Window(world, ahead_ns))
        missing = frozenset(self._host.missing_images)
        self.core = AgentCore(table, incarnation, clock.now_ns + ahead_ns, missing_images=missing)
        self._branches = {module.index: module.name for module in table.modules if module.demux}
        self._stations = [
            (buses[port.bus], buses[port.bus].join(table.name, i, self._receive)) for i, port in enumerate(table.ports)
        ]
        # There is one world, which needs nobody to follow an actuator by its echo; a gateway has to pass it on.
        self._ignored = _ECHO_IDS if len(table.ports) == 1 else frozenset[int]()
        self._alarm = Alarm(clock, self._wake)
        self._alarm.set(self.core.next_deadline_ns() - ahead_ns)

    def stop(self) -> None:
        """Die."""
        self._alarm.stop()
        for bus, station in self._stations:
            bus.leave(station)

    def cut(self) -> None:
        """Break every wire of this PE; it lives on."""
        for bus, station in self._stations:
            bus.cut(station)

    def mend(self) -> None:
        """Mend every wire of this PE."""
        for bus, station in self._stations:
            bus.mend(station)

    def deafen(self, *, deaf: bool) -> None:
        """Let it hear nothing, on no bus, or hear again."""
        for _, station in self._stations:
            station.deaf = deaf

    def _receive(self, event: Received) -> None:
        core, identifier = self.core, event.frame.can_id
        if core.hears(identifier) and identifier not in self._ignored:
            now_ns = self._clock.now_ns + self._ahead_ns
            actions = core.step(now_ns, event)
            if actions:
                self._carry_out(now_ns, actions)
            self._alarm.set(core.next_deadline_ns() - self._ahead_ns)

    def _wake(self) -> None:
        due_ns = self.core.next_deadline_ns() - self._ahead_ns
        if due_ns > self._clock.now_ns:
            self._alarm.set(due_ns)
        else:
            now_ns = self._clock.now_ns + self._ahead_ns
            self._carry_out(now_ns, self.core.step(now_ns, Tick()))
            self._alarm.set(self.core.next_deadline_ns() - self._ahead_ns)

    def _carry_out(self, now_ns: int, actions: list[Action]) -> None:
        """Do what the core asks for, and what it asks for when its modules have answered."""
        self.core.validate()
        for action in actions:
            answer = self._do(now_ns, action)
            if answer is not None:
                self._carry_out(now_ns, self.core.step(now_ns, answer))

    def _do(self, now_ns: int, action: Action) -> Answer | None:
        match action:
            case Send(port, frame, until_ns):
                bus, station = self._stations[port]
                latest_ns = now_ns + self.core.lease_ns if until_ns is None else until_ns
                bus.offer(station, frame, latest_ns - self._ahead_ns)
            case Withdraw(identifiers):
                for bus, station in self._stations:
                    bus.withdraw(station, identifiers)
            case StepModule():
                if action.module in self._branches:
                    self._drive(Driven(self._clock.now_ns, self.name, self._branches[action.module]))
            case _:
                pass
        return self._host.carry_out(action, now_ns)


class SimulatedManager:
    """One manager from its start to its end."""

    def __init__(
        self,
        clock: Clock,
        spec: Spec,
        bus: SimulatedBus,
        *,
        node: int,
        term: int,
        decide_ns: Callable[[], int],
        tell: Callable[[dict[str, Any]], None],
    ) -> None:
        """Join the bus and start; `decide_ns` gives how long the next plan takes, `tell` is told every event."""
        self._clock, self._spec, self._bus = clock, spec, bus
        self._decide_ns, self._tell = decide_ns, tell
        self._running = True
        self.stopped: str | None = None  # why the core wanted to end
        self.core = ManagerCore(spec, node, term, clock.now_ns)
        self._station = bus.join(f"manager {node}", 0, self._receive)
        self._alarm = Alarm(clock, self._wake)
        self._set_alarm()

    def stop(self) -> None:
        """Die."""
        self._running = False
        self._alarm.stop()
        self._bus.leave(self._station)

    def _receive(self, event: Received) -> None:
        if self.core.hears(event.frame.can_id):
            self._take(event)

    def _set_alarm(self) -> None:
        due_ns = self.core.next_deadline_ns()
        if due_ns is not None:
            self._alarm.set(due_ns)

    def _wake(self) -> None:
        due_ns = self.core.next_deadline_ns()
        if due_ns is not None and due_ns <= self._clock.now_ns:
            self._take(Tick())
        else:
            self._set_alarm()

    def _take(self, event: ManagerEvent) -> None:
        if not self._running:
            return
        for action in self.core.step(self._clock.now_ns, event):
            self._do(action)
        self.core.validate()
        if self._running:
            self._set_alarm()

    def _do(self, action: ManagerAction) -> None:
        match action:
            case Send(_, frame):
                self._bus.offer(self._station, frame)
            case RequestPlan():
                now = Situation(action.down, {}, action.phase)
                ready = PlanReady(action.request, best_plan(self._spec, now, action.running))
                self._clock.at(self._clock.now_ns + self._decide_ns(), lambda: self._take(ready))
            case Emit(event):
                self._tell(event)
            case Stop(reason):
                self.stopped = reason
                self.stop()
