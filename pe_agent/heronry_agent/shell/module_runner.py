"""Builds modules as objects, steps them, carries them over into another mode, and drops them.

The same code runs modules in a partition of a node and in the process of the simulator. It uses no bus, no table and no
other process, and turns an exception of a module into a `Failure`. A module is

    built    by `start`, from its image. If the module was kept, `mode_changed` is called first, and the module goes on
             as it is if that returns True
    stepped  by `step`: its outputs, writes, reports and requests are returned as one Result; only their form is checked
    kept     by `stop(keep=True)`: not stepped, until `start` continues it or `stop` drops it

A second `start` of a module that runs builds it anew.

A failure names the exception, its message, and file and line. If the traceback has a frame in the module's own file,
the line is that of this frame: when a library raises an exception, the author first looks for the call of the library.
"""

import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from heronry_agent.core.vocabulary import Failure
from heronry_agent.module import DISAGREEMENT, Datum, Inputs, Module, Value
from heronry_agent.shell.image_catalogues import UnknownImageError, find_image
from heronry_wire.management import MOST_PRIORITY, SPECS_PRIORITY

_MOST_DETAIL = 0xFFFF
_LONGEST_MESSAGE = 140  # characters of an exception's message, so that its place fits behind it
_HERE = (__file__, find_image.__code__.co_filename)


class Orders(NamedTuple):
    """Name, image, mode and period (ns) with which a module is to run, and whether it has a device."""

    name: str
    image: str
    mode: str
    period_ns: int
    has_device: bool


@dataclass(frozen=True, slots=True)
class Result:
    """Result of one step of a module."""

    outputs: Mapping[str, Value]
    writes: tuple[Value, ...] = ()
    reports: tuple[tuple[str, int], ...] = ()
    phases: tuple[str, ...] = ()
    priorities: tuple[tuple[str, int], ...] = ()


@dataclass(slots=True)
class _Context:
    """The host interface of one module (`module.Context`)."""

    clock: Callable[[], int]
    module: str
    mode: str
    period_ns: int
    now_ns: int
    has_device: bool
    until_ns: int = 0
    reading: Value | None = None
    writes: list[Value] = field(default_factory=list)
    reports: list[tuple[str, int]] = field(default_factory=list)
    phases: list[str] = field(default_factory=list)
    priorities: list[tuple[str, int]] = field(default_factory=list)

    def read(self) -> Value | None:
        """Reading of the device when this step began; None when the device did not answer."""
        self._require_device()
        return self.reading

    def write(self, value: Value) -> None:
        """Command the device when this step has ended."""
        self._require_device()
        self.writes.append(value)

    def may_drive(self) -> bool:
        """Tell whether outputs may be set now."""
        return self.clock() <= self.until_ns

    def report_failed(self, element: str, detail: int = 0) -> None:
        """Report to the manager that an element has failed."""
        self.reports.append((str(element), min(max(int(detail), 0), _MOST_DETAIL)))

    def report_disagreement(self, detail: int = 0) -> None:
        """Tell the manager that two inputs differ."""
        self.report_failed(DISAGREEMENT, detail)

    def request_phase(self, phase: str) -> None:
        """Request a mission phase from the manager."""
        self.phases.append(str(phase))

    def request_priority(self, function: str, priority: int | None) -> None:
        """Request another priority of a function from the manager; None: that of the spec."""
        wanted = SPECS_PRIORITY if priority is None else min(max(int(priority), 0), MOST_PRIORITY)
        self.priorities.append((str(function), wanted))

    def forget(self) -> None:
        """Drop all commands, reports and requests of the last step."""
        self.writes, self.reports, self.phases, self.priorities = [], [], [], []

    def _require_device(self) -> None:
        if not self.has_device:
            raise RuntimeError(f"module {self.module} is bolted to no device: give it one in the spec")


