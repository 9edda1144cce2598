"""Finds the column of each symbol: data flow to the right, sensors stand at the left and actuators at the right.

A *ranking* gives each symbol a column, so that every edge leads to the right. An edge that leads out of a variable with
an initial value, and would close a cycle, is a *feedback* edge. Feedback edges are left out of the ranking, and are
drawn around the graph.

1. Two rankings are made: in one every symbol is as far left as possible, in the other as far right as possible.
2. Each ranking is improved by moving single symbols.
3. The ranking with the shorter edges is used.

All steps follow the order of the graph, so that the same graph gives the same picture.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from heronry_dg.cycles import components
from heronry_tools.reports.render.graph import Edge, Graph

# Weights of edges: a driver should stand by its sensor, a variable by its giver; edges out of a variable may be long.
_FROM_SENSOR, _ADJACENT, _FROM_VARIABLE = 4, 3, 1
_SWEEPS = 12


@dataclass(frozen=True, slots=True)
class Ranks:
    """The columns of a graph.

    of: column of each symbol, counted from 0 at the left.
    feedback: the feedback edges, by their index in the graph.
    """

    of: Mapping[str, int]
    feedback: frozenset[int]


def ranked(graph: Graph) -> Ranks:
    """Assign a column to every symbol of a graph."""
    feedback = _feedback(graph)
    edges = [edge for number, edge in enumerate(graph.edges) if number not in feedback]
    left = _longest_paths(graph.nodes, [(edge.source, edge.target) for edge in edges])
    last = max(left.values(), default=0)
    far = _longest_paths(graph.nodes, [(edge.target, edge.source) for edge in edges])
    right = {key: last - rank for key, rank in far.items()}
    candidates = [_tightened(graph, edges, ranks, last) for ranks in (left, right)]
    best = min(candidates, key=lambda ranks: _length(edges, ranks))
    columns = {rank: column for column, rank in enumerate(sorted(set(best.values())))}
    return Ranks({key: columns[rank] for key, rank in best.items()}, feedback)


def _feedback(graph: Graph) -> frozenset[int]:
    """Return the edges to leave out, as indices of `graph.edges`, so that no cycle is left.

    All these edges lead out of variables with an initial value.

    Only necessary edges are left out: any one of them, put back alone, would close a cycle.
    """
    successors: dict[str, list[str]] = {key: [] for key in graph.nodes}
    for edge in graph.edges:
        successors[edge.source].append(edge.target)
    component = {key: number for number, keys in enumerate(components(successors)) for key in keys}
    suspects = [
        number
        for number, edge in enumerate(graph.edges)
        if graph.nodes[edge.source].initial and component[edge.source] == component[edge.target]
    ]
    for number in suspects:
        successors[graph.edges[number].source].remove(graph.edges[number].target)
    kept = set()
    for number in suspects:
        edge = graph.edges[number]
        if not _reaches(successors, edge.target, edge.source):
            successors[edge.source].append(edge.target)
            kept.add(number)
    return frozenset(suspects) - kept


def _reaches(successors: Mapping[str, Collection[str]], start: str, goal: str) -> bool:
    seen, frontier = {start}, [start]
    while frontier:
        here = frontier.pop()
        if here == goal:
            return True
        new = [key for key in successors[here] if key not in seen]
        seen.update(new)
        frontier += new
    return False


def _longest_paths(keys: Collection[str], pairs: list[tuple[str, str]]) -> dict[str, int]:
    """Return for each symbol the number of edges of the longest path that ends in it (Kahn's order).

    pairs: the edges, as (source, target).
    """
    waiting = dict.fromkeys(keys, 0)
    successors: dict[str, list[str]] = {key: [] for key in keys}
    for source, target in pairs:
        waiting[target] += 1
        successors[source].append(target)
    ranks = dict.fromkeys(keys, 0)
    ready = [key for key, count in waiting.items() if not count]
    for key in ready:
        for target in successors[key]:
            ranks[target] = max(ranks[target], ranks[key] + 1)
            waiting[target] -= 1
            if not waiting[target]:
                ready.append(target)
    return ranks


def _tightened(graph: Graph, edges: list[Edge], start: Mapping[str, int], last: int) -> dict[str, int]:
    """Give every symbol a new column, so that the edges become shorter and still lead to the right.

    One symbol is moved at a time, in several passes over all symbols. Sensors stand in column 0, actuators in
    column `last`.

    start: the present column of each symbol.
    """
    ranks = dict(start)
    into: dict[str, list[str]] = {key: [] for key in graph.nodes}
    out_of: dict[str, list[str]] = {key: [] for key in graph.nodes}
    for edge in edges:
        into[edge.target].append(edge.source)
        out_of[edge.source].append(edge.target)
    pinned = {
        key: 0 if node.kind == "sensor" else last
        for key, node in graph.nodes.items()
        if node.kind in ("sensor", "actuator")
    }
    ranks.update(pinned)
    for _ in range(_SWEEPS):
        before = dict(ranks)
        for key in sorted(graph.nodes, key=lambda one: -ranks[one]):
            low = max((ranks[one] + 1 for one in into[key]), default=0)
            high = min((ranks[one] - 1 for one in out_of[key]), default=last)
            if key not in pinned:
                pull = sum(_weight(one) for one in into[key]) - (_weight(key) if out_of[key] else 0)
                ranks[key] = low if pull > 0 else high if pull < 0 else ranks[key]
        if ranks == before:
            break
    return ranks


def _weight(source: str) -> int:
    return {"variable": _FROM_VARIABLE, "device": _FROM_SENSOR}.get(source.partition(":")[0], _ADJACENT)


def _length(edges: list[Edge], ranks: Mapping[str, int]) -> int:
    """Return the sum of the lengths of all edges; an edge to the next column has the length 1.

    Edges out of one symbol share a trunk, so only the longest of them counts.
    """
    ends: dict[str, int] = {}
    for edge in edges:
        ends[edge.source] = max(ends.get(edge.source, 0), ranks[edge.target] - ranks[edge.source])
    return sum(ends.values())
