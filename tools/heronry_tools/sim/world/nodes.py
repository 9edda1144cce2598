"""The drivers of the simulator: a core, its stations on the buses, its deadline on the virtual clock.

The cores and the modules are the ones that fly. A PE lives on a clock of its own (`LocalClock`): no two processors of
an aircraft were switched on at the same moment, and how their periods lie to each other decides much. A module computes
in no time at all, unless it is told to overrun or its processor is slow. What a module computes for too long is told to
the core as spent; what a slow processor, a pause or a jump of the clock takes is not, as on a real node. A step that
comes to its turn when the core's word is too old (`until_ns`) is not computed, as in a real partition.

A core is asked for its invariants after every call that did more than send a frame or release a module; else at every
sixteenth deadline, and a manager at every sixteenth call.

Every step of a module that drives an actuator or is a branch of a DEMUX is told (`Driven`), with what it was given, and
of all other steps every eighth (`look`); and every order that its PE gives to a device (`Moved`), which may come
much later than the step, or never.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from random import Random
from typing import Any, NamedTuple

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.authenticity import Secret
from heronry_agent.core.vocabulary import (
    Action,
    ChannelsLost,
    Drive,
    EndPartition,
    Event,
    Left,
    MeasureStep,
    ModuleEvent,
    StepFailed,
    StepMeasured,
    StepModule,
    Stepped,
)
from heronry_agent.module import Datum, Value
from heronry_agent.shell.devices import Devices
from heronry_dg.model import Spec
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.planning_policy import FromPlanner
from heronry_manager.core.vocabulary import (
    AliveLeft,
    Emit,
    JournalTold,
    Keep,
    ManagerAction,
    ManagerEvent,
    OperatorSaid,
    Order,
    Reply,
    RequestPlan,
    Settled,
    Stop,
)
from heronry_manager.core.vocabulary import ChannelsLost as OwnChannelsLost
from heronry_tools.aircraft.plant import Plant
from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.disk import Disk
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.module_host import ModuleHost
from heronry_tools.sim.world.node import Node
from heronry_tools.sim.world.planning import Planners, Prepared
from heronry_tools.sim.world.planning_driver import PlanningDriver
from heronry_tools.sim.world.plant_view import PlantView
from heronry_tools.sim.world.replicated_port import Copy
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import PE_NODES, actuator_echo_id
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Received, Send, StandBack, Tick, Withdraw

_ECHO_IDS = frozenset(map(actuator_echo_id, PE_NODES))
_ROUTINE = frozenset((Send, StepModule, Drive))
_VALIDATED_EVERY = 16
_LOOKED_AT_EVERY = 8

OVERRUN_NS = 30_000_000
_WRONG_BY = 40.0
ASKS = "asks "  # for a phase, whose name follows


class Moved(NamedTuple):
    """A PE lets the device of a module move."""

    t_ns: int
    pe: str
    module: str


class Driven(NamedTuple):
    """A module was stepped: one that drives an actuator, or what its rivals behind a DEMUX drive, or any other.

    asked_ns: when the core asked for the step, and looked at its inputs.
    """

    t_ns: int
    pe: str
    module: str
    inputs: Mapping[str, tuple[str, Datum]]
    asked_ns: int


class SimulatedPe(Node):
    """One PE from its start to its end."""

    def __init__(
        self,
        clock: Clock,
        time: LocalClock,
        table: PeTable,
        buses: Mapping[str, Sequence[SimulatedBus]],
        *,
        incarnation: int,
        secret: Secret | None,
        world: Plant,
        drive: Callable[[Driven], None],
        look: Callable[[Driven], None],
        move: Callable[[Moved], None],
        broken: Mapping[str, str],
        broke: Callable[[str], None],
        witness: Callable[[Copy], None],
    ) -> None:
        """Join the buses, given by name and each with its channels, and start.

        drive: is told of every step of what drives, look: of some others; move: of every order to a device.
        broken: how a module fails at its next step, by name, or for which phase it ASKS; broke: is told that it has.
        witness: sees every copy of a frame on a replicated bus.
        """
        super().__init__(clock, time)
        self.name = table.name
        self._drive, self._look, self._move = drive, look, move
        self._broken, self._broke = broken, broke
        devices = {module.device for module in table.modules if module.device is not None}
        self._host = ModuleHost(table, Devices(table, dict.fromkeys(devices, PlantView(world, clock))))
        missing = frozenset(self._host.missing_images)
        self.core = AgentCore(table, incarnation, time.now_ns(), missing_images=missing, secret=secret)
        self._lease_ns = self.core.lease_ns
        self._names = {module.index: module.name for module in table.modules}
        self.modules = tuple(self._names.values())  # that may run here
        actuators = {device.name for device in table.devices if device.kind == "actuator"}
        self._drivers = {m.index: m.name for m in table.modules if m.demux or m.device in actuators}
        # There is one world, which needs nobody to follow an actuator by its echo; a gateway has to pass it on.
        self._ignored = _ECHO_IDS if len(table.ports) == 1 else frozenset[int]()
        self._identifiers: object = None
        self._wakes = self._others = 0  # steps of what does not drive
        self.stuck = False  # its modules compute for ever, and its heart beats
        self.slow: Random | None = None  # draws how long a step takes
        self.delays: Callable[[], int] | None = None  # how long what it passes on is under way; a gateway's disease
        self._passing: Frame | None = None  # what it has just received, and may pass on
        self._unfinished: list[Action] = []
        self._answers: list[Event] = []  # given while the processor stood still
        self._partitions = {module.index: module.partition for module in table.modules}
        self._hung: dict[int, tuple[StepModule, int]] = {}  # by module: its step, and when it began
        self._withdrawn = Counter[int]()  # how often, by identifier
        self._behind: dict[str, list[StepModule]] = {}  # by partition that is late: what it computes next
        self._asked_ns: dict[int, int] = {}  # by release: when it was asked for, if it has to wait for its turn
        for entry in table.ports:
            self._join(table.name, buses[entry.bus], entry, witness)
        self._handed_ns: dict[int, int] = {}  # when the frame in the mailbox of a radio's port was handed over
        self._radios = frozenset(self.core.radio_ports)
        for port in self._radios:
            self._ears[port].left = partial(self._left, port)
        self._listen()
        self._arm(self.core.next_deadline_ns())

    def unstick(self) -> None:
        """Let the step that hung come to its end."""
        self.stuck = False
        hung, self._hung = self._hung, {}
        for action, _ in hung.values():
            answer = self._host.carry_out(action, self.time.now_ns())
            assert answer is not None
            self._give(answer)
        self._wake()

    def jump(self, ahead_ns: int) -> None:
        """Let its clock jump ahead."""
        self.time.jump(ahead_ns)
        self._wake()

    def _listen(self) -> None:
        """Let the controllers filter out what means nothing here now."""
        self._identifiers = self.core.identifiers
        wanted = frozenset(self.core.identifiers) - self._ignored
        for bus, station in self.stations:
            if station.port not in self._radios:
                bus.wants(station, wanted)

    def _left(self, port: int, _: Frame) -> None:
        """A frame has left for a radio; while the processor stands still nobody is told."""
        if self.is_awake and port in self._handed_ns:
            took_ns = self.time.now_ns() - self._handed_ns.pop(port)
            self._carry_out(self.core.step(self.time.now_ns(), Left(port, max(1, took_ns))))
            self._wake()

    def _take(self, event: Received) -> None:
        self._passing = event.frame
        actions = self.core.step(self.time.now_ns(), event)
        if actions:
            self._carry_out(actions)
        due_ns = self.core.next_deadline_ns()
        if due_ns < self._armed_ns:
            self._arm(due_ns)

    def _wake(self) -> None:
        if not self.is_awake:
            return
        core, now_ns = self.core, self.time.now_ns()
        if core.next_deadline_ns() <= now_ns:
            actions = core.step(now_ns, Tick())
            if actions:
                self._carry_out(actions)
            self._wakes += 1
            if self._wakes % _VALIDATED_EVERY == 0:
                core.validate()
        due_ns = core.next_deadline_ns()
        if due_ns < self._armed_ns:
            self._arm(due_ns)

    def _carry_out(self, actions: list[Action]) -> None:
        """Do what the core asks for, and what it asks for when its modules have answered."""
        if not _ROUTINE.issuperset(map(type, actions)):
            self.core.validate()
            if self.core.identifiers is not self._identifiers:
                self._listen()
        for position, action in enumerate(actions):
            if type(action) is Send:
                self._send(action)
                continue
            answer = self._do(action)
            if answer is None:
                continue
            if not self.is_awake:
                self._put_off(actions[position + 1 :])
                self._answers.append(answer)
                return
            self._carry_out(self.core.step(self.time.now_ns(), answer))

    def _put_off(self, actions: Sequence[Action]) -> None:
        """Do this when the processor goes on."""
        self._unfinished += actions
        for action in actions:
            if type(action) is StepModule:
                self._asked_ns.setdefault(action.release, self._clock.now_ns)

    def _send(self, action: Send) -> None:
        port, frame, until_ns = action.port, action.frame, action.until_ns
        if port in self._radios:
            self._handed_ns[port] = self.time.now_ns()
        latest_ns = self.time.when_ns(self.time.now_ns() + self._lease_ns if until_ns is None else until_ns)
        if self.delays is None or frame is not self._passing:
            self._offers[port](frame, latest_ns)
        else:
            offer = partial(self._offer_late, port, frame, latest_ns, self._withdrawn[frame.can_id])
            self._clock.at(self._clock.now_ns + self.delays(), offer)

    def _offer_late(self, port: int, frame: Frame, latest_ns: int, withdrawn: int) -> None:
        """Hand over a frame that was held up: in its own queue, where it may have been withdrawn."""
        if self._withdrawn[frame.can_id] == withdrawn:
            self._offers[port](frame, latest_ns)

    def _do(self, action: Action) -> ModuleEvent | None:
        if type(action) is StepModule:
            return self._step(action)
        if type(action) is Drive:
            self._move(Moved(self._clock.now_ns, self.name, self._names[action.module]))
            return self._host.carry_out(action, self.time.now_ns())
        if isinstance(action, MeasureStep):
            return self._measure(action)
        if isinstance(action, EndPartition):
            self._hung = {m: step for m, step in self._hung.items() if self._partitions[m] != action.partition}
            self._behind.pop(action.partition, None)
        if isinstance(action, Withdraw):
            self._withdrawn.update(action.identifiers)
            for bus, station in self.stations:
                bus.withdraw(station, action.identifiers)
            return None
        if isinstance(action, StandBack):
            for bus, station in self.stations:
                if station.port == action.port:
                    bus.stand_back(station, self.time.when_ns(action.until_ns))
            return None
        return self._host.carry_out(action, self.time.now_ns())

    def _step(self, action: StepModule) -> ModuleEvent | None:
        """Let a module compute, as well as this PE can."""
        behind = self._behind.get(self._partitions[action.module])
        if behind is not None:
            behind.append(action)
            self._asked_ns.setdefault(action.release, self._clock.now_ns)
            return None
        now_ns = self._clock.now_ns
        asked_ns = self._asked_ns.pop(action.release, now_ns)
        if asked_ns != now_ns and self.time.now_ns() > action.until_ns:
            return Stepped(action.module, action.release, {})
        driver = self._drivers.get(action.module)
        if driver is not None:
            self._drive(Driven(now_ns, self.name, driver, action.inputs, asked_ns))
        elif action.inputs:
            self._others += 1
            if self._others % _LOOKED_AT_EVERY == 0:
                self._look(Driven(now_ns, self.name, self._names[action.module], action.inputs, asked_ns))
        if self.stuck:
            self._hung[action.module] = (action, now_ns)
            return None
        how = self._broken.get(self._names[action.module]) if self._broken else None
        if how is not None:
            return self._fail(action, how)
        answer = self._host.carry_out(action, self.time.now_ns())
        if self.slow is not None:
            self.pause(self.slow.randrange(8_000_000))
        return answer

    def _measure(self, action: MeasureStep) -> StepMeasured:
        """Say what a step has spent: all the time if it hangs, next to none if it does not, or has not begun."""
        partition = self._partitions[action.module]
        first = next((module for module in self._hung if self._partitions[module] == partition), None)
        spent_ns = self._clock.now_ns - self._hung[first][1] if first == action.module else 0
        return StepMeasured(action.module, action.release, spent_ns)

    def _channels_lost(self, port: int, lost: frozenset[int]) -> None:
        self._give(ChannelsLost(port, lost))

    def _give(self, answer: Event) -> None:
        """Give the core an answer that comes later than it was asked for, or what nobody asked for."""
        if not self.is_awake:
            self._answers.append(answer)
        else:
            self._carry_out(self.core.step(self.time.now_ns(), answer))
            self._wake()

    def _fail(self, action: StepModule, how: str) -> ModuleEvent | None:
        name = self._names[action.module]
        answer = self._host.carry_out(action, self.time.now_ns())
        if how == "overrun" and isinstance(answer, Stepped):
            late = answer._replace(spent_ns=OVERRUN_NS)
            behind = self._behind[self._partitions[action.module]] = []
            self._clock.at(self._clock.now_ns + OVERRUN_NS, partial(self._end_late, late, behind))
            return None
        if how == "unfit" and isinstance(answer, Stepped) and answer.outputs:
            self._broke(name)
            unfit = dict.fromkeys(answer.outputs, "what no such type can carry")
            return Stepped(action.module, action.release, unfit)
        if how.startswith(ASKS) and isinstance(answer, Stepped):
            return answer._replace(phases=(how.removeprefix(ASKS),))
        if how == "raise":
            self._broke(name)
            return StepFailed(action.module, action.release, "told to fail")
        if how == "wrong" and isinstance(answer, Stepped):
            return Stepped(action.module, action.release, {name: _off(v) for name, v in answer.outputs.items()})
        return answer

    def _end_late(self, late: Stepped, behind: list[StepModule]) -> None:
        """A late step has ended; its partition goes on, if it has not been ended meanwhile."""
        self._give(late)
        partition = self._partitions[late.module]
        if self._behind.get(partition) is behind:
            del self._behind[partition]
            if not self.is_awake:
                self._put_off(behind)
                return
            for action in behind:
                answer = self._step(action)
                if answer is not None:
                    self._give(answer)

    def _resume(self) -> None:
        unfinished, self._unfinished = self._unfinished, []
        self._carry_out(unfinished)

    def _caught_up(self) -> None:
        answers, self._answers = self._answers, []
        for answer in answers:
            self._give(answer)


def _off(value: Value) -> Value:
    """Give another value of the same type."""
    if isinstance(value, float):
        return value + _WRONG_BY
    return value ^ 1 if isinstance(value, int) else value


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
        tell: Callable[[dict[str, Any]], None],
        advise: bool = False,
        standby: bool = False,
        key: Key | None = None,
        planners: Planners = Planners.BEST,
        ahead: Prepared,
        witness: Callable[[Copy], None],
    ) -> None:
        """Join the bus, on each of its channels, and start.

        decide_ns: gives how long the next plan takes. tell: is told every event. ahead: the plans made ahead.
        disk: where its journal is kept. name: of its station.
        """
        super().__init__(clock, time)
        self._tell = tell
        self.planning_driver = PlanningDriver(clock, spec, planners, ahead.made, decide_ns=decide_ns, tell=self._told)
        self._ready: list[ManagerEvent | FromPlanner] = []
        self._replies: list[Reply] = []
        self._handed = 0
        self.stopped: str | None = None  # why the core wanted to end
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
        )
        self.disk = disk
        self._journal_problem: str | None = None
        self._join(name, bus, spec.buses[spec.manager.bus], witness, _Heard(self.core))
        self._ears[0].left = self._left
        self._set_alarm()

    def say(self, order: Order) -> Reply:
        """Let the operator give an order; gives the answer."""
        self._hand_over(OperatorSaid(0, order))
        return self._replies.pop()

    def jump(self, ahead_ns: int) -> None:
        """Let its clock jump ahead."""
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
        if self._handed % _VALIDATED_EVERY == 0 or not _ROUTINE.issuperset(map(type, actions)):
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
            case RequestPlan() | Settled():
                self.planning_driver.take(action)
            case Emit(event):
                self._tell({**event, "t_ns": self._clock.now_ns})
            case Keep(record):
                self.disk.write(record, self._clock.now_ns)
            case Reply():
                self._replies.append(action)
            case Stop(reason):
                self.stopped = reason
                self.stop()

    def _left(self, frame: Frame) -> None:
        """A frame is on the bus; while the processor stands still nobody is told."""
        if frame.can_id == self.core.alive_id and self.is_awake:
            self._hand_over(AliveLeft(frame))

    def _channels_lost(self, _: int, lost: frozenset[int]) -> None:
        self._told(OwnChannelsLost(lost))

    def _told(self, ready: ManagerEvent | FromPlanner) -> None:
        """A planner, a process of its own, has answered, or the driver has something to tell."""
        if not self.is_awake:
            self._ready.append(ready)
        elif isinstance(ready, FromPlanner):
            self.planning_driver.take(ready)
        else:
            self._hand_over(ready)

    def _caught_up(self) -> None:
        waiting, self._ready = self._ready, []
        for ready in waiting:
            self._told(ready)


class _Heard:
    """The identifiers that a manager's core wants; they never change."""

    def __init__(self, core: ManagerCore) -> None:
        self._core = core

    def __contains__(self, identifier: object) -> bool:
        return isinstance(identifier, int) and self._core.hears(identifier)
