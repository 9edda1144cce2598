"""Writes the script that turns one graph into another: it deletes and creates components and edges.

A leaf whose ports or image differ is deleted and created again. Composites are not compared.

The script yields the leaves and edges of the new graph under three conditions; if one fails, interpreting the
script gives an error:

- The space of the old graph (the set of leaves, see graph.py) has the leaves of the new graph, with the same
  ports and images (PCS204).
- The name of each created leaf is a NAME of the script language (PCS101).
- No new edge lies inside a leaf (PCS208).
"""

from collections.abc import Iterable, Iterator

from heronry_pcs.graph import Edge, Graph, PcsError, inside
from heronry_pcs.predicates import need
from heronry_pcs.script_syntax import NAME


def difference(old: Graph, new: Graph) -> str:
    """Write the script that turns the graph `old` into `new`.

    Each graph must be a component_graph, whole and edge_contained, and each leaf whose ports are in the graph must be a
    member (`leaves`). Raises PcsError `needs:P`; P is the first of these four names whose condition does not hold.
    """
    for graph in (old, new):
        _check(graph)
    receiver = _receiver(old, new)
    before, after = _leaf_members(old), _leaf_members(new)
    kept = {name for name in before & after if old.leaves[name] == new.leaves[name]}
    created = sorted(after - kept)
    staying = inside(old.edges, frozenset(vertex for name in kept for vertex in old.leaves[name].vertices()))
    lines = [
        *(f"define {name};" for name in created),
        *(f"{receiver}.DeleteComponent ( {_name(name)} );" for name in sorted(before - kept)),
        *([f"{receiver}.PruneEdges ();"] if staying != old.edges else []),
        *_edges(f"{receiver}.DeleteEdge", staying - new.edges),
        *(f'{name} = {receiver}.CreateComponent ( "{new.leaves[name].image}" );' for name in created),
        *_edges(f"{receiver}.CreateEdge", new.edges - staying),
    ]
    return "".join(f"{line}\n" for line in lines)


def _check(graph: Graph) -> None:
    need(graph, "component_graph", "whole", "edge_contained")
    if graph.vertices != frozenset(v for name in _leaf_members(graph) for v in graph.leaves[name].vertices()):
        raise PcsError("needs:leaves")


def _leaf_members(graph: Graph) -> set[str]:
    return {name for name in graph.own.components if name in graph.leaves}


def _receiver(old: Graph, new: Graph) -> str:
    taken = {*old.leaves, *old.composites, *new.leaves, *new.composites}
    receiver = "G"
    while receiver in taken:
        receiver += "_"
    return receiver


def _name(name: str) -> str:
    return name if NAME.fullmatch(name) else f'"{name}"'


def _edges(operation: str, edges: Iterable[Edge]) -> Iterator[str]:
    for start, end in sorted(edges):
        yield f'{operation} ( "{start}", "{end}" );'
