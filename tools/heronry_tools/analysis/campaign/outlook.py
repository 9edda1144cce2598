"""The outlook of a mission: how likely each function is lost, and each utility is left, with the best plans.

A campaign knows the best plan for every set of up to N elements that are down. So the probability of each such set is
the probability of what its plan serves, exactly; the sets exclude each other, and their probabilities add up. It does
not matter here whether a further fault brings a function back. What is left is the probability that more than N
elements are down: of that share nothing is known but what the logic of the graph loses anyway.

A function counts as lost if the best plan does not serve it, as in the rest of a campaign. All this holds at every time
of the mission alike, so there is R(t), too: how likely the best plan serves a function after t hours. The mean time to
loss is that of the logic, which is an upper bound: real resources lose a function no later.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import fsum
from typing import Final

from heronry_dg.model import Function, Spec
from heronry_manager.planner.sweep import FaultSet, Outcome, Phase, Scope
from heronry_tools.analysis.reliability.bounds import Bounds
from heronry_tools.analysis.reliability.chances import Hazards
from heronry_tools.analysis.reliability.formula import TooLargeError
from heronry_tools.analysis.reliability.mission import Reliability
from heronry_tools.analysis.reliability.spec_hazards import hazards, mission_hours

POINTS: Final = 20  # of R(t), beside that of its beginning

Curve = tuple[tuple[float, Bounds], ...]
"""Times in hours, each with bounds of the probability that a function is lost then."""


@dataclass(frozen=True, slots=True)
class Outlook:
    """What is to be expected of one phase, if it lasts as long as the mission, without repair.

    hours: length of the mission. order: largest number of elements down for which there is a plan.
    curves: of each wanted function, the probability of loss at times from 0 to the end of the mission.
    losses_per_h: the probability of loss within one hour.
    mean_times_h: the mean time until the logic of the graph loses the function, in hours (upper bound; infinite if it
        may last for ever).
    utilities: each utility that a plan has, the greatest first, with its probability (exact).
    beyond: probability that more than `order` elements are down, with a utility that is not known.
    expected: bounds of the expected utility.
    without_rate: how many elements have neither rate nor probability; they count as never down.

    A function that is lost with nothing down, or of whose loss nothing is known, is in none of the maps.
    """

    hours: float
    order: int
    curves: Mapping[str, Curve]
    losses_per_h: Mapping[str, Bounds]
    mean_times_h: Mapping[str, float]
    utilities: tuple[tuple[int, float], ...]
    beyond: float
    expected: tuple[float, float]
    without_rate: int

    @property
    def losses(self) -> Mapping[str, Bounds]:
        """The probability that each function is lost within the mission."""
        return {name: curve[-1][1] for name, curve in self.curves.items()}


def outlook(
    spec: Spec, scope: Scope, phase: Phase, outcomes: Mapping[tuple[Phase, FaultSet], Outcome]
) -> Outlook | None:
    """Return the outlook of a phase; None if the spec says of no element of the scope how likely it fails."""
    known = hazards(spec).among(scope.elements)
    if not known.known():
        return None
    hours = mission_hours(spec)
    wanted = [function for function in spec.functions.values() if function.priority_in(phase) > 0]
    sets = list(scope.fault_sets())
    plans = [outcomes[phase, down] for down in sets]

    def solved(function: str) -> Reliability:
        return Reliability(spec.in_phase(phase), function, scope.elements, known)

    losing = [found for one in wanted if (found := _losing(one, sets, plans, solved)) is not None]
    times = [hours * number / POINTS for number in range(POINTS + 1)]
    moments = {time: _Moment(time, sets, scope, known) for time in {*times, 1.0}}
    end = moments[hours]
    utilities = _utilities(plans, end.chances)
    least = fsum(utility * chance for utility, chance in utilities)
    curves = {one.name: tuple((time, one.loss(moments[time])) for time in times) for one in losing}
    told = {name: curve for name, curve in curves.items() if curve[-1][1].low > 0.0 or curve[-1][1].high is not None}
    return Outlook(
        hours=hours,
        order=scope.faults,
        curves=told,
        losses_per_h={one.name: one.loss(moments[1.0]) for one in losing if one.name in told},
        mean_times_h={
            one.name: one.logic.mean_time_to_failure() for one in losing if one.name in told and one.logic is not None
        },
        utilities=utilities,
        beyond=end.beyond,
        expected=(least, least + end.beyond * _most_utility(spec, phase, wanted)),
        without_rate=len(set(scope.elements) - known.known()),
    )


def _utilities(plans: Sequence[Outcome], chances: Sequence[float]) -> tuple[tuple[int, float], ...]:
    by_utility: dict[int, list[float]] = {}
    for plan, chance in zip(plans, chances, strict=True):
        by_utility.setdefault(plan.objective.utility, []).append(chance)
    return tuple((utility, fsum(its)) for utility, its in sorted(by_utility.items(), reverse=True))


def _most_utility(spec: Spec, phase: Phase, wanted: list[Function]) -> int:
    """Return a utility that no plan of a phase exceeds: every wanted function in its best mode."""
    modes = {f.name: max(len(spec.modules[output].modes) for output in f.outputs) for f in wanted}
    return sum(
        f.priority_in(phase) * max(f.value_of(index, modes[f.name]) for index in range(modes[f.name])) for f in wanted
    )


class _Moment:
    """How likely elements are down after some hours.

    chances: of each set that has a plan, the probability that exactly its elements are down.
    beyond: the probability that more elements are down than any such set has.
    complete: of each element it is known how likely it fails.
    """

    def __init__(self, hours: float, sets: Sequence[FaultSet], scope: Scope, known: Hazards) -> None:
        self.hours = hours
        self.chances = known.each_exactly(sets, hours)
        self.beyond = known.more_than(scope.faults, scope.elements, hours)
        self.complete = known.known() >= set(scope.elements)


@dataclass(frozen=True, slots=True)
class _Losing:
    """When a function is lost: after which sets, by number, and by the logic of the graph.

    by_logic: those of the sets that the logic loses.
    logic: None: it is too large.
    """

    name: str
    sets: tuple[int, ...]
    by_logic: tuple[int, ...]
    logic: Reliability | None

    def loss(self, moment: _Moment) -> Bounds:
        """Return bounds of the probability that the function is lost within the hours of a moment."""
        decided = fsum(moment.chances[number] for number in self.sets)
        low = decided
        if self.logic is not None:  # it loses larger sets, too
            small = fsum(moment.chances[number] for number in self.by_logic)
            low += max(0.0, self.logic.loss(moment.hours) - small)
        high = max(low, min(1.0, decided + moment.beyond)) if moment.complete else None
        return Bounds(low, high)


def _losing(
    function: Function, sets: Sequence[FaultSet], plans: Sequence[Outcome], solved: Callable[[str], Reliability]
) -> _Losing | None:
    """Tell when a function is lost; None if it is with nothing down.

    solved: solves the logic of a function; raises TooLargeError.
    """
    lost = [
        number
        for number, plan in enumerate(plans)
        if not any(output in plan.configuration.modules for output in function.outputs)
    ]
    if any(not sets[number] for number in lost):
        return None
    try:
        logic = solved(function.name)
    except TooLargeError:
        return _Losing(function.name, tuple(lost), (), None)
    formula, root = logic.failure.formula, logic.failure.root
    by_logic = tuple(number for number in lost if formula.evaluate(root, sets[number].__contains__))
    return _Losing(function.name, tuple(lost), by_logic, logic)
