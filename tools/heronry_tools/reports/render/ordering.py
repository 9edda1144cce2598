"""Orders the symbols of each column of a picture from top to bottom, so that few edges cross.

Symbols are in columns already (`ranks`). An edge over several columns passes each column between its ends at a
*way-point*, so that it runs around the symbols there. Way-points are ordered together with the symbols. All edges out
of one symbol, or out of one cell of it, share their way-points, as one trunk.

The order is found by sweeps over the columns, alternately to the right and to the left. A sweep sorts each column by
the mean position of its neighbours in the column before (barycentres; Sugiyama, Tagawa and Toda 1981). The order with
the fewest crossings among all sweeps is taken.
"""

from bisect import bisect_right
from dataclasses import dataclass

from heronry_tools.reports.render.graph import Graph
from heronry_tools.reports.render.ranks import Ranks

_SWEEPS = 24


@dataclass(frozen=True, slots=True)
class Segment:
    """A piece of one or more edges, from one column to the next; its ends are symbols or way-points."""

    source: str
    target: str
    out_cell: int | None  # cell of the source at which the segment begins; None: it begins at the source itself
    in_cell: int | None  # cell of the target at which the segment ends; None: it ends at the target itself
    edges: tuple[int, ...]  # numbers of the edges that share this segment
    last: bool  # this segment ends at the target of its only edge


@dataclass(frozen=True, slots=True)
class Layers:
    """The columns of a picture, each with its symbols and way-points.

    columns: from left to right; in each, the names of its symbols and way-points from top to bottom.
    segments: the pieces of the edges between one column and the next.
    """

    columns: tuple[tuple[str, ...], ...]
    segments: tuple[Segment, ...]


def ordered(graph: Graph, ranks: Ranks) -> Layers:
    """Put symbols and way-points into columns, and order each column so that few edges cross."""
    segments = _segments(graph, ranks)
    columns = _first_order(graph, ranks, segments)
    best, fewest = [list(column) for column in columns], _crossings(graph, columns, segments)
    for sweep in range(_SWEEPS):
        forth = sweep % 2 == 0
        _sweep(graph, columns, segments, forth=forth)
        crossings = _crossings(graph, columns, segments)
        if crossings < fewest:
            best, fewest = [list(column) for column in columns], crossings
    return Layers(tuple(map(tuple, best)), segments)


def _segments(graph: Graph, ranks: Ranks) -> tuple[Segment, ...]:
    shared: dict[tuple[str, str, int | None], list[int]] = {}
    ends: list[Segment] = []
    for number, edge in enumerate(graph.edges):
        if number in ranks.feedback:
            continue
        here, cell = edge.source, edge.out_cell
        for column in range(ranks.of[edge.source] + 1, ranks.of[edge.target]):
            point = f"~{edge.source}#{edge.out_cell}@{column}"
            shared.setdefault((here, point, cell), []).append(number)
            here, cell = point, None
        ends.append(Segment(here, edge.target, cell, edge.in_cell, (number,), last=True))
    trunks = [Segment(a, b, cell, None, tuple(edges), last=False) for (a, b, cell), edges in shared.items()]
    return (*trunks, *ends)


def _first_order(graph: Graph, ranks: Ranks, segments: tuple[Segment, ...]) -> list[list[str]]:
    """Return the symbols of each column in the order in which a walk along the edges reaches them.

    So connected symbols begin close together.
    """
    neighbours: dict[str, list[str]] = {key: [] for key in graph.nodes}
    column_of = dict(ranks.of)
    for segment in segments:
        for here, there in ((segment.source, segment.target), (segment.target, segment.source)):
            neighbours.setdefault(here, []).append(there)
            if here not in column_of:
                column_of[here] = int(here.rpartition("@")[2])
    columns: list[list[str]] = [[] for _ in range(max(column_of.values(), default=-1) + 1)]
    seen: set[str] = set()
    for root in graph.nodes:
        stack = [root]
        while stack:
            key = stack.pop()
            if key not in seen:
                seen.add(key)
                columns[column_of[key]].append(key)
                stack += reversed(neighbours[key])
    return columns


def _positions(graph: Graph, columns: list[list[str]]) -> dict[tuple[str, int | None], float]:
    """Return the vertical positions of symbols and of their cells, as the number of places from the top of the column.

    The key of a cell is (symbol, number of the cell); the key of a symbol is (symbol, None).
    """
    found: dict[tuple[str, int | None], float] = {}
    for column in columns:
        _place(graph, column, found)
    return found


def _place(graph: Graph, column: list[str], at: dict[tuple[str, int | None], float]) -> None:
    """Note in `at` the vertical positions of one column's symbols, and of their cells (keys as in `_positions`)."""
    for place, key in enumerate(column):
        at[key, None] = float(place)
        cells = len(graph.nodes[key].cells) if key in graph.nodes else 0
        for cell in range(cells):
            at[key, cell] = place + (cell + 0.5) / cells - 0.5


def _sweep(graph: Graph, columns: list[list[str]], segments: tuple[Segment, ...], *, forth: bool) -> None:
    near: dict[str, list[tuple[str, int | None]]] = {}
    for segment in segments:
        if forth:
            near.setdefault(segment.target, []).append((segment.source, segment.out_cell))
        else:
            near.setdefault(segment.source, []).append((segment.target, segment.in_cell))
    at = _positions(graph, columns)

    def centre(key: str) -> float:
        ends = near.get(key)
        return sum(at[end] for end in ends) / len(ends) if ends else at[key, None]

    for column in columns if forth else reversed(columns):
        column.sort(key=centre)
        _place(graph, column, at)


def _crossings(graph: Graph, columns: list[list[str]], segments: tuple[Segment, ...]) -> int:
    at = _positions(graph, columns)
    column_of = {key: number for number, column in enumerate(columns) for key in column}
    between: dict[int, list[tuple[float, float]]] = {}
    for segment in segments:
        ends = at[segment.source, segment.out_cell], at[segment.target, segment.in_cell]
        between.setdefault(column_of[segment.source], []).append(ends)
    return sum(map(_inversions, between.values()))


def _inversions(pairs: list[tuple[float, float]]) -> int:
    """Count the crossings of lines (begin, end): pairs in which one line begins above the other and ends below it."""
    count, ends = 0, list[float]()
    for _, end in sorted(pairs):
        place = bisect_right(ends, end)
        count += len(ends) - place
        ends.insert(place, end)
    return count
