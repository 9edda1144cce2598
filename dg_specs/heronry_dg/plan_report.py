"""The report of a plan: how each function is served, and how much of each PE and each bus is used.

The report follows from the spec, the situation and the configuration. People and other programs read it. Each part is
computed once, when it is first read, because finding out why functions are not served may take longer than planning.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from heronry_dg.checkpoints import loads_mbit_per_s
from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import serving_modules, value_of
from heronry_dg.situation import Situation, Survivors, survivors
from heronry_dg.traffic import bus_loads_mbit_per_s, hops
from heronry_dg.why_not import Feasible, feasible, why_not, why_unwanted


@dataclass(frozen=True, slots=True)
class FunctionReport:
    """How a function is served, or why it is not."""

    served: bool
    mode: str | None  # mode of the module that serves it
    value: int  # value in that mode; 0 when not served
    why_not: str | None


@dataclass(frozen=True, slots=True)
class PeReport:
    """Used capacity of a PE: CPU in thousandths of a reference core, RAM and flash in bytes."""

    cpu_millis: int
    ram: int
    flash: int


@dataclass(frozen=True, slots=True)
class BusReport:
    """Bandwidth that data and checkpoints take on a bus, in bit/s (rounded down) and as a fraction of the bit rate."""

    bits_per_s: int
    load: float


@dataclass(frozen=True, slots=True)
class LevelReport:
    """A level of the objective: its value in a plan, and a bound on what is possible.

    Consider all legal configurations that have the plan's values at every more important level. None of them has a
    better value than `bound` at this level.
    """

    level: str
    value: int
    bound: int | None  # None: not known
    proven: bool  # value and bound are equal; compared before bits per second are rounded for this report


class Report:
    """The report of one configuration in one situation; each part is computed when it is first read."""

    def __init__(
        self, spec: Spec, now: Situation, configuration: Configuration, reasons: Mapping[str, str] | None = None
    ) -> None:
        """Begin a report; every name in the configuration must exist in the spec.

        reasons: by function, why it is not served, if the planner knows this better than `why_not`. For any other
            function that is not served, the report finds the reason itself.
        """
        self._spec, self._now, self._configuration, self._reasons = spec, now, configuration, reasons or {}

    def with_reasons(self, reasons: Mapping[str, str]) -> "Report":
        """Return a copy of the report with other reasons why functions are not served.

        reasons: by function, the reason why it is not served.
        """
        return Report(self._spec, self._now, self._configuration, reasons)

    def work_out(self) -> None:
        """Compute all parts now, and not when they are first read."""
        _ = self.functions, self.pes, self.buses

    @cached_property
    def _left(self) -> Survivors:
        return survivors(self._spec, self._now)

    @cached_property
    def functions(self) -> Mapping[str, FunctionReport]:
        """How each function is served, or why it is not, in the spec's order."""
        found: Feasible | None = None
        reports = {}
        for function, output in serving_modules(self._spec, self._configuration):
            if output is None:
                reason = self._reasons.get(function.name) or why_unwanted(self._now, function)
                if not reason:  # what could run is worked out only where it is needed, since that takes milliseconds
                    found = found or feasible(self._spec, self._now, self._left)
                    reason = why_not(found, function)
                reports[function.name] = FunctionReport(served=False, mode=None, value=0, why_not=reason)
            else:
                value = value_of(self._spec, self._configuration, function, output)
                mode = self._configuration.modules[output].mode
                reports[function.name] = FunctionReport(served=True, mode=mode, value=value, why_not=None)
        return reports

    @cached_property
    def pes(self) -> Mapping[str, PeReport]:
        """CPU, RAM and flash used on each PE."""
        return {name: self._pe(name) for name in self._spec.pes}

    def _pe(self, pe: str) -> PeReport:
        spec, configuration = self._spec, self._configuration
        here = [module for module, running in configuration.modules.items() if running.pe == pe]
        return PeReport(
            cpu_millis=sum(configuration.mode(spec, module).cpu_millis for module in here),
            ram=sum(configuration.mode(spec, module).ram for module in here),
            flash=sum(spec.modules[module].flash for module in here),
        )

    @cached_property
    def buses(self) -> Mapping[str, BusReport]:
        """Bandwidth used on each bus, by data and checkpoints."""
        loads = bus_loads_mbit_per_s(self._spec, hops(self._left, self._configuration))
        for bus, load in loads_mbit_per_s(self._left, self._configuration).items():
            loads[bus] += load
        return {
            bus: BusReport(bits_per_s=load // 1000, load=load / (1000 * self._spec.buses[bus].bitrate))
            for bus, load in loads.items()
        }
