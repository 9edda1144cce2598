"""What stands for a part whose exact diagram is too large: its sets up to an order, and two diagrams that bound it.

*Sets to an order N.* Families of sets are combined gate by gate, and a set of more than N leaves is dropped as soon as
it is made. What is dropped could only grow, so the family has all minimal sets of up to N leaves, and no others.

*Bounds.* Decision diagrams are combined gate by gate, and one that grows too large is cut: nodes that are reached
least likely become false, which gives a function that is never true where the part is false; or they become true, which
gives one that is never false where the part is true. AND and OR of such functions are such functions, too. So the
probability of the first is a lower bound, and that of the second an upper bound, whatever the probabilities are. Those
with which the nodes are chosen only decide how close the bounds are. There is a second upper bound: the probabilities
of all sets of up to N leaves, added up, and the probability that more than N leaves are true. The lower one is taken.
"""

from collections.abc import Mapping, Sequence, Sized
from typing import Final

from heronry_tools.analysis.reliability.bdd import Bdd, Zbdd, counted, deep
from heronry_tools.analysis.reliability.formula import FALSE, TRUE, Formula, TooLargeError
from heronry_tools.analysis.reliability.parts import Part

_SET_NODES: Final = 100_000  # of the families of one order
_BOUND_NODES: Final = 200_000  # of all diagrams of a bound
_KEPT: Final = (3_000, 1_000, 500, 100, 10, 1)  # nodes that one diagram of a bound may have; at last it is a constant
_NEVER: Final = 1 << 30  # the size of the smallest set where there is none

Known = Mapping[int, tuple[float, float]]
"""Of each leaf, the probability that it is true, and that it is false."""


class ShortSets(Zbdd):
    """A pool of families of minimal sets of up to some size."""

    def __init__(self, most_nodes: int) -> None:
        """Make a pool of at most `most_nodes` nodes; one beyond that raises TooLargeError."""
        super().__init__(most_nodes)
        self._shortest, self._longest = [_NEVER, 0], [0, 0]
        self._joined: dict[tuple[int, int], int] = {}
        self._crossed: dict[tuple[int, int, int], int] = {}
        self.dropped = False

    def node(self, variable: int, low: int, high: int) -> int:
        """Return the family of the sets of `low`, and those of `high` with `variable` added."""
        node = super().node(variable, low, high)
        if node == len(self._shortest):
            self._shortest.append(min(self._shortest[low], self._shortest[high] + 1))
            self._longest.append(max(self._longest[low], self._longest[high] + 1))
        return node

    def either(self, one: int, other: int) -> int:
        """Return the minimal sets of two families."""
        if other in {one, FALSE}:
            return one
        if one == FALSE:
            return other
        if TRUE in (one, other):
            return TRUE
        key = (one, other) if one < other else (other, one)
        found = self._joined.get(key)
        if found is None:
            self._require_room(self._joined)
            variable = min(self.variable[one], self.variable[other])
            (low, high), (its_low, its_high) = self._split(one, variable), self._split(other, variable)
            rest = self.either(low, its_low)
            found = self.node(variable, rest, self.without(self.either(high, its_high), rest))
            self._joined[key] = found
        return found

    def both(self, one: int, other: int, most: int) -> int:
        """Return the minimal unions, of up to `most` members, of a set of one family and one of the other."""
        if max(self._shortest[one], self._shortest[other]) > most:
            self.dropped |= FALSE not in (one, other)
            return FALSE
        most = min(most, self._longest[one] + self._longest[other])
        if one == other or TRUE in (one, other):
            one = other = max(one, other)
            if self._longest[one] <= most:
                return one
        key = (min(one, other), max(one, other), most)
        found = self._crossed.get(key)
        if found is None:
            self._require_room(self._crossed)
            variable = min(self.variable[one], self.variable[other])
            (low, high), (its_low, its_high) = self._split(one, variable), self._split(other, variable)
            rest = self.both(low, its_low, most)
            wider = self.either(its_high, its_low)
            with_it = self.either(self.both(high, wider, most - 1), self.both(low, its_high, most - 1))
            found = self.node(variable, rest, self.without(with_it, rest))
            self._crossed[key] = found
        return found

    def _split(self, family: int, variable: int) -> tuple[int, int]:
        same = self.variable[family] == variable
        return (self.low[family], self.high[family]) if same else (family, FALSE)

    def _require_room(self, known: Sized) -> None:
        if len(known) > 4 * self.most_nodes:
            raise TooLargeError


def sets_to_order(formula: Formula, part: Part, leaves: Sequence[int]) -> tuple[ShortSets, int, int | None]:
    """Return the minimal sets of a part up to the largest order that fits, and that order; None: every order."""
    found, order = (ShortSets(2), FALSE), 0
    with deep(4 * len(leaves)):
        while order < len(leaves):
            sets = ShortSets(_SET_NODES)
            try:
                family = _short(formula, part, leaves, sets, order + 1)
            except TooLargeError:
                return (*found, order)
            found, order = (sets, family), order + 1
            if not sets.dropped:
                break
    return (*found, None)


