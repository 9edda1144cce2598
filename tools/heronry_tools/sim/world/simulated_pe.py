"""The driver of a simulated PE: its core, its stations, its modules, and its timer on the virtual clock.

The core and the modules are the code that flies. A PE has its own clock (`LocalClock`): the processors of an aircraft
are not switched on at the same moment, so the heartbeat periods of two PEs begin at different times. The effect of a
fault may depend on this difference. `module_steps` models the time of steps, `pe_outbox` the sending of frames.

The core's invariants are checked after every call that did more than send a frame, release a module or command a
device, and at every sixteenth deadline.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.authority import Secret
from heronry_agent.core.carried_over import read_beside
from heronry_agent.core.vocabulary import (
    Action,
    ChannelsLost,
    ControlProgram,
    Drive,
    EndPartition,
    Event,
    ImagesMissing,
    KeepParts,
    KeptState,
    Left,
    MeasureStep,
    ModuleEvent,
    PrepareTable,
    StartModule,
    StateEvent,
    StateRestored,
    StateSaved,
    StepModule,
    SwitchTable,
    TablePrepared,
    WriteProgram,
)
from heronry_agent.module import Module
from heronry_agent.shell.devices import Devices
from heronry_agent.shell.module_numbers import ModuleNumbers
from heronry_dg.echo_rates import MOST_ECHOES_PER_S
from heronry_tools.aircraft.plant import PlantOfDevices
from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.module_host import ModuleHost
from heronry_tools.sim.world.module_steps import ModuleSteps
from heronry_tools.sim.world.node import VALIDATED_EVERY, Node
from heronry_tools.sim.world.other_code import version_of
from heronry_tools.sim.world.pe_outbox import PeOutbox
from heronry_tools.sim.world.plant_view import PlantView
from heronry_tools.sim.world.replicated_port import Copy
from heronry_tools.sim.world.simulated_loader import SimulatedLoader
from heronry_tools.sim.world.steps_seen import Driven, Moved, StateSeen, Withheld
from heronry_wire.frame import Frame
from heronry_wire.identifiers import PE_NODES, actuator_echo_id, sdo_response_id
from heronry_wire.pe_table import PeTable, TableError
from heronry_wire.sansio import Received, Send, StandBack, Tick, Withdraw

_ECHO_IDS = frozenset(map(actuator_echo_id, PE_NODES))
_ROUTINE = frozenset((Send, StepModule, Drive))
_TAKEN_AWAY = "the simulator took it away"


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
        world: PlantOfDevices,
        drive: Callable[[Driven], None],
        look: Callable[[Driven], None],
        withheld: Callable[[Withheld], None],
        state: Callable[[StateSeen], None],
        move: Callable[[Moved], None],
        broken: Mapping[str, str],
        broke: Callable[[str], None],
        witness: Callable[[Copy], None],
        lacks: frozenset[str] = frozenset(),
        other_code: Collection[str] = (),
        loader: Callable[[Callable[[ModuleEvent], None]], SimulatedLoader] | None = None,
        switched: Callable[[PeTable], None] = lambda _: None,
        stepped: Callable[[str], None] | None = None,
        took: Callable[[PeTable], None] | None = None,
    ) -> None:
        """Join the buses of the PE's table, and start the PE.

        buses: the channels of each bus, by the name of the bus
        drive: is called with every step of a module that drives an actuator, or is a branch of a DEMUX
        look: is called with every eighth of the other steps that have inputs
        withheld: is called with every step that leaves out an output of its module's mode
        state: is called when a module has saved its state, or has started from a state
        move: is called when the PE allows a device to move
        broken: how a module fails in its steps, or which phase it requests (ASKS and the phase); by the name of
            the module or, for one PE, by NAME@PE
        broke: is called with the name of a module that has raised an error or given a value outside its type's range
        witness: is called with every copy of a frame on a replicated bus
        lacks: modules whose code is missing on this PE
        other_code: images of which this PE has another version now; may change later
        switched: is called with the table by which the PE flies from now on, when it has changed in flight
        stepped: is called with the name of a module at each of its steps; None: nobody asks
        took: is called when the PE has ended since a table was brought in place of its own, while it ran nothing; the
            caller starts it with this table. None: it ignores such a table
        loader: makes the loader of this PE from the function to which it gives its answers; None: it has none
        """
        super().__init__(clock, time)
        self.name = table.name
        self._move, self._state = move, state
        devices = {module.device for module in table.modules if module.device is not None}
        self._plant = PlantView(world, clock)
        self._open = Devices(table, dict.fromkeys(devices, self._plant))
        self._host = ModuleHost(table, self._open, other_code)
        self._numbers, self._switched = ModuleNumbers(table), switched
        self._images = {module.name: module.image for module in table.modules}
        self._loader = None if loader is None else loader(self.give)
        has_code = self._loader is not None and self._loader.program.version > 0
        taken_away = {} if has_code else {self._images[module]: _TAKEN_AWAY for module in lacks}
        missing = dict(self._host.missing_images) | taken_away
        has_room = table.echoes_per_s >= MOST_ECHOES_PER_S  # then the simulated plant asks for an echo of every command
        self.core = AgentCore(
            table,
            incarnation,
            time.now_ns(),
            missing_images=missing,
            secret=secret,
            every_echo=has_room,
            program=None if self._loader is None else self._loader.program,
            kept_parts=b"" if self._loader is None else self._loader.kept_parts,
            takes_tables=True,
        )
        self.steps = ModuleSteps(
            clock,
            time,
            table,
            self._host,
            self,
            drive=drive,
            look=look,
            withheld=withheld,
            broken=broken,
            broke=broke,
            stepped=stepped,
        )
        self.modules = tuple(self.steps.names.values())  # modules that may run here
        # The one plant needs no output echoes; but a gateway must forward them.
        self._ignored = _ECHO_IDS if len(table.ports) == 1 else frozenset[int]()
        self._identifiers: object = None
        self._wakes = 0
        self._unfinished: list[Action] = []
        self._answers: list[Event] = []  # events that came during a pause of the processor
        for entry in table.ports:
            self._join(table.name, buses[entry.bus], entry, witness)
        self.outbox = PeOutbox(
            clock,
            time,
            self._offers,
            self.stations,
            lease_ns=self.core.lease_ns,
            radios=frozenset(self.core.radio_ports),
        )
        for port in self.outbox.radios:
            self._ears[port].left = partial(self._left, port)
        self._took, self._answer_id = took, sdo_response_id(table.node_id)
        if took is not None and table.uplink not in self.outbox.radios:
            self._ears[table.uplink].left = self._answered
        self._listen()
        self._arm(self.core.next_deadline_ns())

    def lack(self, module: str) -> None:
        """Report to the core that the code of a module is missing on this PE."""
        self.give(ImagesMissing({self._images[module]: _TAKEN_AWAY}))

    def stop(self) -> None:
        """End the PE, and with it its loader's keeper."""
        super().stop()
        if self._loader is not None:
            self._loader.stop()

    def unstick(self) -> None:
        """Complete the steps that hang."""
        self.steps.unstick()
        self._wake()

    def code(self, module: str) -> Module | None:
        """Return the object of a module, for an observer that does not change it.

        Return None if the module does not run on this PE.
        """
        numbers = (number for number, name in self.steps.names.items() if name == module)
        return next((code for number in numbers if (code := self._host.code(number)) is not None), None)

    def jump(self, ahead_ns: int) -> None:
        """Let the PE's clock jump ahead by `ahead_ns`."""
        self.time.jump(ahead_ns)
        self._wake()

    def give(self, answer: Event) -> None:
        """Give the core an event, for example the late answer to a request.

        During a pause of the processor, the event is kept until the pause is over.
        """
        if not self.is_awake:
            self._answers.append(answer)
        else:
            self._carry_out(self.core.step(self.time.now_ns(), answer))
            self._wake()

    def answer(self, answer: ModuleEvent) -> None:
        """Give the core the late answer of a module, which `steps` knows by its number."""
        about = self._numbers.outward(answer)
        if about is not None:
            self.give(about)

    def put_off_steps(self, steps: Sequence[StepModule]) -> None:
        """Execute steps of modules, which `steps` knows by their numbers, when the pause of the processor ends."""
        indices = [(step, self._numbers.index(step.module)) for step in steps]
        self.put_off([step._replace(module=index) for step, index in indices if index is not None])

    def put_off(self, actions: Sequence[Action]) -> None:
        """Execute these actions when the pause of the processor ends."""
        self._unfinished += actions
        self.steps.wait(actions)

    def _listen(self) -> None:
        """Set the controllers' filters to the identifiers that this PE needs now."""
        self._identifiers = self.core.identifiers
        wanted = frozenset(self.core.identifiers) - self._ignored
        for bus, station in self.stations:
            if station.port not in self.outbox.radios:
                bus.wants(station, wanted)

    def _left(self, port: int, _: Frame) -> None:
        """Report to the core that a frame was sent to a radio; no effect while the processor is paused."""
        if not self.is_awake:
            return
        took_ns = self.outbox.took_ns(port)
        if took_ns is not None:
            self._carry_out(self.core.step(self.time.now_ns(), Left(port, max(1, took_ns))))
            self._wake()

    def _answered(self, frame: Frame) -> None:
        """End this PE when the answer to the sender of another table is on the bus."""
        table = self.core.new_table
        if frame.can_id == self._answer_id and table is not None and self._took is not None and self.running:
            self.stop()
            self._took(table)

    def _take(self, event: Received) -> None:
        self.outbox.passing = event.frame
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
            if self._wakes % VALIDATED_EVERY == 0:
                core.validate()
        due_ns = core.next_deadline_ns()
        if due_ns < self._armed_ns:
            self._arm(due_ns)

    def _carry_out(self, actions: list[Action]) -> None:
        """Execute the core's actions, and those that the core requests after the modules' answers.

        What modules answer about their states is given to the core at the end, as on a node.
        """
        if not _ROUTINE.issuperset(map(type, actions)):
            self.core.validate()
            if self.core.identifiers is not self._identifiers:
                self._listen()
        states: list[StateEvent] = []
        for position, action in enumerate(actions):
            if type(action) is Send:
                self.outbox.send(action)
                continue
            answer = self._do(action)
            if answer is None:
                continue
            if not self.is_awake:
                self.put_off(actions[position + 1 :])
                self._answers += [*states, answer]
                return
            if isinstance(answer, StateEvent):
                states.append(answer)
            else:
                self._carry_out(self.core.step(self.time.now_ns(), answer))
        for answer in states:
            self.give(answer)

    def _tell_state(self, action: Action, answer: StateEvent) -> None:
        """Report a state that was saved or restored; `action` is the order that `answer` answers, both by numbers."""
        now_ns, module = self._clock.now_ns, self.steps.names[answer.module]
        code = self._host.code(answer.module)
        version = "" if code is None else version_of(code)
        if isinstance(answer, StateSaved) and answer.data:
            self._state(StateSeen(now_ns, self.name, module, True, answer.data, version, answer.round))
        elif isinstance(answer, StateRestored) and isinstance(action, StartModule):
            assert isinstance(action.kept, KeptState)
            state = action.kept.state
            seen = StateSeen(now_ns, self.name, module, False, state.data, version, state.round, answer.age_ns)
            self._state(seen)

    def _do(self, action: Action) -> ModuleEvent | None:
        if isinstance(action, PrepareTable):
            return self._prepared(action)
        if isinstance(action, SwitchTable):
            self._numbers.switch(action.table)
            self._switched(action.table)
            return None
        numbered = self._numbers.inward(action)
        answer = self._do_by_number(numbered)
        if isinstance(answer, StateEvent):
            self._tell_state(numbered, answer)
        return None if answer is None else self._numbers.outward(answer)

    def _prepared(self, action: PrepareTable) -> TablePrepared | None:
        """Read and prepare a table that has come beside the one that flies, as a node does (`table_preparing`)."""
        try:
            table = read_beside(action.text, self.core.table, action.number)
        except TableError as error:
            return TablePrepared(None, problem=str(error))
        if self._numbers.has(table):
            return None
        numbers, added = self._numbers.of(table)
        devices = {module.device for module in added if module.device is not None}
        self._open.add(table, added, dict.fromkeys(devices, self._plant))
        missing = self._host.add(added)
        self.steps.add(table, added)
        self._images |= {module.name: module.image for module in added}
        self._numbers.put_beside(table, numbers)
        return TablePrepared(table, missing)

    def _do_by_number(self, action: Action) -> ModuleEvent | None:
        if type(action) is StepModule:
            return self.steps.step(action)
        if type(action) is Drive:
            self._move(Moved(self._clock.now_ns, self.name, self.steps.names[action.module]))
            return self._host.carry_out(action, self.time.now_ns())
        if isinstance(action, WriteProgram | KeepParts | ControlProgram):
            if self._loader is not None:
                self._loader.order(action)
            return None
        if isinstance(action, MeasureStep):
            return self.steps.measure(action)
        if isinstance(action, Withdraw):
            self.outbox.withdraw(action)
            return None
        if isinstance(action, StandBack):
            self.outbox.stand_back(action)
            return None
        if isinstance(action, EndPartition):
            self.steps.end(action.partition)
        elif isinstance(action, StartModule):
            self.steps.started(action)
        return self._host.carry_out(action, self.time.now_ns())

    def _channels_lost(self, port: int, lost: frozenset[int]) -> None:
        self.give(ChannelsLost(port, lost))

    def _resume(self) -> None:
        unfinished, self._unfinished = self._unfinished, []
        self._carry_out(unfinished)

    def _caught_up(self) -> None:
        answers, self._answers = self._answers, []
        for answer in answers:
            self.give(answer)