class ModuleRunner:
    """Builds and steps the modules of one process."""

    def __init__(self, clock: Callable[[], int]) -> None:
        """clock: gives the present time in ns, also while a module computes."""
        self._clock = clock
        self._classes: dict[str, type[Module]] = {}
        self._running: dict[int, tuple[Module, _Context, str]] = {}
        self._kept: dict[int, tuple[Module, _Context, str]] = {}

    def load(self, image: str) -> Failure | None:
        """Import the code of an image; gives None, or the failure."""
        if image in self._classes:
            return None
        try:
            self._classes[image] = find_image(image)
        except Exception as error:  # noqa: BLE001 - foreign code: after any exception the image is missing
            failure = failure_of(error)
            return Failure(f"the code cannot be imported: {failure.reason}", failure.traceback)
        return None

    def start(self, module: int, orders: Orders, now_ns: int) -> Failure | None:
        """Build a module, or carry it over; gives None, or the failure."""
        held = self._kept.pop(module, None)
        if held is not None and held[2] == orders.image and self._carried_over(module, held, orders, now_ns):
            return None
        self._running.pop(module, None)
        missing = self.load(orders.image)
        if missing is not None:
            return missing
        context = _Context(self._clock, orders.name, orders.mode, orders.period_ns, now_ns, orders.has_device)
        try:
            self._running[module] = (self._classes[orders.image](context), context, orders.image)
        except Exception as error:  # noqa: BLE001 - a module's constructor may raise anything
            return failure_of(error, _file_of(self._classes[orders.image]))
        return None

    def stop(self, module: int, *, keep: bool = False) -> None:
        """Drop a module, or keep it for the next `start`; no effect if it does not exist."""
        self._kept.pop(module, None)
        held = self._running.pop(module, None)
        if keep and held is not None:
            self._kept[module] = held

    def code(self, module: int) -> Module | None:
        """Give the object of a module that runs, for an observer that does not change it."""
        held = self._running.get(module)
        return None if held is None else held[0]

    def step(
        self, module: int, now_ns: int, until_ns: int, reading: Value | None, inputs: Mapping[str, tuple[str, Datum]]
    ) -> Result | Failure:
        """Let a module compute one period; gives the result, or the failure."""
        held = self._running.get(module)
        if held is None:
            return Failure("the module was never built")
        code, context, _ = held
        context.now_ns, context.until_ns, context.reading = now_ns, until_ns, reading
        context.forget()
        try:
            outputs: object = code.step(Inputs(inputs))
        except Exception as error:  # noqa: BLE001 - a module's step may raise anything
            context.forget()  # what it has collected may hold the memory that ran out
            return failure_of(error, _file_of(type(code)))
        if not isinstance(outputs, dict | Mapping):  # a dict, the usual case, is recognized quickly
            return Failure(f"the module's step gave {type(outputs).__name__}, not a mapping")
        said = tuple(context.reports), tuple(context.phases), tuple(context.priorities)
        return Result(dict(outputs), tuple(context.writes), *said)

    def _carried_over(self, module: int, held: tuple[Module, _Context, str], orders: Orders, now_ns: int) -> bool:
        """Carry a kept module over into its new mode, and tell whether it goes on there."""
        code, context, _ = held
        context.mode, context.period_ns, context.now_ns = orders.mode, orders.period_ns, now_ns
        try:
            goes_on = code.mode_changed()
        except Exception:  # noqa: BLE001 - foreign code: a module that fails here is built anew
            goes_on = False
        if goes_on:
            self._running[module] = held
        return bool(goes_on)


def one_line(error: BaseException) -> str:
    """Name and first line of an exception."""
    words = str(error).strip().splitlines()
    return f"{type(error).__name__}: {words[0]}" if words else type(error).__name__


def failure_of(error: Exception, file: str | None = None) -> Failure:
    """Describe an exception of a module or driver; `file` is the file of the module's class, if that is known."""
    try:
        line = str(error) if isinstance(error, UnknownImageError) else one_line(error)
        if len(line) > _LONGEST_MESSAGE:
            line = f"{line[:_LONGEST_MESSAGE]}..."
        place = None if isinstance(error, SyntaxError) else _place(error, file)  # a SyntaxError names its place itself
        return Failure(line if place is None else f"{line} ({place})", _traceback(error))
    except Exception:  # noqa: BLE001 - its __str__ may raise anything, and there may be no memory left
        return Failure(type(error).__name__)


def _place(error: BaseException, file: str | None) -> str | None:
    """Give file and line of the innermost frame in the module's own file, or else outside heronry."""
    if isinstance(error, UnknownImageError) and error.__cause__ is not None:
        error = error.__cause__
    frames = [(frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    foreign = [one for one in frames if is_foreign(one[0])]
    own = [one for one in foreign if one[0] == file] or foreign
    return f"{own[-1][0].rpartition('/')[2]}:{own[-1][1]}" if own else None


def _traceback(error: Exception) -> str:
    """Format an exception without the frames from which the module was called or imported, which are not its own."""
    told: traceback.TracebackException | None = traceback.TracebackException.from_exception(error)
    whole = told
    while told is not None:
        told.stack[:] = [frame for frame in told.stack if is_foreign(frame.filename)]
        told = told.__cause__ or told.__context__
    return "" if whole is None else "".join(whole.format())


def is_foreign(file: str) -> bool:
    """Tell whether a frame of this file belongs to the code that was imported or called."""
    return file not in _HERE and not file.startswith("<frozen ") and not file.endswith("/importlib/__init__.py")


def _file_of(code: type) -> str | None:
    return getattr(sys.modules.get(code.__module__), "__file__", None)
