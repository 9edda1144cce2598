"""Which members are neighbors, which members a member subsumes, and the necessary conditions for control.

Two members are neighbors if an edge, in either direction, has one end in the one member and the other end in the other.
A member M subsumes a member N if N is a subgraph of M, and N is either a component of M or subsumed by a component
of M.

The conditions for control are *necessary, not sufficient*. A member into which no edge leads from another member cannot
be controllable. A member out of which no edge leads to another member cannot be observable. Why they are not
sufficient: let A and B feed each other, B feed K, K feed C, and C and D feed each other. An edge leads into K, and
another one out of K, yet K is on no loop.

Source: the paper that graph.py names, section 2.2.
"""

from collections.abc import Mapping
from typing import Literal

from heronry_pcs.graph import Edge, Graph

Condition = Literal["excluded", "possible"]


def neighbors(graph: Graph) -> Mapping[str, set[str]]:
    """Return for each member the members that are its neighbors (head of this file).

    The keys are in the order of names.
    """
    found: dict[str, set[str]] = {name: set() for name in graph.members}
    for origins, targets in _crossings(graph):
        for one in origins:
            for other in targets:
                if one != other:
                    found[one].add(other)
                    found[other].add(one)
    return found


def _crossings(graph: Graph) -> set[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Return, for the edges, each pair of the members that hold the start and those that hold the end, once."""
    return {(graph.holders.get(start, ()), graph.holders.get(end, ())) for start, end in graph.edges}


def subsumed(graph: Graph) -> Mapping[str, list[str]]:
    """Return for each member the sorted names of the members that it subsumes (head of this file)."""
    return {name: sorted(_subsumed_by(graph, name)) for name in graph.members}


def _subsumed_by(graph: Graph, name: str) -> set[str]:
    """Return the components that a member subsumes.

    A component is subsumed if a chain of components leads from the member down to it, and it is a subgraph of each
    component in the chain.
    """
    found: set[str] = set()
    for target in _below(graph, name):
        part = graph.part(target)
        waiting, seen = [name], {name}
        while waiting:
            here = graph.part(waiting.pop())
            if not here.has_subgraph(part):
                continue
            if target in here.components:
                found.add(target)
                break
            new = here.components - seen
            seen |= new
            waiting += new
    return found


def _below(graph: Graph, name: str) -> set[str]:
    """Return all members of the graph that are inside the component `name`, at any depth."""
    seen: set[str] = set()
    waiting = [name]
    while waiting:
        new = graph.part(waiting.pop()).components - seen
        seen |= new
        waiting += new
    return seen & graph.members.keys()


def controllable(graph: Graph) -> Mapping[str, Condition]:
    """Return for each member `possible` if an edge leads into it from another member, else `excluded`."""
    return _fed_by_another(graph, graph.edges)


def observable(graph: Graph) -> Mapping[str, Condition]:
    """Return for each member `possible` if an edge leads out of it to another member, else `excluded`."""
    return _fed_by_another(graph, {(end, start) for start, end in graph.edges})


def _fed_by_another(graph: Graph, edges: "frozenset[Edge] | set[Edge]") -> Mapping[str, Condition]:
    found: dict[str, Condition] = dict.fromkeys(graph.members, "excluded")
    for start, end in edges:
        origins = graph.holders.get(start, ())
        for target in graph.holders.get(end, ()):
            if any(origin != target for origin in origins):
                found[target] = "possible"
    return found
