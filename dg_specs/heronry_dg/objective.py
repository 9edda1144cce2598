"""The objective: how good a configuration is, on seven levels. The first level that differs decides.

The levels (docs/semantics.md, section 4): critical functions (by class A to D), utility, supplied inputs, few changes
to what runs, primary branches, little bandwidth, little CPU. All values are integers, so that any two programs agree on
every comparison. `score` does not check whether a configuration is legal (`verify` does), but every name in it must
exist in the spec.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from heronry_dg.configuration import Configuration
from heronry_dg.model import Function, Spec
from heronry_dg.situation import Situation, Survivors, survivors
from heronry_dg.traffic import bus_loads_mbit_per_s, hops

CRITICAL_CLASSES = ("A", "B", "C", "D")

Placement = Mapping[str, tuple[str, str]]
"""What runs, without its wires: module -> (mode, PE)."""


@dataclass(frozen=True, slots=True)
class Objective:
    """The value of a configuration on the seven levels, most important first.

    The comment behind each level says whether more or fewer is better.
    """

    critical: tuple[int, int, int, int]  # sum of the priorities of served functions of class A, B, C, D: more
    utility: int  # sum of priority times value of served functions: more
    inputs: int  # sum of the worth of wired leaves: more
    changes: int  # modules whose (mode, PE) differs from the running ones: fewer
    branches: int  # sum of the positions of the ends that run, in their DEMUXes: fewer
    bus_mbit_per_s: int  # thousandths of a bit/s over all buses: fewer
    cpu_millis: int  # thousandths of a reference core: fewer

    def key(self) -> tuple[int, ...]:
        """Ten integers (level 1 has four, for the classes A to D); of two keys, the greater one is better."""
        costs = (self.changes, self.branches, self.bus_mbit_per_s, self.cpu_millis)
        return (*self.critical, self.utility, self.inputs, *(-cost for cost in costs))

    @classmethod
    def of_key(cls, key: Sequence[int]) -> Self:
        """Return the objective that has this key; raises ValueError where the key is not ten integers."""
        a, b, c, d, utility, inputs, *costs = key
        changes, branches, bus_mbit_per_s, cpu_millis = (-cost for cost in costs)
        return cls((a, b, c, d), utility, inputs, changes, branches, bus_mbit_per_s, cpu_millis)

    @property
    def bus_bits_per_s(self) -> int:
        """Published bits per second over all buses; the sum is rounded down, as in reports."""
        return self.bus_mbit_per_s // 1000


def score(
    spec: Spec, now: Situation, configuration: Configuration, running: Configuration | Placement | None
) -> Objective:
    """Compute the objective of a configuration in a situation.

    running: the running configuration, against which changes are counted; without it no change is counted.
    """
    return score_among(survivors(spec, now), now, configuration, running)


def score_among(
    left: Survivors, now: Situation, configuration: Configuration, running: Configuration | Placement | None
) -> Objective:
    """Compute the objective as `score` does, from survivors that are already computed."""
    spec = left.spec
    served = [(function, branch) for function, branch in serving_modules(spec, configuration) if branch is not None]
    published = hops(left, configuration)
    return Objective(
        critical=_critical(now, [function for function, _ in served]),
        utility=sum(now.priority_of(f) * value_of(spec, configuration, f, branch) for f, branch in served),
        inputs=sum(_worths(spec, configuration)),
        changes=changes(placement(configuration), running),
        branches=sum(
            position
            for demux in spec.demuxes.values()
            for position, end in enumerate(demux.ends)
            if end in configuration.modules
        ),
        bus_mbit_per_s=sum(bus_loads_mbit_per_s(spec, published).values()),
        cpu_millis=sum(configuration.mode(spec, module).cpu_millis for module in configuration.modules),
    )


def serving_modules(spec: Spec, configuration: Configuration) -> Iterator[tuple[Function, str | None]]:
    """Yield every function with the running module that serves it; None: it is not served."""
    for function in spec.functions.values():
        yield function, next((m for m in function.outputs if m in configuration.modules), None)


def value_of(spec: Spec, configuration: Configuration, function: Function, output: str) -> int:
    """Value of a function that the running module `output` serves in its present mode."""
    module = spec.modules[output]
    return function.value_of(module.mode_index(configuration.modules[output].mode), len(module.modes))


def placement(running: Configuration | Placement) -> Placement:
    """Return mode and PE of each running module."""
    if isinstance(running, Configuration):
        return {name: (module.mode, module.pe) for name, module in running.modules.items()}
    return running


def changes(after: Placement, running: Configuration | Placement | None) -> int:
    """Count the modules of `running` and `after` that are started, stopped, moved or put into another mode."""
    if running is None:
        return 0
    before = placement(running)
    return sum(before.get(module) != after.get(module) for module in before.keys() | after.keys())


def _critical(now: Situation, served: list[Function]) -> tuple[int, int, int, int]:
    totals = dict.fromkeys(CRITICAL_CLASSES, 0)
    for function in served:
        criticality = function.criticality_in(now.phase)
        if criticality in totals:
            totals[criticality] += now.priority_of(function)
    return totals["A"], totals["B"], totals["C"], totals["D"]


def _worths(spec: Spec, configuration: Configuration) -> Iterator[int]:
    for module in configuration.modules:
        leaves = dict(configuration.mode(spec, module).leaves())
        for path, wire in configuration.modules[module].inputs.items():
            yield leaves[path].points(wire.version)
