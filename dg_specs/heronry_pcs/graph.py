"""Component graphs as values: leaves, vertices, edges, and components that hold components.

A *space* is a set of leaves, each with ports. A vertex is `leaf.port`, split at the first dot; its *parent* is the
leaf. An edge is an ordered pair of vertices of the space. A graph is (V, E, C): vertices V, edges E (whose ends may lie
outside V) and names of members C. A member is a (V, E, C) as well. A member that is a leaf is (its ports, {}, {}); a
composite states its own V, E and C. This file does not check whether a graph makes sense; predicates.py does.

A graph of this module has no unknown names: each name in C is a leaf or a composite, and each vertex is a port of a
leaf of the space. Graphs are immutable; an operation gives another graph.

Source: Ippolito et al., "Polymorphic Control Reconfiguration in an Autonomous UAV with UGV Collaboration", section 2.2.
Differences: in the paper a vertex has a unique parent, although the paper also contracts components. Here the parent of
a vertex is its leaf, whatever members hold the vertex. Where the paper writes "G is a subgraph of G'", it means that G'
is a subgraph of G in the sense of this file.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from heronry_wire.errors import HeronryError
from heronry_wire.spelling import meant

Edge = tuple[str, str]
"""An edge: its initial vertex and its terminal vertex, init(e) and ter(e) in the paper that the file's head names."""


class PcsError(HeronryError, ValueError):
    """An operation cannot be applied.

    error: the kind of error and the name that it concerns, such as `needs:configuration` or `unknown:Kimu`.
    known: the names that exist; the message suggests one of these names, or lists them.
    is_unknown: True for `unknown:X`: the operation names X, which does not exist.
    """

    def __init__(self, error: str, known: Iterable[str] = ()) -> None:
        self.error = error
        self.is_unknown = error.startswith("unknown:")
        super().__init__(_explained(error, known))


def _explained(error: str, known: Iterable[str]) -> str:
    kind, _, name = error.partition(":")
    match kind:
        case "needs":
            return f"{_NEEDS[name]}; 'heronry pcs check' shows what holds of a graph"
        case "unknown":
            return f"there is no '{name}' here; {meant(name, sorted(known))}"
        case "sides":
            return (
                f"a cut needs leaves pinned to exactly two sides; here they are pinned to {', '.join(known) or 'none'}"
            )
        case "clash":
            return f"the name '{name}' stands for two different components"
        case _:
            return _SENTENCES[kind]


_NEEDS: Mapping[str, str] = {  # a predicate (predicates.py) -> what is wrong where it does not hold
    "component_graph": "a member of the graph is no component",
    "edge_contained": "an edge of the graph ends in a vertex that the graph does not have",
    "whole": "the graph, or a member, has some ports of a leaf and lacks others",
    "nested": "two members of the graph share a vertex, and neither is among the components of the other",
    "disjoint": "a vertex of the graph is in no member, or in more than one",
    "pruned": "an edge of the graph does not lead from one member to another",
    "component_connected": "no path joins all members of the graph",
    "configuration": "the graph is not a configuration, and this operation works on configurations alone",
    "vertex": "the graph has no vertex to which the other graph could be joined",
    "leaves": "the vertices of the graph are not exactly the ports of its leaves",
}
_SENTENCES: Mapping[str, str] = {
    "view": "these members are no view: they share a vertex, or do not have all vertices together",
    "contracted": "the view has no members inside this component that have all of its vertices",
    "leaf": "this member has no components to expand it to",
    "uncovered": "the components of this member do not have all of its vertices",
    "edge_apart": "no end of the edge is where it would join the graph",
    "edge_outside": "an end of the edge is not in the graph",
    "edge_inside": "one member holds both ends of the edge",
    "leaves": "the vertices are not exactly the ports of the leaves among the members",
}


@dataclass(frozen=True, slots=True)
class Leaf:
    """A component without components: a running module, a device, or a part of the physical world."""

    name: str
    ports: Mapping[str, int]  # port -> weight in thousandths of a bit/s
    image: str  # its code
    plant: bool = False  # a part of the physical world
    side: str | None = None  # the side of a cut on which it has to stay; None: either side

    def vertices(self) -> frozenset[str]:
        """The vertices of this leaf: one for each port, named `LEAF.PORT`."""
        return frozenset(f"{self.name}.{port}" for port in self.ports)


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a component graph: its vertices, its edges and the names of its components, (V, E, C)."""

    vertices: frozenset[str] = frozenset()
    edges: frozenset[Edge] = frozenset()
    components: frozenset[str] = frozenset()

    def has_subgraph(self, other: "Part") -> bool:
        """Tell whether this part has all vertices, edges and components of the part `other`."""
        return other.vertices <= self.vertices and other.edges <= self.edges and other.components <= self.components


@dataclass(frozen=True)
class Graph:
    """A component graph, with all leaves and composites to which its vertices and members may refer.

    leaves: the *space*, that is, all leaves, also those that the graph does not have; in the order of the file.
    composites: all components that have components inside, by name.
    own: the vertices, the edges and the names of the members of the graph.
    """

    name: str
    leaves: Mapping[str, Leaf]  # the space, in the order of the file
    composites: Mapping[str, Part] = field(default_factory=dict)
    own: Part = Part()

    @property
    def vertices(self) -> frozenset[str]:
        """The vertices V of the graph."""
        return self.own.vertices

    @property
    def edges(self) -> frozenset[Edge]:
        """The edges E of the graph."""
        return self.own.edges

    @cached_property
    def members(self) -> Mapping[str, Part]:
        """The members of the graph (the set C), by name, in the order of names."""
        return {name: self.part(name) for name in sorted(self.own.components)}

    @cached_property
    def holders(self) -> Mapping[str, tuple[str, ...]]:
        """The members that hold a vertex, by vertex, in the order of names; a vertex in no member is left out."""
        found: dict[str, list[str]] = {}
        for name, member in self.members.items():
            for vertex in member.vertices:
                found.setdefault(vertex, []).append(name)
        return {vertex: tuple(names) for vertex, names in found.items()}

    @cached_property
    def space(self) -> frozenset[str]:
        """All vertices of the space, whether the graph has them or not."""
        return frozenset(vertex for leaf in self.leaves.values() for vertex in leaf.vertices())

    def part(self, name: str) -> Part:
        """Return the leaf or the composite with the name `name`, as its vertices, edges and components."""
        leaf = self.leaves.get(name)
        return self.composites[name] if leaf is None else Part(leaf.vertices())

    def of(self, vertices: frozenset[str], edges: frozenset[Edge], components: frozenset[str]) -> "Graph":
        """Return a graph with these vertices, edges and members, and with the leaves and composites of this graph."""
        return replace(self, own=Part(vertices, edges, components))


def parent(vertex: str) -> str:
    """Name of the leaf that a vertex belongs to."""
    return vertex.partition(".")[0]


def inside(edges: Iterable[Edge], vertices: frozenset[str]) -> frozenset[Edge]:
    """Return those of the edges that have both ends among these vertices."""
    return frozenset(edge for edge in edges if edge[0] in vertices and edge[1] in vertices)