def _short(formula: Formula, part: Part, leaves: Sequence[int], sets: ShortSets, order: int) -> int:
    value = {leaf: sets.node(index, FALSE, TRUE) for index, leaf in enumerate(leaves)}
    for gate in part.gates:
        inputs = [value[one] for one in formula.inputs[gate]]
        value[gate] = counted(formula.least[gate], inputs, sets.either, lambda a, b: sets.both(a, b, order))
    return value[part.root]


def bound(formula: Formula, part: Part, leaves: Sequence[int], known: Known, constant: int) -> tuple[Bdd, int]:
    """Return a diagram that bounds a part from below (`constant` FALSE) or from above (TRUE)."""
    with deep(len(leaves)):
        for kept in _KEPT:
            bounding = _Bounding(leaves, known, constant, kept)
            try:
                return bounding.of(formula, part)
            except TooLargeError:
                continue
    bdd = Bdd(2)
    return bdd, constant


class _Bounding:
    """Combines diagrams gate by gate, and cuts those with more than `kept` nodes."""

    def __init__(self, leaves: Sequence[int], known: Known, constant: int, kept: int) -> None:
        self._leaves, self._constant, self._kept = leaves, constant, kept
        self._chances = [known[leaf] for leaf in leaves]
        self._bdd = Bdd(_BOUND_NODES)

    def of(self, formula: Formula, part: Part) -> tuple[Bdd, int]:
        """Return the diagram that bounds a part; raises TooLargeError."""
        value = {leaf: self._bdd.node(index, FALSE, TRUE) for index, leaf in enumerate(self._leaves)}
        last = {one: gate for gate in part.gates for one in formula.inputs[gate]}  # the last gate that reads a node
        for gate in part.gates:
            inputs = sorted((value[one] for one in formula.inputs[gate]), key=lambda one: -self._bdd.variable[one])
            value[gate] = counted(formula.least[gate], inputs, self._either, self._both)
            value = {node: its for node, its in value.items() if node == part.root or last[node] > gate}
            if 3 * len(self._bdd) > self._bdd.most_nodes:
                value = self._moved(value)
        return self._bdd, value[part.root]

    def _either(self, one: int, other: int) -> int:
        return self._cut(self._bdd.either(one, other))

    def _both(self, one: int, other: int) -> int:
        return self._cut(self._bdd.both(one, other))

    def _cut(self, root: int) -> int:
        nodes = self._bdd.below(root) if root > TRUE else []
        if len(nodes) <= self._kept:
            return root
        weight = self._weights(root, nodes)
        kept = set(sorted(nodes, key=lambda node: -weight[node])[: self._kept // 2])
        now = {FALSE: FALSE, TRUE: TRUE}
        for node in nodes:
            low, high = now[self._bdd.low[node]], now[self._bdd.high[node]]
            now[node] = self._bdd.node(self._bdd.variable[node], low, high) if node in kept else self._constant
        return now[root]

    def _weights(self, root: int, nodes: list[int]) -> dict[int, float]:
        """Return how much the bound moves, at most, if a node becomes the constant."""
        variable, low, high = self._bdd.variable, self._bdd.low, self._bdd.high
        wrong = {FALSE: float(self._constant == TRUE), TRUE: float(self._constant == FALSE)}
        for node in nodes:
            true, false = self._chances[variable[node]]
            wrong[node] = true * wrong[high[node]] + false * wrong[low[node]]
        reached = dict.fromkeys(wrong, 0.0)
        reached[root] = 1.0
        for node in reversed(nodes):
            true, false = self._chances[variable[node]]
            reached[high[node]] += reached[node] * true
            reached[low[node]] += reached[node] * false
        return {node: reached[node] * wrong[node] for node in nodes}

    def _moved(self, value: dict[int, int]) -> dict[int, int]:
        """Move the diagrams that are still to be read to a new pool."""
        old, self._bdd = self._bdd, Bdd(_BOUND_NODES)
        now = {FALSE: FALSE, TRUE: TRUE}
        for node in sorted({one for root in value.values() if root > TRUE for one in old.below(root)}):
            now[node] = self._bdd.node(old.variable[node], now[old.low[node]], now[old.high[node]])
        return {one: now[root] for one, root in value.items()}


def sum_of_sets(sets: Zbdd, family: int, leaves: Sequence[int], order: int | None, known: Known) -> float:
    """Return the second upper bound; order: the largest of the family; None: it has every order."""
    total = {FALSE: 0.0, TRUE: 1.0}
    for node in sets.below(family):
        chance = known[leaves[sets.variable[node]]][0]
        total[node] = total[sets.low[node]] + chance * total[sets.high[node]]
    if order is None:
        return total[family]
    true = [1.0] + [0.0] * (order + 1)  # 0, 1, ... leaves are true; the last one: more than `order`
    for leaf in leaves:
        chance, never = known[leaf]
        true[-1] += true[-2] * chance
        for count in range(order, 0, -1):
            true[count] = true[count] * never + true[count - 1] * chance
        true[0] *= never
    return total[family] + true[-1]
