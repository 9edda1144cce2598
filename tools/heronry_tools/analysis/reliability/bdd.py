"""Binary decision diagrams of monotone functions, and the families of their minimal cut sets.

A *decision diagram* (BDD) is a directed graph whose inner nodes ask whether a variable is true. Variables are numbers,
and smaller ones are asked first. Two edges leave a node, `low` where the variable is false and `high` where it is true.
A node with equal edges, or one that exists already, is not made. So a function has one diagram in a given order.

A *zero-suppressed diagram* (ZBDD) has the same form, and stands for a family of sets: a path to 1 is the set of the
variables where it takes `high`. A node whose `high` is 0 is not made.

`minimal_cut_sets` makes the second of the first: the smallest sets of variables that make a monotone function true
(Rauzy, New algorithms for fault trees analysis, 1993). A set of `high` that contains a set of `low` is not minimal.

The functions here recurse once for each variable at most. `deep` raises Python's limit for that; since Python 3.11 a
call of a Python function takes no space on the stack of C.
"""

import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from heronry_tools.analysis.reliability.formula import FALSE, TRUE, TooLargeError

LAST: Final = 1 << 30  # the variable of the two ends: after all others
_SHIFT: Final = 26  # bits of a node's number in a key; so a diagram has less than 2^26 nodes
_FRAMES: Final = 2_000  # frames that callers and other code may use
_KNOWN_FOR_EACH_NODE: Final = 4  # results of operations that a pool may keep for each node that it may have
_KNOWN_BETWEEN_GATES: Final = 1_000  # results of an operation that are kept from one gate to the next


