"""Operations on component graphs: cprune, combine, removal, addition and addEdge.

Each operation first checks its requirements, in the order of its docstring. It raises PcsError for the first
requirement that is not met. The error names a predicate that does not hold (`needs:P`), a name that stands for two
things (`clash:K`), a vertex that the space lacks (`unknown:V`), or the wrong place of the edge (`edge_apart`,
`edge_outside`, `edge_inside`). If these predicates (predicates.py) hold before an operation, they also hold after it:

    cprune     component_graph, disjoint and pruned
    combine    component_graph and edge_contained; configuration if an edge is given and no vertex is shared
    removal    all but component_connected
    addition   configuration
    add_edge   configuration

Source: the paper that graph.py names, section 2.3. The operations as the paper words them would not keep
these predicates. Differences: cprune removes the vertices of a component too, and stops at one component.
combine also works without an edge, as section 3.4 of the paper uses it. removal gives a configuration only
if the graph is still connected without the removed edges and members. addition refuses an edge that leaves
the graph or lies inside a component. addEdge also adds an edge between two members; if addEdge adds a leaf,
the leaf becomes a member.
"""

from collections.abc import Collection
from dataclasses import replace

from heronry_pcs.graph import Edge, Graph, Part, PcsError, parent
from heronry_pcs.neighborhood import neighbors
from heronry_pcs.predicates import need


def cprune(graph: Graph) -> Graph:
    """Remove the members that have no neighbor, with their vertices, in the order of names.

    If no member has a neighbor, the last member by name stays. Needs component_graph, disjoint, pruned.
    """
    need(graph, "component_graph", "disjoint", "pruned")
    alone = [name for name, touching in neighbors(graph).items() if not touching]
    gone = alone[: len(graph.members) - 1]  # their removal takes no neighbor from any other member
    vertices = frozenset[str]().union(*(graph.members[name].vertices for name in gone))
    return graph.of(graph.vertices - vertices, graph.edges, graph.own.components - frozenset(gone))


def combine(graph: Graph, other: Graph, edge: Edge | None = None) -> Graph:
    """Unite two graphs, and join them by an edge.

    Each graph must be a component_graph and have a vertex (`needs:vertex`); the first graph is checked before the
    second. A name that both have must stand for the same part (`clash:K`). Each end of the edge must be in one of the
    two spaces (`unknown:V`), and each graph must have one of the ends (`edge_apart`).
    """
    for one in (graph, other):
        need(one, "component_graph")
        if not one.vertices:
            raise PcsError("needs:vertex")
    _refuse_clash(graph, other)
    if edge is not None:
        _check_known(edge, graph.space | other.space)
        if not (_leads(edge, graph, other) or _leads(edge, other, graph)):
            raise PcsError("edge_apart")
    return Graph(
        name=graph.name,
        leaves={**graph.leaves, **other.leaves},
        composites={**graph.composites, **other.composites},
        own=Part(
            graph.vertices | other.vertices,
            graph.edges | other.edges | ({edge} if edge is not None else frozenset()),
            graph.own.components | other.own.components,
        ),
    )


def _leads(edge: Edge, graph: Graph, other: Graph) -> bool:
    return edge[0] in graph.vertices and edge[1] in other.vertices


def _refuse_clash(graph: Graph, other: Graph) -> None:
    """Raise PcsError if a name stands for different parts in two graphs; the error names the first such name.

    Names of leaves in both graphs come first, in alphabetical order. Then come the names that are a composite in at
    least one of the graphs.
    """
    for name in sorted(graph.leaves.keys() & other.leaves.keys()):
        if graph.leaves[name] != other.leaves[name]:
            raise PcsError(f"clash:{name}")
    ours, theirs = ({**one.leaves, **one.composites} for one in (graph, other))
    composites = graph.composites.keys() | other.composites.keys()
    for name in sorted(composites & ours.keys() & theirs.keys()):
        if ours[name] != theirs[name]:
            raise PcsError(f"clash:{name}")


def removal(graph: Graph, edges: Collection[Edge]) -> Graph:
    """Remove edges, and prune the resulting graph (`cprune`); an edge that the graph lacks is ignored.

    The graph must be a `configuration` (`needs:configuration`). The ends of all edges must be in the graph's
    space (`unknown:V`); the edges are checked in the order of their names.
    """
    need(graph, "configuration")
    for edge in sorted(edges):
        _check_known(edge, graph.space)
    return cprune(graph.of(graph.vertices, graph.edges - frozenset(edges), graph.own.components))


def addition(graph: Graph, edge: Edge) -> Graph:
    """Add an edge.

    The graph must be a `configuration` (`needs:configuration`). Both ends of the edge must be in the graph's
    space (`unknown:V`) and among its vertices (`edge_outside`), and must not lie in one member (`edge_inside`).
    """
    need(graph, "configuration")
    _check_known(edge, graph.space)
    if not graph.vertices.issuperset(edge):
        raise PcsError("edge_outside")
    if _in_one_member(graph, edge):
        raise PcsError("edge_inside")
    return graph.of(graph.vertices, graph.edges | {edge}, graph.own.components)


def add_edge(graph: Graph, edge: Edge) -> Graph:
    """Add an edge; if one end of the edge is not in the graph, add the leaf of that end, too.

    The graph must be a configuration. Both ends must be in the space (`unknown:V`), and at least one of them in
    the graph (`edge_apart`). An edge inside one member changes nothing.
    """
    need(graph, "configuration")
    _check_known(edge, graph.space)
    start, end = edge
    if graph.vertices.isdisjoint(edge):
        raise PcsError("edge_apart")
    for outside in (end, start):
        if outside not in graph.vertices:
            return combine(graph, _alone(graph, parent(outside)), edge)
    return graph if _in_one_member(graph, edge) else addition(graph, edge)


def _alone(graph: Graph, leaf: str) -> Graph:
    part = graph.part(leaf)
    return replace(
        graph, leaves={leaf: graph.leaves[leaf]}, composites={}, own=Part(part.vertices, components=frozenset({leaf}))
    )


def _check_known(edge: Edge, space: frozenset[str]) -> None:
    for vertex in edge:
        if vertex not in space:
            raise PcsError(f"unknown:{vertex}", space)


def _in_one_member(graph: Graph, edge: Edge) -> bool:
    start, end = edge
    return not set(graph.holders.get(start, ())).isdisjoint(graph.holders.get(end, ()))
