"""Finds cycles in a directed graph: the nodes that lie on a cycle, and a shortest cycle to show.

A graph is a map from each node to the nodes that it points to. No function here is recursive, since a hostile spec may
hold a chain of nodes that is as long as the file.
"""

from collections import deque
from collections.abc import Collection, Iterator, Mapping
from typing import Generic, TypeVar

N = TypeVar("N")


def components(graph: Mapping[N, Collection[N]]) -> list[list[N]]:
    """Return the strongly connected components of a graph (Tarjan 1972), each after those to which it points."""
    return _Tarjan(graph).found()


def shortest_cycle(graph: Mapping[N, Collection[N]], component: Collection[N]) -> list[N]:
    """Return a shortest cycle through the first node of a strongly connected component; empty where there is none."""
    inside = set(component)
    first = next(iter(component))
    parents: dict[N, N] = {}
    waiting = deque([first])
    while waiting:
        node = waiting.popleft()
        for successor in graph[node]:
            if successor == first:
                return _way_back(parents, first, node)
            if successor in inside and successor not in parents:
                parents[successor] = node
                waiting.append(successor)
    return []


def _way_back(parents: Mapping[N, N], first: N, last: N) -> list[N]:
    way = [last]
    while way[-1] != first:
        way.append(parents[way[-1]])
    return way[::-1]


class _Tarjan(Generic[N]):
    def __init__(self, graph: Mapping[N, Collection[N]]) -> None:
        self._graph = graph
        self._rank = {node: rank for rank, node in enumerate(graph)}
        self._entered: dict[N, int] = {}
        self._low: dict[N, int] = {}  # number of the earliest node to which a node is known to lead back
        self._open: dict[N, None] = {}  # entered, and not yet in a component; in the order of entry
        self._found: list[list[N]] = []

    def found(self) -> list[list[N]]:
        for node in self._graph:
            if node not in self._entered:
                self._walk(node)
        return self._found

    def _walk(self, root: N) -> None:
        path = [self._enter(root)]
        while path:
            node, successors = path[-1]
            successor = self._next_new(node, successors)
            if successor is not None:
                path.append(self._enter(successor))
                continue
            path.pop()
            if path:
                parent = path[-1][0]
                self._low[parent] = min(self._low[parent], self._low[node])
            if self._low[node] == self._entered[node]:
                self._close(node)

    def _enter(self, node: N) -> tuple[N, Iterator[N]]:
        self._entered[node] = self._low[node] = len(self._entered)
        self._open[node] = None
        return node, iter(self._graph[node])

    def _next_new(self, node: N, successors: Iterator[N]) -> N | None:
        for successor in successors:
            if successor not in self._entered:
                return successor
            if successor in self._open:
                self._low[node] = min(self._low[node], self._entered[successor])
        return None

    def _close(self, node: N) -> None:
        component = [self._open.popitem()[0]]
        while component[-1] != node:
            component.append(self._open.popitem()[0])
        self._found.append(sorted(component, key=self._rank.__getitem__) if len(component) > 1 else component)
