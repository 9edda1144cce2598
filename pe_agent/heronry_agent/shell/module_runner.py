"""Makes the object of each module, calls its steps, keeps the object while the mode changes, and drops the object.

This code runs modules both in a partition of a node and in the process of the simulator. It uses no bus, no table and
no other process, and turns an exception of a module into a `Failure`. A module is

    built    by `start`, from its image; a module with a checkpoint then goes on from its state (`module_states`). If
             the module was kept, `start` first calls its `mode_changed`. If this returns True, the module is not built,
             but continues with its present object
    stepped  by `step`. Its outputs, writes, reports and requests are returned as one Result; only their form is checked
    kept     by `stop(keep=True)`. A kept module is not stepped until `start` continues it
    dropped  by `stop`, whether the module runs or is kept

A second `start` of a module that runs builds it anew.

A failure names the exception, its message, a file and a line. If the traceback has a frame in the module's own file,
the failure names the line of this frame, even if a library raised the exception: the author of the module needs the
place where the library was called.
"""

import sys
import traceback
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import NamedTuple

from heronry_agent.core.vocabulary import (
    Failure,
    KeptState,
    StateLacking,
    StateRestored,
    StateSaved,
    StateUnused,
)
from heronry_agent.module import DISAGREEMENT, Datum, Module, Value
from heronry_agent.shell.image_catalogues import UnknownImageError, find_image
from heronry_agent.shell.module_states import Limit, ModuleStates
from heronry_agent.shell.reading_watch import ReadingWatch
from heronry_wire.checkpoint_frames import Lack
from heronry_wire.management import MOST_PRIORITY, SPECS_PRIORITY

_MOST_DETAIL = 0xFFFF
_LONGEST_MESSAGE = 140  # characters of an exception's message, so that its place fits behind it
_HERE = (__file__, find_image.__code__.co_filename)


class Orders(NamedTuple):
    """What is needed to build a module: its name, image, mode, period in ns, and the name of its device, if any.

    needed: variables that the mode needs. known: those that any mode needs.
    """

    name: str
    image: str
    mode: str
    period_ns: int
    device: str | None
    needed: tuple[str, ...] = ()
    known: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Result:
    """What one step of a module has given: outputs, commands to its device, reports, and requests to the manager."""

    outputs: Mapping[str, Value]  # by variable
    writes: tuple[Value, ...] = ()  # commands to the module's device
    reports: tuple[tuple[str, int], ...] = ()  # (element, detail)
    phases: tuple[str, ...] = ()  # requested phases
    priorities: tuple[tuple[str, int], ...] = ()  # requests: (function, priority)
    misspelt: tuple[tuple[str, str], ...] = ()  # (name that was read, input that was probably meant)


@dataclass(slots=True)
class _Context:
    """The `heronry_agent.module.Context` of one module; collects what the module commands, reports and requests."""

    clock: Callable[[], int]
    module: str
    mode: str
    period_ns: int
    now_ns: int
    device: str | None
    reads: ReadingWatch
    until_ns: int = 0
    reading: Value | None = None
    writes: list[Value] = field(default_factory=list)
    reports: list[tuple[str, int]] = field(default_factory=list)
    phases: list[str] = field(default_factory=list)
    priorities: list[tuple[str, int]] = field(default_factory=list)

    def read(self) -> Value | None:
        self._require_device()
        return self.reading

    def write(self, value: Value) -> None:
        self._require_device()
        self.writes.append(value)

    def may_drive(self) -> bool:
        return self.clock() <= self.until_ns

    def report_failed(self, element: str, detail: int = 0) -> None:
        self.reports.append((str(element), min(max(int(detail), 0), _MOST_DETAIL)))

    def report_disagreement(self, detail: int = 0) -> None:
        self.report_failed(DISAGREEMENT, detail)

    def request_phase(self, phase: str) -> None:
        self.phases.append(str(phase))

    def request_priority(self, function: str, priority: int | None) -> None:
        wanted = SPECS_PRIORITY if priority is None else min(max(int(priority), 0), MOST_PRIORITY)
        self.priorities.append((str(function), wanted))

    def forget(self) -> None:
        self.writes, self.reports, self.phases, self.priorities = [], [], [], []

    def _require_device(self) -> None:
        if self.device is None:
            raise RuntimeError(f"module {self.module} has no device: give it one in the spec")


