"""How likely elements fail: rates, probabilities on demand, and common causes.

An element with the rate r has failed after t hours with the probability 1 - exp(-r t); one with a `probability` has
failed with that probability whatever the time. An element with neither never fails here, so what is computed is then a
lower bound. Failed elements are not repaired. Elements fail independently but for common causes.

*Common cause* (the beta factor). A group of elements has a share beta. One more event, the common cause, takes down all
elements of the group at once; its rate is beta times the lowest rate of the group, and each element keeps the rest of
its own rate. So a single element fails as often as without the group. With probabilities on demand, the common cause
has beta times the lowest of them, and each element keeps its own less that.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import expm1, fsum, prod

from heronry_tools.analysis.reliability.formula import Formula


@dataclass(frozen=True, slots=True)
class CommonCause:
    """Elements that one cause takes down together, with the share `beta` of their rate, above 0 and at most 1.

    lowest: the lowest rate or probability of the group; None: that of the elements.
    event: names the event that the cause happens; if it is empty, `Hazards` names it.
    """

    elements: tuple[str, ...]
    beta: float
    lowest: float | None = None
    event: str = ""


@dataclass(frozen=True)
class Hazards:
    """The rates (per hour) and the probabilities on demand of elements, and their common causes.

    An element has a rate or a probability, not both. The elements of a common cause all have a rate, or all have a
    probability, and the shares beta of the causes of one element add up to at most 1.
    """

    rates: Mapping[str, float] = field(default_factory=dict)
    demands: Mapping[str, float] = field(default_factory=dict)
    common: tuple[CommonCause, ...] = ()

    def __post_init__(self) -> None:
        named = tuple(
            replace(cause, event=cause.event or f"common cause {number} of {', '.join(cause.elements)}")
            for number, cause in enumerate(self.common, 1)
        )
        object.__setattr__(self, "common", named)

    def known(self) -> frozenset[str]:
        """Return the elements of which it is known how likely they fail."""
        return frozenset((*self.rates, *self.demands))

    def among(self, elements: Collection[str]) -> "Hazards":
        """Return the same for these elements alone; a common cause stays as likely, and takes down what is left."""
        return Hazards(
            {name: rate for name, rate in self.rates.items() if name in elements},
            {name: chance for name, chance in self.demands.items() if name in elements},
            tuple(
                CommonCause(left, cause.beta, self._lowest(cause), cause.event)
                for cause in self.common
                if (left := tuple(one for one in cause.elements if one in elements))
            ),
        )

    def chances(self, hours: float) -> dict[str, float]:
        """Return the probability of each event within so many hours: elements that fail alone, common causes."""
        _, shared = self._shared()
        found = {name: _failed(rate, hours) for name, rate in self.own_rates().items()}
        found |= {name: max(0.0, chance - shared.get(name, 0.0)) for name, chance in self.demands.items()}
        return found | {cause.event: self._of(cause)[1] for cause in self.common if self._of(cause)[0] is None}

    def own_rates(self) -> dict[str, float]:
        """Return the rate of each event that has one: elements that fail by themselves, and common causes."""
        shared, _ = self._shared()
        found = {name: max(0.0, rate - shared.get(name, 0.0)) for name, rate in self.rates.items()}
        causes = {cause.event: rate for cause in self.common if (rate := self._of(cause)[0]) is not None}
        return found | causes

    def with_causes(self, formula: Formula, root: int) -> int:
        """Return the node that `root` becomes if the common causes take down elements, too."""
        causes: dict[str, list[int]] = {}
        for cause in self.common:
            for element in cause.elements:
                causes.setdefault(element, []).append(formula.event(cause.event))
        own = {formula.event(element): events for element, events in causes.items()}
        return (
            formula.with_replaced(root, {one: formula.any_of([one, *its]) for one, its in own.items()}) if own else root
        )

    def exactly(self, sets: Iterable[frozenset[str]], hours: float) -> float:
        """Return the probability that the elements that are down are exactly one of these sets, each given once."""
        return fsum(self.each_exactly(list(sets), hours))

    def each_exactly(self, sets: Sequence[frozenset[str]], hours: float) -> list[float]:
        """Return the probability of each of these sets that exactly its elements are down."""
        chances = self.chances(hours)
        found = [0.0] * len(sets)
        for weight, forced in self._causes(chances):
            for number, chance in enumerate(self._exactly(sets, forced, chances)):
                found[number] += weight * chance
        return found

    def more_than(self, number: int, elements: Collection[str], hours: float) -> float:
        """Return the probability that more than so many of these elements are down."""
        chances = self.chances(hours)
        terms = []
        for weight, forced in self._causes(chances):
            down = [1.0] + [0.0] * (number + 1)  # 0, 1, ... elements are down; the last one: more than `number`
            for element in elements:
                chance = 1.0 if element in forced else chances.get(element, 0.0)
                down[-1] += down[-2] * chance
                for count in range(number, 0, -1):
                    down[count] = down[count] * (1.0 - chance) + down[count - 1] * chance
                down[0] *= 1.0 - chance
            terms.append(weight * down[-1])
        return fsum(terms)

    def _exactly(
        self, sets: Iterable[frozenset[str]], forced: frozenset[str], chances: Mapping[str, float]
    ) -> Iterator[float]:
        own = {name: chances[name] for name in (*self.rates, *self.demands) if name not in forced}
        certain = {name for name, chance in own.items() if chance >= 1.0}
        whole = prod(1.0 - chance for name, chance in own.items() if name not in certain)
        odds = {name: chance / (1.0 - chance) for name, chance in own.items() if name not in certain}
        odds |= dict.fromkeys((*forced, *certain), 1.0)
        for down in sets:
            if forced <= down and certain <= down:
                yield whole * prod(odds.get(name, 0.0) for name in down)
            else:
                yield 0.0

    def _causes(self, chances: Mapping[str, float]) -> Iterable[tuple[float, frozenset[str]]]:
        """Yield the ways in which common causes happen or not: its probability, and what they take down."""
        for happens in product((False, True), repeat=len(self.common)):
            weight, forced = 1.0, set[str]()
            for cause, does in zip(self.common, happens, strict=True):
                weight *= chances[cause.event] if does else 1.0 - chances[cause.event]
                if does:
                    forced.update(cause.elements)
            if weight > 0.0:
                yield weight, frozenset(forced)

    def _of(self, cause: CommonCause) -> tuple[float | None, float]:
        """Return the rate of a cause, or None and its probability on demand."""
        share = cause.beta * self._lowest(cause)
        return (None, share) if cause.elements[0] in self.demands else (share, 0.0)

    def _lowest(self, cause: CommonCause) -> float:
        if cause.lowest is not None:
            return cause.lowest
        known = self.demands if cause.elements[0] in self.demands else self.rates
        return min(known.get(element, 0.0) for element in cause.elements)

    def _shared(self) -> tuple[dict[str, float], dict[str, float]]:
        rates, chances = dict[str, float](), dict[str, float]()
        for cause in self.common:
            rate, chance = self._of(cause)
            for element in cause.elements:
                if rate is None:
                    chances[element] = chances.get(element, 0.0) + chance
                else:
                    rates[element] = rates.get(element, 0.0) + rate
        return rates, chances


def _failed(rate: float, hours: float) -> float:
    """Return the probability that an element with a rate per hour has failed; `hours` may be infinite."""
    return -expm1(-rate * hours) if rate > 0.0 else 0.0
