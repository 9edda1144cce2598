"""Splits a formula into independent parts, so that each diagram stays small.

A gate is *independent* if what it depends on is read by nothing outside it. Then the formula knows it only by its
value, and it can be treated as one more event. A part is an independent gate with all that it depends on, down to
events and other independent gates. Parts share no event.

Independent gates are found by the times at which a search from the root comes by (Dutuit and Rauzy, A linear-time
algorithm to find modules of fault trees, 1996). Before that, a gate that reads only gates of its own kind takes over
their inputs, and inputs that share something with each other, but with nothing else, get a gate of their own.
"""

from collections import Counter
from dataclasses import dataclass

from heronry_tools.analysis.reliability.formula import LEAF, Formula


@dataclass(frozen=True, slots=True)
class Part:
    """An independent gate.

    root: the gate.
    gates: its gates, the root last, each after those that it reads.
    leaves: the events and the roots of other parts that it reads.
    """

    root: int
    gates: tuple[int, ...]
    leaves: tuple[int, ...]


def parts_of(formula: Formula, root: int) -> tuple[int, list[Part]]:
    """Split what a node depends on into parts, each after those that it reads; gives the root of the last one, too.

    The new root has the same value as `root`. A root that is an event or a constant has no parts.
    """
    root = _regrouped(formula, _flat(formula, root))
    if formula.least[root] == LEAF:
        return root, []
    visits = _Visits(formula, root)
    nodes = formula.below(root)
    independent = {node for node in nodes if formula.least[node] != LEAF and visits.encloses(node)} | {root}
    return root, [_part(formula, node, independent) for node in nodes if node in independent]


def _part(formula: Formula, root: int, independent: set[int]) -> Part:
    gates, leaves, waiting = {root}, dict[int, None](), [root]
    while waiting:
        for node in formula.inputs[waiting.pop()]:
            if node in independent or formula.least[node] == LEAF:
                leaves[node] = None
            elif node not in gates:
                gates.add(node)
                waiting.append(node)
    return Part(root, tuple(sorted(gates)), tuple(leaves))


def _kind(formula: Formula, node: int) -> str:
    least, count = formula.least[node], len(formula.inputs[node])
    return "or" if least == 1 else "and" if least == count and least != LEAF else "other"


def _flat(formula: Formula, root: int) -> int:
    """Let each OR take over the inputs of an OR that it alone reads, and likewise each AND."""
    nodes = formula.below(root)
    readers = Counter(one for node in nodes for one in formula.inputs[node])
    now: dict[int, int] = {}
    for node in nodes:
        if formula.least[node] == LEAF:
            now[node] = node
            continue
        kind, inputs = _kind(formula, node), list[int]()
        for one in formula.inputs[node]:
            new = now[one]
            same = kind != "other" and readers[one] == 1 and _kind(formula, new) == kind
            inputs += formula.inputs[new] if same else (new,)
        least = formula.least[node]
        now[node] = formula.all_of(inputs) if kind == "and" else formula.at_least(least, inputs)
    return now[root]


def _regrouped(formula: Formula, root: int) -> int:
    """Give a gate of their own to inputs of an OR or AND that share something, but with nothing outside."""
    visits = _Visits(formula, root)
    now: dict[int, int] = {}
    for node in formula.below(root):
        kind = _kind(formula, node)
        if formula.least[node] == LEAF or kind == "other":
            now[node] = formula.at_least(formula.least[node], [now[one] for one in formula.inputs[node]])
            if formula.least[node] == LEAF:
                now[node] = node
            continue
        join = formula.any_of if kind == "or" else formula.all_of
        groups = visits.groups(node)
        if len(groups) > 1:
            now[node] = join([join([now[one] for one in group]) for group in groups])
        else:
            now[node] = join([now[one] for one in formula.inputs[node]])
    return now[root]


class _Visits:
    """When a search from a root, depth first, comes by each node."""

    def __init__(self, formula: Formula, root: int) -> None:
        self._formula = formula
        self._first: dict[int, int] = {root: 0}
        self._left: dict[int, int] = {}
        last: dict[int, int] = {root: 0}
        clock, path = 0, [(root, iter(formula.inputs[root]))]
        while path:
            node, rest = path[-1]
            clock += 1
            one = next(rest, None)
            if one is None:
                self._left[node] = last[node] = clock
                path.pop()
            elif one in self._first:
                last[one] = clock
            else:
                self._first[one] = last[one] = clock
                path.append((one, iter(formula.inputs[one])))
        self._early, self._late = dict(self._first), last  # over all nodes below
        for node in formula.below(root):
            for one in formula.inputs[node]:
                self._early[node] = min(self._early[node], self._early[one])
                self._late[node] = max(self._late[node], self._late[one])
        self._last_below = {
            node: max((self._late[one] for one in formula.inputs[node]), default=0) for node in formula.below(root)
        }

    def encloses(self, node: int) -> bool:
        """Tell whether the search comes by what a gate depends on only between its first visit and its return."""
        early = min(self._early[one] for one in self._formula.inputs[node])
        return self._first[node] < early and self._last_below[node] < self._left[node]

    def groups(self, node: int) -> list[list[int]]:
        """Join those inputs of a gate of which the visits overlap; an input that is visited from elsewhere is alone."""
        inside: list[tuple[int, int, int]] = []
        groups: list[list[int]] = []
        for one in self._formula.inputs[node]:
            early, late = self._early[one], self._late[one]
            if self._first[node] < early and late < self._left[node]:
                inside.append((early, late, one))
            else:
                groups.append([one])
        end = -1
        for early, late, one in sorted(inside):
            if early <= end:
                groups[-1].append(one)
            else:
                groups.append([one])
            end = max(end, late)
        return groups
