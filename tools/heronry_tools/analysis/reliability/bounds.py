"""How likely a function is lost with real resources: a lower and an upper bound, and what lies between them.

Planning has decided about every set of up to N elements that are down (`resource_sets`); of larger sets some are known
to lose the function, since they contain a cut set, and of the others nothing is known.

    lower bound   the probability that all elements of some known cut set are down: a logical one of any order, or a
                  resource-aware one of up to N elements; exact, by a diagram
    upper bound   the probability that exactly the elements of a losing set of up to N are down, added over these sets,
                  and the probability that more than N elements are down

Both are proven: what is between them is the probability of sets of more than N elements about which nothing is known.
"""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations

from heronry_tools.analysis.reliability.chances import Hazards
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.failure import Failure


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of a probability; `high` is None if nothing better than 1 is known."""

    low: float
    high: float | None

    @property
    def exact(self) -> bool:
        """Tell whether both bounds agree to nine digits."""
        return self.high is not None and self.high - self.low <= 1e-9 * self.high

    def __str__(self) -> str:
        if self.high is None:
            return f"at least {self.low:.4g}"
        return f"{self.low:.4g} (exact)" if self.exact else f"{self.low:.4g} (lower) to {self.high:.4g} (upper)"


def loss_bounds(
    failure: Failure, cuts: Collection[frozenset[str]], order: int, hazards: Hazards, hours: float
) -> Bounds:
    """Return bounds of the probability that a function is lost within so many hours, with real resources.

    cuts: all smallest sets of up to `order` elements that lose the function, logical or not.

    There is no upper bound if an element that may matter has neither a rate nor a probability.
    """
    formula = failure.formula
    known = formula.any_of([failure.root, *(formula.all_of(map(formula.event, sorted(cut))) for cut in cuts)])
    hazards = hazards.among(failure.reach)
    chances = hazards.chances(hours)
    solution = Solution(formula, hazards.with_causes(formula, known), truncate=chances)
    low = solution.probability(chances)
    if not failure.reach <= hazards.known():
        return Bounds(low, None)
    if order >= len(failure.reach):
        return Bounds(low, solution.at_most(chances))
    losing = supersets(sorted(failure.reach), cuts, order)
    high = hazards.exactly(losing, hours) + hazards.more_than(order, failure.reach, hours)
    return Bounds(low, max(low, min(1.0, high)))


def supersets(elements: Iterable[str], cuts: Collection[frozenset[str]], order: int) -> Iterator[frozenset[str]]:
    """Yield the sets of up to `order` of some elements that contain one of the sets in `cuts`."""
    named = list(elements)
    bit = {element: 1 << index for index, element in enumerate(named)}
    masks = [sum(bit[element] for element in cut) for cut in cuts if bit.keys() >= cut and len(cut) <= order]
    for size in range(min(order, len(named)) + 1):
        for chosen in combinations(named, size):
            mask = sum(bit[element] for element in chosen)
            if any(cut & mask == cut for cut in masks):
                yield frozenset(chosen)
