"""The figures of a campaign: what survives a number of faults.

A sweep has already made the plans for all fault sets; this file counts what the plans serve. All fault sets with the
same number of faults have the same weight, however likely each of them is.

A function counts as lost after a fault set if the best plan does not serve it. There are two possible
reasons: no plan can serve the function, or a more important function needs the remaining resources.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from heronry_dg.field_types import CRITICALITIES
from heronry_dg.model import Function, Spec
from heronry_manager.planner.sweep import FaultSet, Outcome, Phase, Scope
from heronry_tools.analysis.campaign.minimal import minimal
from heronry_tools.analysis.campaign.outlook import Outlook, outlook


@dataclass(frozen=True, slots=True)
class Range:
    """Best, mean and worst value of a quantity over all fault sets with the same number of faults."""

    best: int
    mean: float
    worst: int


@dataclass(frozen=True, slots=True)
class Grade:
    """Figures for one number of simultaneous faults, over all fault sets of that size: what is still served."""

    faults: int
    sets: int
    utility: Range
    critical: Range  # critical functions (A to D) served
    lost: Mapping[str, int]  # wanted function -> in how many of the sets it is not served
    unproven: int  # plans not proven to be the best


@dataclass(frozen=True, slots=True)
class PhaseSurvey:
    """What survives in one phase: figures by number of faults, single points of failure, the outlook."""

    phase: Phase
    wanted: Mapping[str, str]  # function -> its class
    grades: tuple[Grade, ...]  # one for each number of faults, from 0
    single_points: Mapping[str, tuple[str, ...]]  # served function -> elements of which each alone loses it
    outlook: Outlook | None  # how likely functions are lost, where rates are given


def survey(spec: Spec, scope: Scope, outcomes: Mapping[tuple[Phase, FaultSet], Outcome]) -> tuple[PhaseSurvey, ...]:
    """Work out the figures of every phase of a scope."""
    return tuple(_phase_survey(spec, scope, phase, outcomes) for phase in scope.phases)


def _phase_survey(
    spec: Spec, scope: Scope, phase: Phase, outcomes: Mapping[tuple[Phase, FaultSet], Outcome]
) -> PhaseSurvey:
    wanted = {f.name: f for f in spec.functions.values() if f.priority_in(phase) > 0}
    critical = {name: f for name, f in wanted.items() if f.criticality_in(phase) != CRITICALITIES[-1]}
    losing: dict[str, list[FaultSet]] = {name: [] for name in wanted}
    for down in scope.fault_sets():
        for name in _unserved(wanted, outcomes[phase, down]):
            losing[name].append(down)
    smallest = {name: minimal(sets) for name, sets in losing.items()}
    return PhaseSurvey(
        phase=phase,
        wanted={name: function.criticality_in(phase) for name, function in wanted.items()},
        grades=tuple(
            _grade(size, [outcomes[phase, down] for down in scope.of_size(size)], wanted, critical)
            for size in scope.sizes()
        ),
        single_points={
            name: tuple(element for one in sets if len(one) == 1 for element in one) for name, sets in smallest.items()
        },
        outlook=outlook(spec, scope, phase, outcomes),
    )


def _grade(
    size: int, outcomes: list[Outcome], wanted: Mapping[str, Function], critical: Mapping[str, Function]
) -> Grade:
    lost = Counter(name for outcome in outcomes for name in _unserved(wanted, outcome))
    return Grade(
        faults=size,
        sets=len(outcomes),
        utility=_range(outcome.objective.utility for outcome in outcomes),
        critical=_range(len(critical) - len(_unserved(critical, outcome)) for outcome in outcomes),
        lost={name: lost[name] for name in wanted},
        unproven=sum(not outcome.optimal for outcome in outcomes),
    )


def _unserved(functions: Mapping[str, Function], outcome: Outcome) -> list[str]:
    running = outcome.configuration.modules
    return [name for name, f in functions.items() if not any(output in running for output in f.outputs)]


def _range(values: Iterable[int]) -> Range:
    known = list(values)
    return Range(max(known), sum(known) / len(known), min(known))
