"""The outlook of a mission: how likely each function is lost, and each utility is left, with the best plans.

A campaign knows the best plan for every set of up to N elements that are down. So the probability of each such set is
the probability of what its plan serves, exactly; the sets exclude each other, and their probabilities add up. It does
not matter here whether a further fault brings a function back. What is left is the probability that more than N
elements are down: of that share nothing is known but what the logic of the graph loses anyway.

A function counts as lost if the best plan does not serve it, as in the rest of a campaign.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import fsum

from heronry_dg.model import Function, Spec
from heronry_manager.planner.sweep import FaultSet, Outcome, Phase, Scope
from heronry_tools.analysis.reliability.bounds import Bounds
from heronry_tools.analysis.reliability.chances import Hazards
from heronry_tools.analysis.reliability.formula import TooLargeError
from heronry_tools.analysis.reliability.mission import Reliability
from heronry_tools.analysis.reliability.spec_hazards import hazards, mission_hours


@dataclass(frozen=True, slots=True)
class Outlook:
    """What is to be expected of one phase, if it lasts as long as the mission, without repair.

    hours: length of the mission. order: largest number of elements down for which there is a plan.
    losses, losses_per_h: of each wanted function, the probability of loss within the mission, and within one hour.
    utilities: each utility that a plan has, the greatest first, with its probability (exact).
    beyond: probability that more than `order` elements are down, with a utility that is not known.
    expected: bounds of the expected utility.
    without_rate: how many elements have neither rate nor probability; they count as never down.
    """

    hours: float
    order: int
    losses: Mapping[str, Bounds]
    losses_per_h: Mapping[str, Bounds]
    utilities: tuple[tuple[int, float], ...]
    beyond: float
    expected: tuple[float, float]
    without_rate: int


def outlook(
    spec: Spec, scope: Scope, phase: Phase, outcomes: Mapping[tuple[Phase, FaultSet], Outcome]
) -> Outlook | None:
    """Give the outlook of a phase; None if the spec says of no element of the scope how likely it fails."""
    known = hazards(spec).among(scope.elements)
    if not known.known():
        return None
    hours = mission_hours(spec)
    wanted = [function for function in spec.functions.values() if function.priority_in(phase) > 0]
    plans = {down: outcomes[phase, down] for down in scope.fault_sets()}
    chances = dict(zip(plans, known.each_exactly(list(plans), hours), strict=True))
    within_hour = dict(zip(plans, known.each_exactly(list(plans), 1.0), strict=True))
    by_utility: dict[int, list[float]] = {}
    for down, plan in plans.items():
        by_utility.setdefault(plan.objective.utility, []).append(chances[down])
    utilities = tuple((utility, fsum(its)) for utility, its in sorted(by_utility.items(), reverse=True))
    beyond = known.more_than(scope.faults, scope.elements, hours)
    least = fsum(utility * chance for utility, chance in utilities)
    losses: list[dict[str, Bounds]] = []
    for length, likely in ((hours, chances), (1.0, within_hour)):
        losing = _Losing(spec, scope, phase, plans, known, likely, length)
        found = {function.name: losing.bounds(function) for function in wanted}
        losses.append({name: one for name, one in found.items() if one is not None})
    return Outlook(
        hours=hours,
        order=scope.faults,
        losses=losses[0],
        losses_per_h=losses[1],
        utilities=utilities,
        beyond=beyond,
        expected=(least, least + beyond * _most_utility(spec, phase, wanted)),
        without_rate=len(set(scope.elements) - known.known()),
    )


def _most_utility(spec: Spec, phase: Phase, wanted: list[Function]) -> int:
    """Give a utility that no plan of a phase exceeds: every wanted function in its best mode."""
    modes = {f.name: max(len(spec.modules[output].modes) for output in f.outputs) for f in wanted}
    return sum(
        f.priority_in(phase) * max(f.value_of(index, modes[f.name]) for index in range(modes[f.name])) for f in wanted
    )


@dataclass(frozen=True, slots=True)
class _Losing:
    """How likely functions are lost in a phase within so many hours; `chances` of each set that has a plan."""

    spec: Spec
    scope: Scope
    phase: Phase
    plans: Mapping[FaultSet, Outcome]
    hazards: Hazards
    chances: Mapping[FaultSet, float]
    hours: float

    def bounds(self, function: Function) -> Bounds | None:
        """Give bounds of the probability of loss; None if a function is lost anyway, or nothing is known."""
        losing = [
            down
            for down, plan in self.plans.items()
            if not any(output in plan.configuration.modules for output in function.outputs)
        ]
        if frozenset() in losing:
            return None
        decided = fsum(self.chances[down] for down in losing)
        low = decided + self._by_logic_beyond(function, losing)
        if self.hazards.known() >= set(self.scope.elements):
            beyond = self.hazards.more_than(self.scope.faults, self.scope.elements, self.hours)
            return Bounds(low, max(low, min(1.0, decided + beyond)))
        return Bounds(low, None) if low > 0.0 else None

    def _by_logic_beyond(self, function: Function, losing: list[FaultSet]) -> float:
        """Give the probability that larger sets than have a plan are down, and the logic of the graph is lost."""
        try:
            logic = Reliability(self.spec.in_phase(self.phase), function.name, self.scope.elements, self.hazards)
        except TooLargeError:
            return 0.0
        formula, root = logic.failure.formula, logic.failure.root
        small = fsum(self.chances[down] for down in losing if formula.evaluate(root, down.__contains__))
        return max(0.0, logic.loss(self.hours) - small)
