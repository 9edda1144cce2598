"""Loops: where a signal comes back to where it came from. Here the direction of edges counts.

The *home* of a vertex is the smallest member that holds it: the one with the fewest vertices, then the fewest
components, then the first by name; a vertex that no member holds has its leaf for a home. Edges lead from home to home,
and a *loop* is a set of two or more homes that all reach one another. So each loop lies in a strongly connected
component of the homes, and that component is itself the largest loop in it: these are what `loops` gives.

A member is on a loop if some loop has a home within its vertices, and another one that is not: the signal leaves it and
returns. A plant, which is a part of the physical world, is on a path if some loop leads through it and through
something that is no plant: a controller acts on it and sees the effect. A control path of some members is one loop
with a home within each of them.

Source: the paper, section 3.4 ("a control path that includes the components"), which defines no loop; its
component-cycles ignore direction (cycles.py), so that three components which feed one another forward are one.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from heronry_dg.cycles import components
from heronry_pcs.graph import Graph, parent


@dataclass(frozen=True, slots=True)
class Loops:
    """The largest loops of a graph; every loop lies in one of them."""

    graph: Graph
    found: tuple[frozenset[str], ...]  # homes: names of members or of leaves
    _loops_at: Mapping[str, tuple[int, ...]]  # by vertex of a home on a loop

    def through(self, vertices: frozenset[str]) -> bool:
        """Tell whether some loop has a home within these vertices and one that is not."""
        return any(any(not self._is_within(home, vertices) for home in loop) for loop in self._loops_within(vertices))

    def control(self, vertices: frozenset[str]) -> bool:
        """Tell whether some loop has a home within these vertices, of a plant, and one that is no plant."""
        return any(any(not is_plant(self.graph, home) for home in loop) for loop in self._loops_within(vertices))

    def join(self, members: Collection[frozenset[str]]) -> bool:
        """Tell whether one loop has a home within the vertices of each of some members."""
        return any(
            all(any(self._is_within(home, vertices) for home in loop) for vertices in members) for loop in self.found
        )

    def _loops_within(self, vertices: frozenset[str]) -> list[frozenset[str]]:
        near = {number for vertex in vertices for number in self._loops_at.get(vertex, ())}
        loops = [self.found[number] for number in sorted(near)]
        return [loop for loop in loops if any(self._is_within(home, vertices) for home in loop)]

    def _is_within(self, home: str, vertices: frozenset[str]) -> bool:
        return self.graph.part(home).vertices <= vertices


def is_plant(graph: Graph, name: str) -> bool:
    """Tell whether a member has vertices, all of leaves that are parts of the physical world."""
    leaves = {parent(vertex) for vertex in graph.part(name).vertices}
    return bool(leaves) and all(graph.leaves[leaf].plant for leaf in leaves)


def home(graph: Graph, vertex: str) -> str:
    """Name of the smallest member that holds a vertex; of its leaf where none does."""
    holders = graph.holders.get(vertex)
    if holders is None:
        return parent(vertex)
    return min(holders, key=lambda name: (*_size(graph, name), name))


def _size(graph: Graph, name: str) -> tuple[int, int]:
    member = graph.members[name]
    return len(member.vertices), len(member.components)


def loops(graph: Graph) -> Loops:
    """Find the largest loops of a graph."""
    leads: dict[str, dict[str, None]] = {}
    homes: dict[str, str] = {}
    for edge in sorted(graph.edges):
        start, end = (homes.setdefault(vertex, home(graph, vertex)) for vertex in edge)
        leads.setdefault(start, {})[end] = None
        leads.setdefault(end, {})
    found = tuple(frozenset(loop) for loop in components({k: list(v) for k, v in leads.items()}) if len(loop) > 1)
    at: dict[str, list[int]] = {}
    for number, loop in enumerate(found):
        for one in loop:
            for vertex in graph.part(one).vertices:
                at.setdefault(vertex, []).append(number)
    return Loops(graph, found, {vertex: tuple(numbers) for vertex, numbers in at.items()})