class ModuleRunner:
    """Builds and steps the modules of one process."""

    def __init__(
        self,
        clock: Callable[[], int],
        within: Limit = nullcontext,
        find: Callable[[str], type[Module]] = find_image,
    ) -> None:
        """Begin without modules.

        clock: returns the present time in ns; it is called while modules compute.
        within: limits the time of `save` and `restore` of a module.
        find: returns the class of an image, or raises an exception if there is none.
        """
        self._clock, self._find = clock, find
        self._states = ModuleStates(within, lambda code, error: failure_of(error, _file_of(type(code))).reason)
        self._classes: dict[str, type[Module]] = {}
        self._running: dict[int, tuple[Module, _Context, str]] = {}
        self._kept: dict[int, tuple[Module, _Context, str]] = {}

    def load(self, image: str) -> Failure | None:
        """Import the code of an image; returns None, or how the import has failed."""
        if image in self._classes:
            return None
        try:
            self._classes[image] = self._find(image)
        except Exception as error:  # noqa: BLE001 - foreign code: after any exception the image is missing
            failure = failure_of(error)
            return Failure(f"the code cannot be imported: {failure.reason}", failure.traceback)
        return None

    def start(
        self, module: int, orders: Orders, now_ns: int, state: KeptState | Lack | None = None
    ) -> Failure | StateRestored | StateLacking | StateUnused | None:
        """Start a module: continue the object that `stop` has kept, or build a new object.

        The kept object continues in the new mode if the image is the same and its `mode_changed` allows this.
        state: the state from which a new object goes on, or why there is none; None: the module has no checkpoint.

        Returns None, or how importing the image or building the module has failed. If `state` is given, returns
        whether the module goes on from the state, if not why, or that it needs none.
        """
        held = self._kept.pop(module, None)
        if held is not None and held[2] == orders.image and self._carried_over(module, held, orders, now_ns):
            return None if state is None else StateUnused(module)
        self._running.pop(module, None)
        missing = self.load(orders.image)
        if missing is not None:
            return missing
        reads = ReadingWatch(orders.needed, orders.known)
        context = _Context(self._clock, orders.name, orders.mode, orders.period_ns, now_ns, orders.device, reads)
        failure = self._build(module, context, orders.image)
        if failure is not None or state is None:
            return failure
        outcome = self._states.restore(module, self._running[module][0], state, now_ns)
        if isinstance(outcome, StateLacking) and outcome.lack is Lack.REFUSED:
            return self._build(module, context, orders.image) or outcome
        return outcome

    def save(self, module: int, round_number: int, most_bytes: int) -> StateSaved | StateLacking | None:
        """Save the state of a module, at most `most_bytes` bytes; None: the module does not run.

        round_number: is repeated in the result.
        """
        held = self._running.get(module)
        if held is None:
            return None
        return self._states.save(module, held[0], round_number, most_bytes, self._clock())

    def _build(self, module: int, context: "_Context", image: str) -> Failure | None:
        """Make a new object of a module; returns None, or how this has failed."""
        self._running.pop(module, None)
        try:
            self._running[module] = (self._classes[image](context), context, image)
        except Exception as error:  # noqa: BLE001 - a module's constructor may raise anything
            return failure_of(error, _file_of(self._classes[image]))
        return None

    def stop(self, module: int, *, keep: bool = False) -> None:
        """Stop a module. Its object is dropped or, with `keep`, put aside, so that the next `start` can continue it."""
        self._kept.pop(module, None)
        held = self._running.pop(module, None)
        if keep and held is not None:
            self._kept[module] = held

    def code(self, module: int) -> Module | None:
        """Return the object of a module; None if the module does not run. The caller must not change the object."""
        held = self._running.get(module)
        return None if held is None else held[0]

    def step(
        self, module: int, now_ns: int, until_ns: int, reading: Value | None, inputs: Mapping[str, tuple[str, Datum]]
    ) -> Result | Failure:
        """Call the step of a module; returns its result, or how it failed.

        until_ns: time until which `Context.may_drive` returns True. reading: the reading of the module's device; None
        if there is none. inputs: for each leaf with a fresh datum, the variable and the datum.
        """
        held = self._running.get(module)
        if held is None:
            return Failure("the module was never built")
        code, context, _ = held
        context.now_ns, context.until_ns, context.reading = now_ns, until_ns, reading
        context.forget()
        try:
            outputs: object = code.step(context.reads.inputs(inputs))
        except Exception as error:  # noqa: BLE001 - a module's step may raise anything
            context.forget()  # what it has collected may hold the memory that ran out
            return failure_of(error, _file_of(type(code)))
        if not isinstance(outputs, dict | Mapping):  # a dict, the usual case, is recognized quickly
            return Failure(f"the module's step gave {type(outputs).__name__}, not a mapping")
        said = tuple(context.reports), tuple(context.phases), tuple(context.priorities)
        return Result(dict(outputs), tuple(context.writes), *said, context.reads.stepped())

    def _carried_over(self, module: int, held: tuple[Module, _Context, str], orders: Orders, now_ns: int) -> bool:
        """Call `mode_changed` of a module that `stop` has kept; tells whether its object continues in the new mode."""
        code, context, _ = held
        context.mode, context.period_ns, context.now_ns = orders.mode, orders.period_ns, now_ns
        context.reads = ReadingWatch(orders.needed, orders.known)
        try:
            goes_on = code.mode_changed()
        except Exception:  # noqa: BLE001 - foreign code: a module that fails here is built anew
            goes_on = False
        if goes_on:
            self._running[module] = held
        return bool(goes_on)


