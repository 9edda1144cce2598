"""A formula solved by diagrams: its minimal cut sets, counted and listed, and its probability.

The formula is made small (`simplifying`), split into independent parts (`parts`), and each part becomes a decision
diagram over its own leaves: events, and other parts, each known by its value alone. Then

    a minimal cut set of the whole is a minimal cut set of the last part, with each part in it replaced by a minimal cut
    set of that part. So counts multiply, and nothing has to be listed to be counted
    parts share no event, so each is one more independent event with a probability of its own

A part whose diagram is too large, or takes too long, is truncated if the caller allows it (`truncating`): then there
are its sets up to an order, and a lower and an upper bound of its probability.

Otherwise a probability here is exact but for the rounding of floating point: all terms that are added are positive. The
probability of the opposite is computed beside it, since 1 - p is not exact where p is nearly 1.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from math import log
from time import process_time
from typing import Final

from heronry_tools.analysis.reliability.bdd import Bdd, deep, minimal_cut_sets
from heronry_tools.analysis.reliability.formula import FALSE, TRUE, Formula, TooLargeError
from heronry_tools.analysis.reliability.likeliest import Solved, likeliest
from heronry_tools.analysis.reliability.ordering import orders
from heronry_tools.analysis.reliability.parts import Part, parts_of
from heronry_tools.analysis.reliability.simplifying import simplified
from heronry_tools.analysis.reliability.truncating import bound, sets_to_order, sum_of_sets

MOST_NODES: Final = 400_000  # of one diagram: a few hundred MB while it is made, and as much again for its sets
MOST_SECONDS: Final = 8.0  # of CPU for all exact diagrams
_MOST_AFTERWARDS: Final = 30_000  # of each diagram after one was too large
_GATES_BETWEEN_LOOKS: Final = 8  # at the clock
_BUDGETS: Final = (2_000, 8_000, 30_000, 120_000)  # nodes with which orders are tried, one after the other

Chances = Mapping[str, float]
"""Probability of each event, from 0 to 1; an event without one never happens."""


class Solution:
    """The minimal cut sets and the probability of one node of a formula."""

    def __init__(
        self,
        formula: Formula,
        root: int,
        most_nodes: int = MOST_NODES,
        truncate: Chances | None = None,
        most_seconds: float = MOST_SECONDS,
    ) -> None:
        """Solve a node.

        truncate: truncate a diagram of more than `most_nodes` nodes, and what is left after `most_seconds` of CPU, so
            that bounds are close with these probabilities; None: raise TooLargeError instead.
        """
        clock = _Clock(most_seconds)
        self._formula = formula
        self._root, parts = parts_of(formula, simplified(formula, root))
        self._parts: dict[int, Solved] = {}
        left = most_nodes
        for part in parts:
            try:
                one = _solved(formula, part, [*(budget for budget in _BUDGETS if budget < left), left], clock)
                left = max(min(left, _MOST_AFTERWARDS), left - len(one.bdd))
            except TooLargeError:
                if truncate is None:
                    raise
                one, left = self._truncated(part, truncate), min(left, _MOST_AFTERWARDS)
            self._parts[part.root] = one
        truncated = [one.order for one in self._parts.values() if one.order is not None]
        self.order: int | None = min(truncated, default=None)
        self.exact = all(one.above is None for one in self._parts.values())
        self._counts = self._counted()

    def _truncated(self, part: Part, chances: Chances) -> Solved:
        leaves = next(orders(self._formula, part))
        sets, family, order = sets_to_order(self._formula, part, leaves)
        low, high = (
            bound(self._formula, part, leaves, self._values(chances, above=constant == TRUE), constant)
            for constant in (FALSE, TRUE)
        )
        return Solved(part, tuple(leaves), *low, sets, family, order, high)

    @property
    def nodes(self) -> int:
        """How many nodes all diagrams have together, those of steps on the way included."""
        return sum(len(one.bdd) + len(one.sets) for one in self._parts.values())

    def support(self) -> list[str]:
        """Return the events that are in some minimal cut set; of what is truncated, all that may be."""
        events = {leaf: None for one in self._parts.values() for leaf in _asked(one) if leaf not in self._parts}
        whole = [self._root] if self._root in self._formula.names else []
        return sorted(self._formula.names[event] for event in (*events, *whole))

    def by_order(self) -> dict[int, int]:
        """Return how many minimal cut sets there are of each order (number of events) that has some, up to `order`."""
        root = self._root
        if root in self._parts:
            counts = self._counts[root][self._parts[root].family]
        else:
            counts = {FALSE: [], TRUE: [1]}.get(root, [0, 1])
        return {order: number for order, number in enumerate(counts) if number and self._has(order)}

    def _has(self, order: int) -> bool:
        return self.order is None or order <= self.order

    def _counted(self) -> dict[int, dict[int, list[int]]]:
        """Count the sets of each node of each part's diagram, by order."""
        found: dict[int, dict[int, list[int]]] = {}
        for part, one in self._parts.items():
            counts: dict[int, list[int]] = {FALSE: [], TRUE: [1]}
            for node in one.sets.below(one.family):
                leaf = one.leaves[one.sets.variable[node]]
                own = found[leaf][self._parts[leaf].family] if leaf in found else [0, 1]
                counts[node] = _sum(counts[one.sets.low[node]], _product(counts[one.sets.high[node]], own))
            found[part] = counts
        return found

    def sets(self, most: int, order: int | None = None) -> Iterator[frozenset[str]]:
        """Yield minimal cut sets, the smaller ones first: at most `most`, and of at most `order` events each."""
        listing = _Listing(self._parts, self._counts, most)
        names, left = self._formula.names, most
        for size in self.by_order():
            if left <= 0 or (order is not None and size > order):
                return
            with deep(_depth(self._parts)):
                found = listing.of(self._root, size)[:left]
            left -= len(found)
            yield from (frozenset(names[event] for event in one) for one in found)

    def likeliest(self, most: int, chances: Chances) -> Iterator[tuple[frozenset[str], float]]:
        """Yield up to `most` minimal cut sets with the probability that all their events happen, the likeliest first.

        Sets with an event that never happens are left out.
        """
        names = self._formula.names
        weights = {node: log(chances[name]) for name, node in self._formula.events.items() if chances.get(name)}
        ranked = (one for one in likeliest(self._root, self._parts, weights) if self._has(len(one)))
        for found in islice(ranked, most):
            chance = 1.0
            for event in found:
                chance *= chances[names[event]]
            yield frozenset(names[event] for event in found), chance

    def probability(self, chances: Chances) -> float:
        """Return the probability that the node is true, if its events happen independently; or a lower bound of it."""
        return self._values(chances)[self._root][0]

    def at_most(self, chances: Chances) -> float:
        """Return an upper bound of that probability; the probability itself if this is exact."""
        return self._values(chances, above=True)[self._root][0]

    def survival(self, chances: Chances) -> float:
        """Return the probability that the node is false; or an upper bound of it."""
        return self._values(chances)[self._root][1]

    def survival_at_least(self, chances: Chances) -> float:
        """Return a lower bound of that probability; the probability itself if this is exact."""
        return self._values(chances, above=True)[self._root][1]

    def birnbaum(self, chances: Chances) -> dict[str, float]:
        """Return the importance of each event: by how much the probability grows if it surely happens, not never.

        If this is not exact, it is about the lower bound.
        """
        values = self._values(chances)
        slope: dict[int, float] = {self._root: 1.0}
        for part, one in reversed(self._parts.items()):
            for leaf, share in _slopes(one, values).items():
                slope[leaf] = share * slope.get(part, 0.0)
        return {name: slope.get(self._formula.events[name], 0.0) for name in self.support()}

    def _values(self, chances: Chances, *, above: bool = False) -> dict[int, tuple[float, float]]:
        """Return the probabilities that each event, part and the root is true, and that it is false.

        Of what is truncated they are those of the function that bounds it from below, or an upper bound.
        """
        known = {FALSE: (0.0, 1.0), TRUE: (1.0, 0.0)}
        for name, event in self._formula.events.items():
            chance = chances.get(name, 0.0)
            known[event] = (chance, 1.0 - chance)
        for part, one in self._parts.items():
            bdd, root = one.above if above and one.above is not None else (one.bdd, one.root)
            true, false = _chances_of(bdd, root, one.leaves, known)
            known[part] = (true[root], false[root])
            if above and one.above is not None:
                least = min(known[part][0], sum_of_sets(one.sets, one.family, one.leaves, one.order, known))
                known[part] = (least, 1.0 - least)
        return known