@contextmanager
def deep(variables: int) -> Iterator[None]:
    """Allow functions to recurse once or twice for each of so many variables."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, 3 * variables + _FRAMES))
    try:
        yield
    finally:
        sys.setrecursionlimit(before)


class Diagram:
    """A pool of nodes; number 0 is false (the empty family), number 1 true (the family of the empty set)."""

    def __init__(self, most_nodes: int) -> None:
        """Make a pool of at most `most_nodes` nodes; one beyond that raises TooLargeError."""
        self.variable: list[int] = [LAST, LAST]
        self.low: list[int] = [0, 1]
        self.high: list[int] = [0, 1]
        self.made: defaultdict[int, dict[int, int]] = defaultdict(dict)  # nodes by variable, and by their two edges
        self._below: dict[int, list[int]] = {}  # what is below a node never changes
        self._known: list[dict[int, int]] = []  # results of operations, by operation
        self.allow(most_nodes)

    def __len__(self) -> int:
        return len(self.variable)

    def allow(self, most_nodes: int) -> None:
        """Change the limit; what was broken off by TooLargeError can then be begun once more, and goes on."""
        self.most_nodes = min(most_nodes, (1 << _SHIFT) - 1)
        self.most_known = _KNOWN_FOR_EACH_NODE * self.most_nodes

    def forget(self) -> None:
        """Free what only making more nodes needs; none may be made afterwards."""
        self.made.clear()
        for known in self._known:
            known.clear()

    def _remembered(self) -> dict[int, int]:
        self._known.append({})
        return self._known[-1]

    def _node(self, variable: int, low: int, high: int) -> int:
        made, key = self.made[variable], high << _SHIFT | low
        node = made.get(key)
        if node is None:
            node = len(self.variable)
            if node >= self.most_nodes:
                raise TooLargeError
            made[key] = node
            self.variable.append(variable)
            self.low.append(low)
            self.high.append(high)
        return node

    def below(self, root: int) -> list[int]:
        """Return the inner nodes below a node, itself included, each after those to which its edges lead."""
        found = self._below.get(root)
        if found is None:
            found = self._below[root] = self._found_below(root)
        return found

    def _found_below(self, root: int) -> list[int]:
        seen, waiting = {FALSE, TRUE, root}, [root]
        low, high = self.low, self.high
        while waiting:
            node = waiting.pop()
            for one in (low[node], high[node]):
                if one not in seen:
                    seen.add(one)
                    waiting.append(one)
        return sorted(seen - {FALSE, TRUE})


class Bdd(Diagram):
    """A pool of decision diagrams."""

    def __init__(self, most_nodes: int) -> None:
        """Make a pool of at most `most_nodes` nodes; one beyond that raises TooLargeError."""
        super().__init__(most_nodes)
        self.either = self._operation(FALSE, TRUE)
        self.both = self._operation(TRUE, FALSE)

    def node(self, variable: int, low: int, high: int) -> int:
        """Return the node that asks `variable`."""
        return low if low == high else self._node(variable, low, high)

    def at_least(self, least: int, inputs: Sequence[int]) -> int:
        """Return the function that is true iff at least `least` of the inputs are."""
        ordered = sorted(inputs, key=lambda one: -self.variable[one])  # the deepest first: little is made anew
        found = counted(least, ordered, self.either, self.both)
        for known in self._known:  # gates have few results in common, and a small table is a fast one
            if len(known) > _KNOWN_BETWEEN_GATES:
                known.clear()
        return found

    def _operation(self, neutral: int, absorbing: int) -> Callable[[int, int], int]:
        """Make OR (neutral FALSE, absorbing TRUE) or AND (the other way round) of two diagrams."""
        variable, lows, highs, made, known = self.variable, self.low, self.high, self.made, self._remembered()

        def joined(one: int, other: int) -> int:
            if one > other:
                one, other = other, one
            if one <= TRUE:
                return other if one == neutral else absorbing
            if one == other:
                return one
            key = one << _SHIFT | other
            node = known.get(key)
            if node is not None:
                return node
            asked, of_other = variable[one], variable[other]
            if asked < of_other:
                high, low = joined(highs[one], other), joined(lows[one], other)
            elif asked == of_other:
                high, low = joined(highs[one], highs[other]), joined(lows[one], lows[other])
            else:
                asked = of_other
                high, low = joined(one, highs[other]), joined(one, lows[other])
            if high == low:
                node = high
            else:  # as `_node`, without a call: this is where the time goes
                of_variable, edges = made[asked], high << _SHIFT | low
                node = of_variable.get(edges)
                if node is None:
                    node = len(variable)
                    if node >= self.most_nodes or len(known) > self.most_known:
                        raise TooLargeError
                    of_variable[edges] = node
                    variable.append(asked)
                    lows.append(low)
                    highs.append(high)
            known[key] = node
            return node

        return joined


class Zbdd(Diagram):
    """A pool of families of sets, none of which contains another set of its family."""

    def __init__(self, most_nodes: int) -> None:
        """Make a pool of at most `most_nodes` nodes; one beyond that raises TooLargeError."""
        super().__init__(most_nodes)
        self.without = self._without()

    def node(self, variable: int, low: int, high: int) -> int:
        """Return the family of the sets of `low`, and those of `high` with `variable` added."""
        return low if high == FALSE else self._node(variable, low, high)

    def _without(self) -> Callable[[int, int], int]:
        variable, lows, highs, node, known = self.variable, self.low, self.high, self.node, self._remembered()

        def without(family: int, other: int) -> int:
            """Return the sets of a family that contain no set of the other."""
            if FALSE in (family, other):
                return family
            if other in (TRUE, family):
                return FALSE
            if family == TRUE:
                return TRUE
            key = family << _SHIFT | other
            found = known.get(key)
            if found is not None:
                return found
            asked, of_other = variable[family], variable[other]
            if asked > of_other:
                found = without(family, lows[other])
            elif asked < of_other:
                found = node(asked, without(lows[family], other), without(highs[family], other))
            else:
                low, high = lows[other], highs[other]
                rest = without(highs[family], high)
                found = node(asked, without(lows[family], low), without(rest, low))
            if len(known) > self.most_known:
                raise TooLargeError
            known[key] = found
            return found

        return without


def counted(
    least: int, inputs: Sequence[int], either: Callable[[int, int], int], both: Callable[[int, int], int]
) -> int:
    """Return what is true iff at least `least` of the inputs are."""
    held = [TRUE] + [FALSE] * least  # at least 0, 1, ... of the inputs so far
    for number, one in enumerate(inputs, 1):
        for count in range(min(least, number), max(0, least - 1 - len(inputs) + number), -1):
            held[count] = either(held[count], both(one, held[count - 1]))
    return held[least]


def minimal_cut_sets(bdd: Bdd, root: int, most_nodes: int) -> tuple[Zbdd, int]:
    """Return the family of the minimal sets of variables that make a monotone function true."""
    sets = Zbdd(most_nodes)
    family = {FALSE: FALSE, TRUE: TRUE}
    for node in bdd.below(root):
        low, high = family[bdd.low[node]], family[bdd.high[node]]
        family[node] = sets.node(bdd.variable[node], low, sets.without(high, low))
    return sets, family[root]
