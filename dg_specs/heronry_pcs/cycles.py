"""Finds component-cycles: the longest one of a graph, and whether it makes the graph cycle-bound.

The direction of edges does not count. A component-path is two or more different members, each a neighbor of the next. A
component-cycle is a path of three or more members whose last member is a neighbor of its first. A graph is
*cycle-bound* if it is component-connected and has a longest cycle such that every member is on that cycle, or on
another cycle that shares a member with it.

Every cycle lies in a *block*: a largest set of members that stays connected whichever one of them is removed. In a
block of three or more members, any two members lie on one cycle. Two blocks share at most one member. So a graph is
cycle-bound iff three conditions hold. The graph is connected. Each member is in a block of three or more. Some longest
cycle of the whole graph lies in a block that shares a member with every other block, and this cycle passes all of these
shared members.

To find a longest cycle is NP-hard. A `Search` finds bounds of the length for one block. `bounds_alone` gives bounds
without a search. These bounds suffice if the whole graph is one block, or if no block shares a member with every other
block.

Source: the paper that graph.py names, section 2.2. Differences: the paper's component-path is any connected set; here
two neighbors are no cycle; and the paper's "maximal length", read literally, is reached only by a cycle through all
members. A cycle-bound graph need not be controlled: A > B, A > C, B > C is cycle-bound, and nothing controls A.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass

from heronry_pcs.graph import Graph
from heronry_pcs.neighborhood import neighbors
from heronry_pcs.predicates import is_component_connected

Touching = Mapping[str, Collection[str]]
"""For each member of a block its neighbors in the block."""

Bounds = tuple[int, int]
"""The least and the greatest number of members that a longest cycle can have; (0, 0) if there is no cycle."""

Search = Callable[[Touching, frozenset[str]], Bounds]
"""Finds bounds of a longest cycle in a block, among the cycles that pass all of the given members."""

LEAST_CYCLE = 3


def bounds_alone(block: Touching, through: frozenset[str]) -> Bounds:
    """Return bounds of the longest cycle that passes all of `through` in a block, without a search.

    By a theorem of Dirac (1952), a block of `size` members, each with d neighbors or more, has a cycle of at
    least min(size, 2 d) members. If such a cycle has all members of the block, it passes all of `through`.
    A shorter cycle need not pass them. Then only one thing is certain: any two members lie on one cycle, of
    three or more members. So the lower bound is 3 if `through` has one or two members, and 0 if it has more.
    """
    size = len(block)
    degrees = [len(touching) for touching in block.values()]
    certain = size if max(degrees) == 2 else min(size, 2 * min(degrees))
    if certain == size or not through:
        return certain, size
    return (LEAST_CYCLE if len(through) <= 2 else 0), size


@dataclass(frozen=True, slots=True)
class Cycles:
    """What is known of the component-cycles of a graph."""

    longest: Bounds
    cycle_bound: bool | None  # None: the search left it open


def cycles(graph: Graph, search: Search = bounds_alone) -> Cycles:
    """Find bounds of the length of a graph's longest component-cycle, and whether the graph is cycle-bound.

    search: finds the bounds for one block, where `bounds_alone` does not give the exact length.
    """
    touching = neighbors(graph)
    rings = [block for block in blocks(touching) if len(block) >= LEAST_CYCLE]
    found = [_searched(touching, ring, frozenset(), search) for ring in rings]
    longest = (max((least for least, _ in found), default=0), max((most for _, most in found), default=0))
    if not rings or not is_component_connected(graph) or set[str]().union(*rings) != graph.members.keys():
        return Cycles(longest, cycle_bound=False)
    if len(rings) == 1:
        return Cycles(longest, cycle_bound=True)
    return Cycles(longest, _bound(touching, rings, longest, search))


def _bound(touching: Touching, rings: list[set[str]], longest: Bounds, search: Search) -> bool | None:
    is_open = False
    for ring in rings:
        shared = [ring & other for other in rings if other is not ring]
        if not all(shared):
            continue
        least, most = _searched(touching, ring, frozenset[str]().union(*shared), search)
        if least >= longest[1]:
            return True
        is_open = is_open or most >= longest[0]
    return None if is_open else False


def _searched(touching: Touching, ring: set[str], through: frozenset[str], search: Search) -> Bounds:
    block = {name: sorted(ring.intersection(touching[name])) for name in sorted(ring)}
    least, most = bounds_alone(block, through)
    return (least, most) if least == most else search(block, through)


def blocks(touching: Touching) -> list[set[str]]:
    """Return the blocks of a graph of neighbors (Hopcroft and Tarjan 1973), each as the set of its members.

    A member without neighbors is in no block.
    """
    return _Blocks(touching).found()


class _Blocks:
    """One search for the blocks of a graph, by the algorithm of Hopcroft and Tarjan without recursion.

    `path` in `_walk` replaces the stack of calls.
    """

    def __init__(self, touching: Touching) -> None:
        self._touching = touching
        self._entered: dict[str, int] = {}
        self._low: dict[str, int] = {}  # the earliest entered member that a member leads back to
        self._open: list[str] = []  # entered members that may still belong to a block that is not closed yet
        self._found: list[set[str]] = []

    def found(self) -> list[set[str]]:
        for name in self._touching:
            if name not in self._entered:
                self._walk(name)
        return self._found

    def _walk(self, root: str) -> None:
        path = [self._enter(root)]
        while path:
            name, left = path[-1]
            new = self._next_new(name, left)
            if new is not None:
                path.append(self._enter(new))
                continue
            path.pop()
            if path:
                self._leave(path[-1][0], name)
        self._open.clear()

    def _enter(self, name: str) -> tuple[str, Iterator[str]]:
        self._entered[name] = self._low[name] = len(self._entered)
        self._open.append(name)
        return name, iter(sorted(self._touching[name]))

    def _next_new(self, name: str, left: Iterator[str]) -> str | None:
        for other in left:
            if other not in self._entered:
                return other
            self._low[name] = min(self._low[name], self._entered[other])
        return None

    def _leave(self, above: str, name: str) -> None:
        """Go back from the member `name` to `above`, the member from which `name` was entered.

        If neither `name` nor a member entered after `name` leads back to a member entered before `above`, a block is
        complete: `above`, `name`, and the open members that were entered after `name`.
        """
        self._low[above] = min(self._low[above], self._low[name])
        if self._low[name] >= self._entered[above]:
            block = {above}
            while name not in block:
                block.add(self._open.pop())
            self._found.append(block)
