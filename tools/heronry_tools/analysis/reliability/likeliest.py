"""Lists minimal cut sets by their likelihood, the likeliest first, without listing all.

The weight of a set is the sum of the logarithms of its events' probabilities. From each node of a diagram the best
weight of all ways to the end is known. So a search from the root always knows how good each way can still become: it
follows the best one to its end, and keeps what it passed by for later. A way that enters a part remembers where it goes
on behind that part.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from math import inf
from typing import NamedTuple, Optional

from heronry_tools.analysis.reliability.bdd import Bdd, Zbdd
from heronry_tools.analysis.reliability.formula import FALSE, TRUE
from heronry_tools.analysis.reliability.parts import Part


@dataclass(frozen=True, slots=True)
class Solved:
    """A part with its diagrams; variable number i is `leaves[i]`.

    order: the family has the minimal sets of up to so many leaves; None: of every order.
    above: the pool and the root of a diagram that is true wherever the part is; then `root` is true only where the part
        is. None: `root` is exact.
    """

    part: Part
    leaves: tuple[int, ...]
    bdd: Bdd
    root: int
    sets: Zbdd
    family: int
    order: int | None = None
    above: tuple[Bdd, int] | None = None


class _Way(NamedTuple):
    """A way from the root: the part and node where it is, what it has taken, and where it goes on behind the part."""

    part: int
    node: int
    taken: Optional["_Taken"]
    rest: Optional["_Way"]


class _Taken(NamedTuple):
    event: int
    before: Optional["_Taken"]


def likeliest(root: int, parts: Mapping[int, Solved], weights: Mapping[int, float]) -> Iterator[tuple[int, ...]]:
    """Yield the sets of a root by their weight, the greatest first; an event without a weight never happens."""
    if root not in parts:
        if root == TRUE:
            yield ()
        elif root in weights:
            yield (root,)
        return
    search = _Search(parts, weights)
    ticket, waiting = count(), list[tuple[float, int, _Way]]()
    if search.weight[root] > -inf:
        waiting.append((-search.weight[root], next(ticket), _Way(root, parts[root].family, None, None)))
    while waiting:
        cost, _, way = heappop(waiting)
        while way.node != TRUE or way.rest is not None:
            if way.node == TRUE and way.rest is not None:
                way = way.rest._replace(taken=way.taken)
                continue
            way, other, worse = search.fork(way)
            if worse < inf:
                heappush(waiting, (cost + worse, next(ticket), other))
        yield tuple(_events(way.taken))


def _events(taken: _Taken | None) -> Iterator[int]:
    while taken is not None:
        yield taken.event
        taken = taken.before


class _Search:
    """The best weight of each node of each part, and of each leaf."""

    def __init__(self, parts: Mapping[int, Solved], weights: Mapping[int, float]) -> None:
        self._parts, self.weight = parts, dict(weights)
        self._best: dict[int, dict[int, float]] = {}
        for part, one in parts.items():
            best = self._best[part] = {FALSE: -inf, TRUE: 0.0}
            for node in one.sets.below(one.family):
                leaf = one.leaves[one.sets.variable[node]]
                with_it = self.weight.get(leaf, -inf) + best[one.sets.high[node]]
                best[node] = max(best[one.sets.low[node]], with_it)
            self.weight[part] = best[one.family]

    def fork(self, way: _Way) -> tuple[_Way, _Way, float]:
        """Return the better way on from a node, the other one, and by how much that is worse (infinite: no way)."""
        one, best = self._parts[way.part], self._best[way.part]
        leaf, low, high = one.leaves[one.sets.variable[way.node]], one.sets.low[way.node], one.sets.high[way.node]
        without = way._replace(node=low)
        if leaf in self._parts:
            within = _Way(leaf, self._parts[leaf].family, way.taken, way._replace(node=high))
        else:
            within = way._replace(node=high, taken=_Taken(leaf, way.taken))
        gain, loss = self.weight.get(leaf, -inf) + best[high], best[low]
        return (within, without, gain - loss) if gain >= loss else (without, within, loss - gain)
