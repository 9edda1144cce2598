"""The execution time of modules in a simulated PE: zero, unless there is a fault in a module or in the processor.

The faults:

    broken   a module raises an error, gives nothing, gives a value that is wrong or outside its type's range, overruns,
             or requests a phase
    stuck    the steps of all modules of the PE hang
    slow     the processor of the PE is slow

An overrun is reported to the core as time spent. The time of a slow processor, of a pause or of a jump of the clock is
not reported, as on a real node. While a step is late, further steps of its partition wait. If a step must wait beyond
the time limit that the core has set for it (`until_ns`), it is not executed, as in a real partition.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from random import Random
from typing import Protocol

from heronry_agent.core.vocabulary import (
    Action,
    MeasureStep,
    ModuleEvent,
    StartModule,
    StepFailed,
    StepMeasured,
    StepModule,
    Stepped,
)
from heronry_agent.module import Value
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.module_host import ModuleHost
from heronry_tools.sim.world.steps_seen import Driven, Withheld
from heronry_wire.pe_table import ModuleEntry, PeTable

OVERRUN_NS = 30_000_000
SILENT = "silent "  # in `broken`: the module leaves out the output whose number, from 1, follows; 0: all of them
ASKS = "asks "  # in `broken`: the module requests the phase whose name follows

_LOOKED_AT_EVERY = 8
_SLOWEST_NS = 8_000_000
_WRONG_BY = 40.0


class Processor(Protocol):
    """The processor on which the modules of a PE run."""

    @property
    def is_awake(self) -> bool:
        """Tell whether the processor is not paused."""

    def pause(self, duration_ns: int) -> None:
        """Pause the processor for `duration_ns` from now on."""

    def answer(self, answer: ModuleEvent) -> None:
        """Give the core of the PE the late answer of a module."""

    def put_off_steps(self, steps: Sequence[StepModule]) -> None:
        """Execute these steps when the pause of the processor ends."""


class ModuleSteps:
    """Executes the steps of the modules of one PE, and makes these steps fail, hang or run late as faults demand."""

    def __init__(
        self,
        clock: Clock,
        time: LocalClock,
        table: PeTable,
        host: ModuleHost,
        processor: Processor,
        *,
        drive: Callable[[Driven], None],
        look: Callable[[Driven], None],
        withheld: Callable[[Withheld], None],
        broken: Mapping[str, str],
        broke: Callable[[str], None],
        stepped: Callable[[str], None] | None = None,
    ) -> None:
        """Begin with modules that run on time: no step hangs, and the processor is not slow.

        drive: is called with every step of a module that drives an actuator, or is a branch of a DEMUX.
        look: is called with every eighth of the other steps that have inputs, so that oracles see some of them.
        withheld: is called with every step that leaves out an output of its module's mode.
        broken: how a module fails in its steps, or which phase it requests (ASKS and the phase); by the name of
            the module or, for one PE, by NAME@PE.
        broke: is called with the name of a module that has raised an error, or given a value outside the range of
            its type.
        stepped: is called with the name of a module at each of its steps; None: nobody asks.
        """
        self._stepped = stepped
        self._clock, self._time, self._host, self._processor = clock, time, host, processor
        self._drive, self._look, self._withheld = drive, look, withheld
        self._gives: dict[int, Collection[str]] = {}  # by running module: the outputs of its mode
        self._broken, self._broke = broken, broke
        self._pe = table.name
        self.names: dict[int, str] = {}
        self._drivers: dict[int, str] = {}
        self._partitions: dict[int, str] = {}
        self.add(table, table.modules)
        self._others = 0  # count of steps of modules that drive nothing
        self.stuck = False  # steps do not end
        self.slow: Random | None = None  # draws how long a step takes
        self._hung: dict[int, tuple[StepModule, int]] = {}  # by module: its step that hangs, and when that began
        self._behind: dict[str, list[StepModule]] = {}  # by late partition: steps that wait
        self._requested_ns: dict[int, int] = {}  # by release of a step that waits: when it was requested

    def add(self, table: PeTable, modules: Collection[ModuleEntry]) -> None:
        """Execute steps of more modules of a table, which have the numbers by which actions will name them."""
        actuators = {device.name for device in table.devices if device.kind == "actuator"}
        self.names |= {module.index: module.name for module in modules}
        self._drivers |= {m.index: m.name for m in modules if m.demux or m.device in actuators}
        self._partitions |= {module.index: module.partition for module in modules}

    def step(self, action: StepModule) -> ModuleEvent | None:
        """Execute a step of a module, with the faults of this PE; return the event that answers the step.

        Returns None if this event comes later or never.
        """
        behind = self._behind.get(self._partitions[action.module])
        if behind is not None:
            behind.append(action)
            self._requested_ns.setdefault(action.release, self._clock.now_ns)
            return None
        now_ns = self._clock.now_ns
        requested_ns = self._requested_ns.pop(action.release, now_ns)
        if requested_ns != now_ns and self._time.now_ns() > action.until_ns:
            return Stepped(action.module, action.release, {})
        self._tell(action, now_ns, requested_ns)
        if self.stuck:
            self._hung[action.module] = (action, now_ns)
            return None
        how = self._broken_as(self.names[action.module]) if self._broken else None
        if how is not None:
            failed = self._fail(action, how)
            if type(failed) is Stepped:
                self._tell_withheld(action, failed)
            return failed
        answer = self._host.carry_out(action, self._time.now_ns())
        if type(answer) is Stepped and len(answer.outputs) < len(self._gives[action.module]):
            self._tell_withheld(action, answer)
        if self.slow is not None:
            self._processor.pause(self.slow.randrange(_SLOWEST_NS))
        return answer

    def _broken_as(self, module: str) -> str | None:
        """Return the fault of a module on this PE: how it fails, or which phase it requests; None: it has no fault."""
        return self._broken.get(f"{module}@{self._pe}", self._broken.get(module))

    def measure(self, action: MeasureStep) -> StepMeasured:
        """Return the time for which a step has been hanging.

        The time is 0 if the step does not hang, or if it waits for another hanging step of its partition.
        """
        partition = self._partitions[action.module]
        first = next((module for module in self._hung if self._partitions[module] == partition), None)
        spent_ns = self._clock.now_ns - self._hung[first][1] if first == action.module else 0
        return StepMeasured(action.module, action.release, spent_ns)

    def wait(self, actions: Sequence[Action]) -> None:
        """Record that the steps among these actions are requested now, but must wait for the processor."""
        for action in actions:
            if type(action) is StepModule:
                self._requested_ns.setdefault(action.release, self._clock.now_ns)

    def end(self, partition: str) -> None:
        """End a partition, and drop its steps that hang or wait."""
        self._hung = {m: step for m, step in self._hung.items() if self._partitions[m] != partition}
        self._behind.pop(partition, None)

    def unstick(self) -> None:
        """End the fault by which steps hang: complete the hanging steps, and give their answers to the PE's core."""
        self.stuck = False
        hung, self._hung = self._hung, {}
        for action, _ in hung.values():
            answer = self._host.carry_out(action, self._time.now_ns())
            assert answer is not None
            self._processor.answer(answer)

    def _tell(self, action: StepModule, now_ns: int, requested_ns: int) -> None:
        if self._stepped is not None:
            self._stepped(self.names[action.module])
        driver = self._drivers.get(action.module)
        if driver is not None:
            self._drive(Driven(now_ns, self._pe, driver, action.inputs, requested_ns))
        elif action.inputs:
            self._others += 1
            if self._others % _LOOKED_AT_EVERY == 0:
                self._look(Driven(now_ns, self._pe, self.names[action.module], action.inputs, requested_ns))

    def started(self, action: StartModule) -> None:
        """Note the mode in which a module is started."""
        self._gives[action.module] = action.entry.modes[action.mode].gives

    def _tell_withheld(self, action: StepModule, answer: Stepped) -> None:
        missing = frozenset(self._gives[action.module]).difference(answer.outputs)
        if missing:
            has = frozenset(variable for variable, datum in action.inputs.values() if datum.valid)
            self._withheld(Withheld(self._clock.now_ns, self._pe, self.names[action.module], missing, has))

    def _fail(self, action: StepModule, how: str) -> ModuleEvent | None:
        name = self.names[action.module]
        answer = self._host.carry_out(action, self._time.now_ns())
        if how == "overrun" and isinstance(answer, Stepped):
            late = answer._replace(spent_ns=OVERRUN_NS)
            behind = self._behind[self._partitions[action.module]] = []
            self._clock.at(self._clock.now_ns + OVERRUN_NS, partial(self._end_late, late, behind))
            return None
        if how == "unfit" and isinstance(answer, Stepped) and answer.outputs:
            self._broke(name)
            unfit = dict.fromkeys(answer.outputs, "what no such type can carry")
            return Stepped(action.module, action.release, unfit)
        if how.startswith(SILENT) and isinstance(answer, Stepped):
            return answer._replace(
                outputs=_without(answer.outputs, int(how.removeprefix(SILENT)), self._gives[action.module])
            )
        if how.startswith(ASKS) and isinstance(answer, Stepped):
            return answer._replace(phases=(how.removeprefix(ASKS),))
        if how == "raise":
            self._broke(name)
            return StepFailed(action.module, action.release, "the simulator makes this module fail")
        if how == "wrong" and isinstance(answer, Stepped):
            return Stepped(action.module, action.release, {name: _off(v) for name, v in answer.outputs.items()})
        return answer

    def _end_late(self, late: Stepped, behind: list[StepModule]) -> None:
        """Give the core the answer of a late step, then execute the steps that wait behind this step.

        The waiting steps are dropped if their partition has ended, and put off if the processor is paused.
        """
        self._processor.answer(late)
        partition = self._partitions[late.module]
        if self._behind.get(partition) is behind:
            del self._behind[partition]
            if not self._processor.is_awake:
                self._processor.put_off_steps(behind)
                return
            for action in behind:
                answer = self.step(action)
                if answer is not None:
                    self._processor.answer(answer)


def _without(outputs: Mapping[str, Value], number: int, of_mode: Collection[str]) -> Mapping[str, Value]:
    """Return the outputs of a step without the one with this number, from 1, in the mode; 0: none is left."""
    left_out = tuple(of_mode)[number - 1 : number] if number else tuple(of_mode)
    return {variable: value for variable, value in outputs.items() if variable not in left_out}


def _off(value: Value) -> Value:
    """Return a wrong number of the same type in place of an int or a float; return any other value as it is."""
    if isinstance(value, float):
        return value + _WRONG_BY
    return value ^ 1 if isinstance(value, int) else value