class _Clock:
    """Counts the CPU time that is left."""

    def __init__(self, seconds: float) -> None:
        self._end = process_time() + seconds

    def expect_time(self) -> None:
        """Raise TooLargeError if none is left."""
        if process_time() > self._end:
            raise TooLargeError


def _solved(formula: Formula, part: Part, budgets: list[int], clock: _Clock) -> Solved:
    """Make the diagrams of a part; of the orders that fail within a budget, the half that came furthest goes on."""
    under_way: Iterable[_Building] = (_Building(formula, part, leaves) for leaves in orders(formula, part))
    with deep(len(part.leaves)):
        for budget in budgets:
            tried: list[_Building] = []
            for building in under_way:
                tried.append(building)
                with suppress(TooLargeError):
                    return building.go_on(budget, clock)
                clock.expect_time()
            tried.sort(key=lambda one: -one.gates)
            under_way = tried[: max(1, len(tried) // 2)]
    raise TooLargeError


class _Building:
    """The decision diagram of a part in one order of its leaves; `gates` tells how many gates it has come by."""

    def __init__(self, formula: Formula, part: Part, leaves: list[int]) -> None:
        self._formula, self._part, self._leaves = formula, part, tuple(leaves)
        self._bdd, self.gates = Bdd(len(leaves) + 2), 0
        self._value = {leaf: self._bdd.node(index, FALSE, TRUE) for index, leaf in enumerate(leaves)}

    def go_on(self, most_nodes: int, clock: _Clock) -> Solved:
        """Make the diagram of the whole part, and its sets; raises TooLargeError, and can go on with more nodes."""
        self._bdd.allow(most_nodes)
        least, inputs, value = self._formula.least, self._formula.inputs, self._value
        for gate in self._part.gates[self.gates :]:
            value[gate] = self._bdd.at_least(least[gate], [value[one] for one in inputs[gate]])
            self.gates += 1
            if self.gates % _GATES_BETWEEN_LOOKS == 0:
                clock.expect_time()
        root = value[self._part.root]
        sets, family = minimal_cut_sets(self._bdd, root, 2 * most_nodes)
        self._bdd.forget()
        sets.forget()
        return Solved(self._part, self._leaves, self._bdd, root, sets, family)


def _asked(one: Solved) -> Iterator[int]:
    """Yield the leaves on which the value of a part really depends; of a truncated one, all."""
    if one.order is not None or one.above is not None:
        yield from one.leaves
        return
    for variable in sorted({one.sets.variable[node] for node in one.sets.below(one.family)}):
        yield one.leaves[variable]


def _depth(parts: Mapping[int, Solved]) -> int:
    return 4 * sum(len(one.leaves) + 1 for one in parts.values())


def _product(one: list[int], other: list[int]) -> list[int]:
    if not one or not other:
        return []
    found = [0] * (len(one) + len(other) - 1)
    for i, of_one in enumerate(one):
        if of_one:
            for j, of_other in enumerate(other):
                found[i + j] += of_one * of_other
    return found


def _sum(one: list[int], other: list[int]) -> list[int]:
    longer, shorter = (one, other) if len(one) >= len(other) else (other, one)
    return [number + (shorter[i] if i < len(shorter) else 0) for i, number in enumerate(longer)]


class _Listing:
    """Lists the sets of each size; of the sets of a node and a size it makes at most `most`."""

    def __init__(self, parts: Mapping[int, Solved], counts: Mapping[int, Mapping[int, list[int]]], most: int) -> None:
        self._parts, self._counts, self._most = parts, counts, most
        self._known: dict[tuple[int, int, int], list[tuple[int, ...]]] = {}

    def of(self, leaf: int, size: int) -> list[tuple[int, ...]]:
        """List the sets of an event, a constant or a part."""
        if leaf in self._parts:
            return self._below(leaf, self._parts[leaf].family, size)
        return [() if leaf == TRUE else (leaf,)]

    def _below(self, part: int, node: int, size: int) -> list[tuple[int, ...]]:
        counts = self._counts[part][node]
        if size >= len(counts) or not counts[size]:
            return []
        if node == TRUE:
            return [()]
        key = (part, node, size)
        found = self._known.get(key)
        if found is None:
            one = self._parts[part]
            found = self._below(part, one.sets.low[node], size)
            if len(found) < self._most:
                found = found + self._with(part, one, node, size)[: self._most - len(found)]
            self._known[key] = found
        return found

    def _with(self, part: int, one: Solved, node: int, size: int) -> list[tuple[int, ...]]:
        leaf, high = one.leaves[one.sets.variable[node]], one.sets.high[node]
        if leaf not in self._parts:
            return [(leaf, *rest) for rest in self._below(part, high, size - 1)]
        found: list[tuple[int, ...]] = []
        for own, number in enumerate(self._counts[leaf][self._parts[leaf].family]):
            if number and own <= size:
                rests = self._below(part, high, size - own)
                if rests:
                    found += [(*mine, *rest) for mine in self.of(leaf, own) for rest in rests]
                if len(found) >= self._most:
                    break
        return found


def _chances_of(
    bdd: Bdd, root: int, leaves: Sequence[int], known: Mapping[int, tuple[float, float]]
) -> tuple[dict[int, float], dict[int, float]]:
    """Return the probability of each node of a part's diagram that it is true, and that it is false."""
    true, false = {FALSE: 0.0, TRUE: 1.0}, {FALSE: 1.0, TRUE: 0.0}
    variable, low, high = bdd.variable, bdd.low, bdd.high
    of_leaf = [known[leaf] for leaf in leaves]
    for node in bdd.below(root):
        yes, no = of_leaf[variable[node]]
        if_true, if_false = high[node], low[node]
        true[node] = yes * true[if_true] + no * true[if_false]
        false[node] = yes * false[if_true] + no * false[if_false]
    return true, false


def _slopes(one: Solved, known: Mapping[int, tuple[float, float]]) -> dict[int, float]:
    """Give, for each leaf of a part, how the probability of the part grows with that of the leaf."""
    chance, _ = _chances_of(one.bdd, one.root, one.leaves, known)
    reached = dict.fromkeys(chance, 0.0)
    reached[one.root] = 1.0
    slopes = dict.fromkeys(one.leaves, 0.0)
    for node in reversed(one.bdd.below(one.root)):
        leaf = one.leaves[one.bdd.variable[node]]
        high, low = one.bdd.high[node], one.bdd.low[node]
        slopes[leaf] += reached[node] * (chance[high] - chance[low])
        true, false = known[leaf]
        reached[high] += reached[node] * true
        reached[low] += reached[node] * false
    return slopes
