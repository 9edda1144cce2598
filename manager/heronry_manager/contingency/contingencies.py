"""The contingencies of a spec: a plan for every fault set up to a size, in several phases, and a safe mode per phase.

Equal configurations are kept once. They are numbered from 1, in this order; PEs hold them on board in the same order:

    1. the fault-free configuration of each phase
    2. the safe mode of each phase
    3. the configurations for single faults, phase by phase; then those for two faults, and so on
    4. the configurations for the places in use (`Scope.places`), phase by phase

Number 0 stands for no configuration. PREPARE has 12 bits for a number (docs/protocol.md), so it can refer to
configurations up to 4095. The same spec, scope and planner always give the same numbers.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import Objective
from heronry_manager.contingency.configuration_code import ConfigurationCode
from heronry_manager.planner.sweep import FaultSet, Outcome, Phase, Scope, places_in_use


@dataclass(frozen=True, slots=True)
class Made:
    """One plan made ahead.

    number: number of the configuration.
    objective: the value of the plan at each level.
    optimal: the plan is proven to be the best one.
    """

    number: int
    objective: Objective
    optimal: bool


@dataclass(frozen=True, slots=True)
class PhasePlans:
    """The plans made ahead for one phase of the mission."""

    phase: Phase
    safe_mode: int  # number of the configuration that serves critical functions only
    plans: tuple[Made, ...]  # each once
    by_fault_set: tuple[int, ...]  # index into `plans` for each fault set, in the order of `Scope.fault_sets`
    by_place: tuple[tuple[str, int], ...] = ()  # each place in use, and the index of its plan


@dataclass(frozen=True, slots=True)
class Contingencies:
    """All plans made ahead for one spec."""

    spec_digest: str  # SHA-256 of the spec's file, hexadecimal
    scope: Scope
    configurations: tuple[Configuration, ...]  # number 1 first
    phases: tuple[PhasePlans, ...]  # as in the scope

    def configuration(self, number: int) -> Configuration:
        """Return the configuration that has this number, 1 or above."""
        return self.configurations[number - 1]

    def entries(self) -> Iterator[tuple[Phase, FaultSet, Made]]:
        """Yield each fault set in each phase, with the plan that was made for it."""
        for table in self.phases:
            for down, index in zip(self.scope.fault_sets(), table.by_fault_set, strict=True):
                yield table.phase, down, table.plans[index]
            for place, index in table.by_place:
                yield table.phase, frozenset({place}), table.plans[index]


def contingencies(
    spec: Spec,
    scope: Scope,
    outcomes: Mapping[tuple[Phase, FaultSet], Outcome],
    safe_modes: Mapping[Phase, Configuration],
) -> Contingencies:
    """Put the results of a sweep together, and number their configurations; equal ones get the same number.

    outcomes: the result for every fault set in every phase of the scope; with `scope.places`, also for each
        place in use.
    safe_modes: the configuration of the safe mode of each phase; it gets a number, too.
    """
    numbers = _Numbers(spec)
    for phase in scope.phases:
        numbers.of(outcomes[phase, frozenset()].configuration)
    safe = {phase: numbers.of(safe_modes[phase]) for phase in scope.phases}
    for size in scope.sizes():
        for phase in scope.phases:
            for down in scope.of_size(size):
                numbers.of(outcomes[phase, down].configuration)
    in_use = {phase: _places(spec, scope, outcomes[phase, frozenset()]) for phase in scope.phases}
    for phase in scope.phases:
        for place in in_use[phase]:
            numbers.of(outcomes[phase, frozenset({place})].configuration)
    tables = tuple(
        _phase_plans(phase, safe[phase], scope, outcomes, numbers, in_use=in_use[phase]) for phase in scope.phases
    )
    return Contingencies(spec.digest, scope, tuple(numbers.configurations), tables)


def _places(spec: Spec, scope: Scope, fault_free: Outcome) -> list[str]:
    return places_in_use(spec, fault_free.configuration) if scope.places and scope.faults else []


def _phase_plans(
    phase: Phase,
    safe_mode: int,
    scope: Scope,
    outcomes: Mapping[tuple[Phase, FaultSet], Outcome],
    numbers: "_Numbers",
    *,
    in_use: list[str],
) -> PhasePlans:
    plans: dict[Made, int] = {}

    def index_of(down: FaultSet) -> int:
        found = outcomes[phase, down]
        made = Made(numbers.of(found.configuration), found.objective, found.optimal)
        return plans.setdefault(made, len(plans))

    by_fault_set = tuple(map(index_of, scope.fault_sets()))
    by_place = tuple((place, index_of(frozenset({place}))) for place in in_use)
    return PhasePlans(phase, safe_mode, tuple(plans), by_fault_set, by_place)


class _Numbers:
    """Gives numbers to configurations, from 1; equal configurations get the same number."""

    def __init__(self, spec: Spec) -> None:
        self.configurations: list[Configuration] = []
        self._code = ConfigurationCode(spec)
        self._by_row: dict[bytes, int] = {}
        self._by_identity: dict[int, int] = {}  # by `id` of a configuration: most fault sets share one object

    def of(self, configuration: Configuration) -> int:
        known = self._by_identity.get(id(configuration))
        if known is not None:
            return known
        row = self._code.encode(configuration)
        if row not in self._by_row:
            self.configurations.append(configuration)
            self._by_row[row] = len(self.configurations)
        self._by_identity[id(configuration)] = self._by_row[row]
        return self._by_row[row]
