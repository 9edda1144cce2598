"""The likelihood of faults: from `rate_per_h`, to first order.

The probability that a set of faults occurs within one hour is about the product of their rates. The probability that a
function is lost is about the sum over the smallest sets that lose it. Both are slightly too large (rates are small, and
sets overlap), so they are upper bounds as long as every rate is given. Where a rate is missing, the result is a lower
bound, and is marked as one.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from math import prod

from heronry_dg.model import Spec


@dataclass(frozen=True, slots=True)
class Likelihood:
    """Probability within one hour; incomplete where sets without a rate are left out of it."""

    per_h: float
    complete: bool

    def __str__(self) -> str:
        return f"{'' if self.complete else 'at least '}{self.per_h:.1e} per hour"


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


def likelihood(spec: Spec, fault_sets: Iterable[frozenset[str]]) -> Likelihood | None:
    """Probability that all elements of some set fail within one hour; None where no set has all its rates."""
    total, known, unknown = Fraction(0), 0, 0
    for faults in fault_sets:
        rates = [rate_of(spec, element) for element in faults]
        given = [rate for rate in rates if rate is not None]
        if len(given) == len(rates):
            total, known = total + prod(given, start=Fraction(1)), known + 1
        else:
            unknown += 1
    return Likelihood(float(total), complete=unknown == 0) if known else None
