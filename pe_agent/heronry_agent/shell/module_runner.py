"""Builds modules as objects, steps them, carries them over into another mode, and drops them.

The same code runs modules in a partition of a node and in the process of the simulator. It uses no bus, no table and no
other process, and turns an exception of a module into one line of text. A module is

    built    by `start`, from its image. If the module was kept, `mode_changed` is called first, and the module goes on
             as it is if that returns True
    stepped  by `step`: its outputs, writes, reports and requests are returned as one Result; only their form is checked
    kept     by `stop(keep=True)`: not stepped, until `start` continues it or `stop` drops it

A second `start` of a module that runs builds it anew.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from heronry_agent.module import Datum, Inputs, Module, Value
from heronry_agent.shell.image_catalogues import find_image

_MOST_DETAIL = 0xFFFF


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

    def request_phase(self, phase: str) -> None:
        """Request a mission phase from the manager."""
        self.phases.append(str(phase))

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

    def load(self, image: str) -> str | None:
        """Import the code of an image; gives None, or the reason if that fails."""
        if image in self._classes:
            return None
        try:
            self._classes[image] = find_image(image)
        except Exception as error:  # noqa: BLE001 - foreign code: after any exception the image is missing
            return one_line(error)
        return None

    def start(self, module: int, orders: Orders, now_ns: int) -> str | None:
        """Build a module, or carry it over; gives None, or the reason if it cannot be built."""
        held = self._kept.pop(module, None)
        if held is not None and held[2] == orders.image and self._carried_over(module, held, orders, now_ns):
            return None
        self._running.pop(module, None)
        reason = self.load(orders.image)
        if reason is not None:
            return reason
        context = _Context(self._clock, orders.name, orders.mode, orders.period_ns, now_ns, orders.has_device)
        try:
            self._running[module] = (self._classes[orders.image](context), context, orders.image)
        except Exception as error:  # noqa: BLE001 - a module's constructor may raise anything
            return one_line(error)
        return None

    def stop(self, module: int, *, keep: bool = False) -> None:
        """Drop a module, or keep it for the next `start`; no effect if it does not exist."""
        self._kept.pop(module, None)
        held = self._running.pop(module, None)
        if keep and held is not None:
            self._kept[module] = held

    def step(
        self, module: int, now_ns: int, until_ns: int, reading: Value | None, inputs: Mapping[str, tuple[str, Datum]]
    ) -> Result | str:
        """Let a module compute one period; gives the result, or the reason if the step failed."""
        held = self._running.get(module)
        if held is None:
            return "the module was never built"
        code, context, _ = held
        context.now_ns, context.until_ns, context.reading = now_ns, until_ns, reading
        context.writes, context.reports, context.phases = [], [], []
        try:
            outputs: object = code.step(Inputs(inputs))
        except Exception as error:  # noqa: BLE001 - a module's step may raise anything
            context.writes, context.reports, context.phases = [], [], []  # they may hold the memory that ran out
            return one_line(error)
        if not isinstance(outputs, dict | Mapping):  # a dict, the usual case, is recognized quickly
            return f"the module's step gave {type(outputs).__name__}, not a mapping"
        return Result(dict(outputs), tuple(context.writes), tuple(context.reports), tuple(context.phases))

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
