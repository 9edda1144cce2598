"""Finds loops in a graph: paths along which a signal returns to its origin. The direction of edges counts.

The *home* of a vertex is the smallest member that holds the vertex: the one with the fewest vertices, then the fewest
components, then the first by name. The home of a vertex that no member holds is its leaf. Edges lead from home to home,
and a *loop* is a set of two or more homes that all reach one another. The largest loops are the strongly connected
components of two or more homes. Each loop lies in one of the largest loops, which are what `loops` gives.

A member is *on a loop* if some loop has a home within the member's vertices and another home outside: the signal leaves
the member and returns. A plant is a part of the physical world. A plant is *on a path* if some loop leads through it
and through a home that is no plant: a controller acts on the plant and sees the effect. A *control path* of some
members is one loop with a home within each of them.

Source: the paper that graph.py names, section 3.4 ("a control path that includes the components"); the paper does not
define a loop. The paper's component-cycles (cycles.py) ignore the direction of edges: A > B, A > C, B > C is a
component-cycle, but no loop.
"""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from heronry_dg.cycles import components
from heronry_pcs.graph import Graph, parent


@dataclass(frozen=True, slots=True)
class Loops:
    """The largest loops of a graph; every loop lies in one of them."""

    found: tuple[frozenset[str], ...]  # homes: names of members or of leaves
    _controlling: frozenset[int]  # numbers of the loops with a home that is no plant
    _homes_at: Mapping[str, list[tuple[int, frozenset[str]]]]  # by vertex: loop and vertices of a home that holds it

    def through(self, vertices: frozenset[str]) -> bool:
        """Tell whether some loop has a home within these vertices, and another one that is not."""
        return any(count < len(self.found[loop]) for loop, count in self._within(vertices).items())

    def control(self, vertices: frozenset[str]) -> bool:
        """Tell whether some loop has a home (a member or a leaf) within a plant, and another home that is no plant.

        vertices: the vertices of the plant.
        """
        return not self._controlling.isdisjoint(self._within(vertices))

    def join(self, members: Collection[frozenset[str]]) -> bool:
        """Tell whether one loop goes through all of these members: each member contains a home of this loop.

        members: the vertices of each member.
        """
        joined = set(range(len(self.found)))
        for vertices in members:
            joined.intersection_update(self._within(vertices))
        return bool(joined)

    def _within(self, vertices: frozenset[str]) -> Counter[int]:
        """Count, by number of a loop, its homes (see head) that lie within these vertices."""
        near = {home for vertex in vertices for home in self._homes_at.get(vertex, ())}
        return Counter(loop for loop, home in near if home <= vertices)


def is_plant(graph: Graph, name: str) -> bool:
    """Tell whether a leaf or composite consists of plants only.

    This is so if it has vertices, and each vertex belongs to a leaf that is a part of the physical world.
    """
    leaves = {parent(vertex) for vertex in graph.part(name).vertices}
    return bool(leaves) and all(graph.leaves[leaf].plant for leaf in leaves)


def home(graph: Graph, vertex: str) -> str:
    """Return the name of the smallest member of the graph (a leaf or composite) that holds a vertex.

    If no member holds the vertex, give the name of the leaf to which the vertex belongs.
    """
    holders = graph.holders.get(vertex)
    if holders is None:
        return parent(vertex)
    return min(holders, key=lambda name: (*_size(graph, name), name))


def _size(graph: Graph, name: str) -> tuple[int, int]:
    member = graph.members[name]
    return len(member.vertices), len(member.components)


def loops(graph: Graph) -> Loops:
    """Find the largest loops of a graph: every loop lies in one of them, and none of them lies in another loop."""
    leads: dict[str, dict[str, None]] = {}
    homes: dict[str, str] = {}
    for edge in sorted(graph.edges):
        start, end = (homes.setdefault(vertex, home(graph, vertex)) for vertex in edge)
        leads.setdefault(start, {})[end] = None
        leads.setdefault(end, {})
    found = tuple(frozenset(loop) for loop in components({k: list(v) for k, v in leads.items()}) if len(loop) > 1)
    at: dict[str, list[tuple[int, frozenset[str]]]] = {}
    for number, loop in enumerate(found):
        for one in loop:
            vertices = graph.part(one).vertices
            for vertex in vertices:
                at.setdefault(vertex, []).append((number, vertices))
    controlling = frozenset(
        number for number, loop in enumerate(found) if not all(is_plant(graph, one) for one in loop)
    )
    return Loops(found, controlling, at)
