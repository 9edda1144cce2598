"""The likelihood that a function is lost within one hour, from the failure rates of a spec: a lower and an upper bound.

Elements fail independently. An element with rate r fails within the hour with the probability 1 - exp(-r), which is at
most r. A function is lost when all elements of one of several fault sets fail. Such sets are known up to a number of
elements, the *order* of the scope. The probability of a set is the probability that all its elements fail.

    lower bound   The greater of two values:
                  1. The sum of the probabilities of the likeliest known sets, minus a correction (Bonferroni). The
                     correction adds up, over all pairs of these sets, the probability that all elements of both sets
                     fail
                  2. The probability of the likeliest set
    upper bound   The sum of two probabilities:
                  1. The sum of the probabilities of the known sets
                  2. An upper bound of the probability that the number of failed elements exceeds the order

Sets that have an element without a rate are left out of the lower bound. If an element of the scope has no rate, there
is no upper bound. The lower bound is valid on one assumption: after a fault set that loses the function, a further
fault does not bring the function back. (This could happen if the best plan gives up a function that could be served.)

The upper bound also covers fault sets with more elements than the order; the lower bound leaves them out.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from math import expm1, prod

from heronry_dg.model import Spec
from heronry_manager.planner.sweep import Scope

_MOST_PAIRED = 300  # most sets in the first value of the lower bound; fewer sets give a lower bound that is still valid


@dataclass(frozen=True, slots=True)
class Likelihood:
    """Bounds of the probability that a function is lost within one hour.

    `at_most_per_h` is the upper bound; None: no upper bound is known.
    """

    per_h: float  # at least
    at_most_per_h: float | None

    @property
    def complete(self) -> bool:
        """Tell whether every element has a rate, so that there is an upper bound."""
        return self.at_most_per_h is not None

    def __str__(self) -> str:
        low = f"{self.per_h:.1e}"
        if self.at_most_per_h is None:
            return f"at least {low} per hour"
        high = f"{self.at_most_per_h:.1e}"
        return f"{low} per hour" if low == high else f"{low} to {high} per hour"


def rate_of(spec: Spec, element: str) -> Fraction | None:
    """Give the failures per hour of an element; None where the spec gives no rate."""
    kind, _, name = element.partition(":")
    match kind:
        case "pe":
            return spec.pes[name].rate_per_h
        case "device":
            return spec.devices[name].rate_per_h
        case "module":
            return spec.modules[name].rate_per_h
        case "bus":
            return spec.buses[name].rate_per_h
        case _:  # a channel: the spec gives rates of whole buses
            return None


def likelihood(spec: Spec, fault_sets: Iterable[frozenset[str]], scope: Scope) -> Likelihood | None:
    """Give bounds of the probability that a function is lost within one hour.

    fault_sets: the minimal fault sets of the scope after which the function is lost.

    Returns None if no fault set has rates for all its elements.
    """
    rates = {element: rate for element in scope.elements if (rate := rate_of(spec, element)) is not None}
    sets = list(fault_sets)
    rated = [faults for faults in sets if rates.keys() >= faults]
    if not rated:
        return None
    most = None
    if len(rates) == len(scope.elements):
        known = sum(prod((rates[element] for element in faults), start=Fraction(1)) for faults in rated)
        most = min(1.0, float(known + _more_than(scope.faults, rates.values())))
    return Likelihood(_at_least({element: -expm1(-float(rate)) for element, rate in rates.items()}, rated), most)


def _at_least(chances: dict[str, float], sets: Iterable[frozenset[str]]) -> float:
    """Give a lower bound of the probability that all elements of at least one of the sets fail."""

    def chance(faults: Iterable[str]) -> float:
        return prod(chances[element] for element in faults)

    likeliest = sorted(sets, key=lambda faults: (-chance(faults), sorted(faults)))[:_MOST_PAIRED]
    both = sum(chance(one | other) for one, other in combinations(likeliest, 2))
    return max(chance(likeliest[0]), sum(map(chance, likeliest)) - both)


def _more_than(order: int, rates: Collection[Fraction]) -> Fraction:
    """Give an upper bound of the probability that more than `order` elements fail within one hour.

    For each set of `order` + 1 elements the rates of its elements are multiplied; the bound is the sum of all these
    products.

    rates: failures per hour of each element.
    """
    sums = [1.0] + [0.0] * (order + 1)  # over the elements so far: of all products of 0, 1, ... rates
    for rate in rates:
        for size in range(order + 1, 0, -1):
            sums[size] += sums[size - 1] * float(rate)
    return Fraction(sums[order + 1])