def one_line(error: BaseException) -> str:
    """Describe an exception by its type and the first line of its message."""
    words = str(error).strip().splitlines()
    return f"{type(error).__name__}: {words[0]}" if words else type(error).__name__


def failure_of(error: Exception, file: str | None = None) -> Failure:
    """Describe an exception of a module or driver; `file`: the file with the code of the module or driver, if known."""
    try:
        line = str(error) if isinstance(error, UnknownImageError) else one_line(error)
        if len(line) > _LONGEST_MESSAGE:
            line = f"{line[:_LONGEST_MESSAGE]}..."
        place = None if isinstance(error, SyntaxError) else _place(error, file)  # a SyntaxError names its place itself
        return Failure(line if place is None else f"{line} ({place})", _traceback(error))
    except Exception:  # noqa: BLE001 - its __str__ may raise anything, and there may be no memory left
        return Failure(type(error).__name__)


def _place(error: BaseException, file: str | None) -> str | None:
    """Return "FILE:LINE" of the innermost stack frame of an exception that belongs to `file`.

    If no stack frame belongs to `file`, the innermost one outside heronry counts. Returns None if there is none
    outside heronry.
    """
    if isinstance(error, UnknownImageError) and error.__cause__ is not None:
        error = error.__cause__
    frames = [(frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    foreign = [one for one in frames if is_foreign(one[0])]
    own = [one for one in foreign if one[0] == file] or foreign
    return f"{own[-1][0].rpartition('/')[2]}:{own[-1][1]}" if own else None


def _traceback(error: Exception) -> str:
    """Format an exception with its traceback, without the stack frames of heronry and of Python's import."""
    told: traceback.TracebackException | None = traceback.TracebackException.from_exception(error)
    whole = told
    while told is not None:
        told.stack[:] = [frame for frame in told.stack if is_foreign(frame.filename)]
        told = told.__cause__ or told.__context__
    return "" if whole is None else "".join(whole.format())


def is_foreign(file: str) -> bool:
    """Tell whether a stack frame in this file belongs to a module or library, not to the code that calls modules."""
    return file not in _HERE and not file.startswith("<frozen ") and not file.endswith("/importlib/__init__.py")


def _file_of(code: type) -> str | None:
    return getattr(sys.modules.get(code.__module__), "__file__", None)
