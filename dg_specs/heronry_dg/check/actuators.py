"""The check of DG248: functions that are wanted at once, and need different drivers of one actuator.

A function *needs* a driver if it cannot be served without it, even with everything up and unlimited resources
(`DemuxPaths`). Of two drivers of one actuator only one runs (semantics rule 10), so one of the functions is not served.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

from heronry_dg.check.subject import Subject
from heronry_dg.demux_paths import DemuxPaths
from heronry_dg.findings import Findings, listed
from heronry_dg.model import Function, Spec
from heronry_dg.rules import functions as rules


@dataclass(frozen=True, slots=True)
class DriverConflict:
    """Two functions that need different drivers of one actuator.

    phases: the phases that want both functions; None stands for the only one of a spec without phases.
    """

    actuator: str
    functions: tuple[str, str]
    drivers: tuple[str, str]
    phases: tuple[str | None, ...]


def check_actuators(subject: Subject, findings: Findings) -> None:
    """Add a finding for each pair of functions that need different drivers of one actuator in the same phase."""
    for conflict in driver_conflicts(subject.spec):
        one, other = conflict.functions
        when = f" in {listed(map(str, conflict.phases))}" if subject.spec.phases else ""
        sentence = f"functions '{one}' and '{other}' need different drivers of actuator '{conflict.actuator}'{when}"
        sentence = f"{sentence}: {' and '.join(conflict.drivers)}, of which only one runs"
        hint = "let one module drive the actuator for both, or want one of the functions at a time"
        findings.add(rules.TWO_DRIVERS, subject.place("functions", other), sentence, hint)


def driver_conflicts(spec: Spec) -> Iterator[DriverConflict]:
    """Yield each pair of functions, in the spec's order, that need different drivers of one actuator at once."""
    shared = spec.drivers_of_one_actuator()
    if not shared:
        return
    paths, phases = DemuxPaths(spec), tuple(spec.phases) or (None,)
    for actuator, drivers in shared.items():
        needed = [(f, d) for f in spec.functions.values() for d in drivers if _needs(paths, f, d)]
        for (one, its), (other, others) in combinations(needed, 2):
            at = tuple(phase for phase in phases if one.priority_in(phase) and other.priority_in(phase))
            if at and its != others and one is not other:
                yield DriverConflict(actuator, (one.name, other.name), (its, others), at)


def _needs(paths: DemuxPaths, function: Function, driver: str) -> bool:
    """Tell whether a function that could be served cannot be served without a driver."""
    can = any(paths.can_run(output) for output in function.outputs)
    return can and not any(paths.can_run(output, without=(driver,)) for output in function.outputs)
