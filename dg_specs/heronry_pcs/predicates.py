"""Predicates: what holds of a component graph, and when a graph is a configuration.

    component_graph      for each member: `subgraph`: it is a subgraph of the graph; `edge_containment`: its edges end
                         in its vertices; `component_containment`: each of its components is a subgraph of it;
                         `monotonicity`: it is not among its own components; `vertex`: it has a vertex
    edge_contained       the edges of the graph end in its vertices
    whole                the graph, and each member, has all ports of a leaf or none
    nested               two members share no vertex, or one is among the other's components
    disjoint             each vertex is in exactly one member
    pruned               both ends of each edge are in members, and no member holds both
    component_connected  a component-path joins any two members
    configuration        all but `nested`, and there is a vertex

None of these depends on the direction of an edge. In a component-path, each member is a neighbor of the next one
(neighborhood.py).

Source: the paper that graph.py names, section 2.2: component (i)-(iv), edge contained, configuration graph (i)-(iv).
Differences: a member that a contraction has made has no edges and no components (views.py), and `whole` replaces the
paper's unique parent. By the paper's definition of a configuration graph, every member of a configuration would be a
leaf, and the graphs of the paper's own Figures 13 to 15 would be no configurations.
"""

from collections.abc import Callable, Iterator, Mapping
from itertools import combinations
from typing import Final

from heronry_pcs.graph import Graph, Part, PcsError, parent
from heronry_pcs.neighborhood import neighbors


def broken(graph: Graph) -> dict[str, list[str]]:
    """Return, by member, the constraints of `component_graph` (head of this file) that the member breaks.

    A member that breaks none is left out.
    """
    found = {name: list(_broken_by(graph, name, member)) for name, member in graph.members.items()}
    return {name: constraints for name, constraints in found.items() if constraints}


def _broken_by(graph: Graph, name: str, member: Part) -> Iterator[str]:
    if not graph.own.has_subgraph(member):
        yield "subgraph"
    if not _ends_inside(member):
        yield "edge_containment"
    if not all(member.has_subgraph(graph.part(one)) for one in member.components):
        yield "component_containment"
    if name in member.components:
        yield "monotonicity"
    if not member.vertices:
        yield "vertex"


def _ends_inside(part: Part) -> bool:
    return all(start in part.vertices and end in part.vertices for start, end in part.edges)


def is_component_graph(graph: Graph) -> bool:
    """Tell whether each member satisfies the five constraints of a component."""
    return not broken(graph)


def is_edge_contained(graph: Graph) -> bool:
    """Tell whether both ends of each edge of the graph are vertices of the graph."""
    return _ends_inside(graph.own)


def is_whole(graph: Graph) -> bool:
    """Tell whether the graph, and also each of its members, has of every leaf either all ports or none."""
    ports = {name: len(leaf.ports) for name, leaf in graph.leaves.items()}
    return all(_has_whole_leaves(part.vertices, ports) for part in (graph.own, *graph.members.values()))


def _has_whole_leaves(vertices: frozenset[str], ports: Mapping[str, int]) -> bool:
    counted: dict[str, int] = {}
    for vertex in vertices:
        leaf = parent(vertex)
        counted[leaf] = counted.get(leaf, 0) + 1
    return all(ports[leaf] == count for leaf, count in counted.items())


def is_nested(graph: Graph) -> bool:
    """Tell whether, of any two members that share a vertex, one is among the components of the other."""
    sharing = set(graph.holders.values())
    pairs = {pair for names in sharing for pair in combinations(names, 2)}
    return all(one in graph.members[other].components or other in graph.members[one].components for one, other in pairs)


def is_disjoint(graph: Graph) -> bool:
    """Tell whether each vertex of the graph is in exactly one of its members, which are leaves and composites."""
    return all(len(graph.holders.get(vertex, ())) == 1 for vertex in graph.vertices)


def is_pruned(graph: Graph) -> bool:
    """Tell whether each edge of a graph leads from one member of the graph to another.

    No member may hold both ends of one edge.
    """
    return all(_leads_between(graph, start, end) for start, end in graph.edges)


def _leads_between(graph: Graph, start: str, end: str) -> bool:
    origins, targets = graph.holders.get(start, ()), graph.holders.get(end, ())
    return bool(origins) and bool(targets) and not set(origins) & set(targets)


def is_component_connected(graph: Graph) -> bool:
    """Tell whether any two members are joined by a path over neighbors; True if there are fewer than two members."""
    touching = neighbors(graph)
    reached = set(list(graph.members)[:1])
    waiting = list(reached)
    while waiting:
        new = touching[waiting.pop()] - reached
        reached |= new
        waiting += new
    return len(reached) == len(graph.members)


def is_configuration(graph: Graph) -> bool:
    """Tell whether the graph has at least one vertex, and fulfils all predicates of this file except `nested`."""
    return bool(graph.vertices) and all(
        PREDICATES[name](graph)
        for name in ("component_graph", "edge_contained", "whole", "disjoint", "pruned", "component_connected")
    )


PREDICATES: Final[Mapping[str, Callable[[Graph], bool]]] = {
    "component_graph": is_component_graph,
    "edge_contained": is_edge_contained,
    "whole": is_whole,
    "nested": is_nested,
    "disjoint": is_disjoint,
    "pruned": is_pruned,
    "component_connected": is_component_connected,
    "configuration": is_configuration,
}
"""All predicates of component graphs by name, except `cycle_bound`, which may need a search (cycles.py)."""


def need(graph: Graph, *names: str) -> None:
    """Raise PcsError `needs:P` if one of these predicates does not hold; P is the first of them that does not."""
    for name in names:
        if not PREDICATES[name](graph):
            raise PcsError(f"needs:{name}")
