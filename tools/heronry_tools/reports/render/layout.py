"""The place of every symbol and edge, in pixels: boxes that do not overlap, and edges that run between them.

*Columns.* Symbols stand in columns. Where an edge passes a column without ending there, it has a *way-point*
(ordering.py). A *segment* is the piece of an edge from one column to the next.

*Heights.* Every symbol is as close as possible, by least squares, to the height of the symbols to which edges join it.
Between two symbols of a column there is at least a gap. The solution is exact for one column (pool adjacent violators).
It is computed column by column, from left to right and back.

*Edges.* Between two columns an edge is one curve. Across a column it is straight, at a height of its own. Feedback
edges run back below the graph.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isqrt

from heronry_tools.reports.render.graph import Graph
from heronry_tools.reports.render.ordering import Layers, Segment, ordered
from heronry_tools.reports.render.ranks import ranked
from heronry_tools.reports.render.shapes import PORT_STEP, ROUND, Shape, shape_of

MARGIN = 24
_ROW_GAP = 14
_WAY_POINT = Shape(0, 2, 0, 2, (), ())
_LANE = 12  # pixels between two feedback edges
_SWEEPS = 80
_FINE = 64  # heights are computed in 1/64 of a pixel: with coarser rounding the sweeps would end too early

Point = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Box:
    """A symbol's place: its upper left corner, and its shape."""

    x: int
    y: int
    shape: Shape


@dataclass(frozen=True, slots=True)
class Curve:
    """A segment: the piece of an edge from one column of symbols to the next.

    It is straight from `start` to `leave`, a curve from `leave` to `enter`, and straight again from `enter` to `end`.

    edges: numbers of the edges that share the segment.
    last: whether the segment ends at the target of its only edge.
    """

    edges: tuple[int, ...]
    start: Point
    leave: Point
    enter: Point
    end: Point
    last: bool


@dataclass(frozen=True, slots=True)
class Loop:
    """A feedback edge as a line through `points`, with right angles; `edge` is its number in the graph."""

    edge: int
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Layout:
    """The places of a graph's symbols and edges, in pixels.

    width, height: size of the whole picture.
    boxes: the box of each symbol, by its key.
    curves: the segments, that is, the pieces of the edges from one column of symbols to the next.
    loops: the feedback edges.
    """

    width: int
    height: int
    boxes: Mapping[str, Box]
    curves: tuple[Curve, ...]
    loops: tuple[Loop, ...]


def laid_out(graph: Graph) -> Layout:
    """Place the symbols and edges of a graph; the same graph gets the same places."""
    ranks = ranked(graph)
    layers = ordered(graph, ranks)
    feedback = sorted(ranks.feedback)
    inputs = dict.fromkeys(graph.nodes, 0)
    for edge in graph.edges:
        inputs[edge.target] += 1
    shapes = {key: shape_of(node, inputs[key]) for key, node in graph.nodes.items()}
    shapes |= {key: _WAY_POINT for column in layers.columns for key in column if key not in shapes}
    return _Placing(graph, layers, shapes, feedback).layout()


class _Placing:
    """Computes the layout of one graph; holds the intermediate results, such as the height of each symbol."""

    def __init__(self, graph: Graph, layers: Layers, shapes: dict[str, Shape], feedback: list[int]) -> None:
        self._graph = graph
        self._layers = layers
        self._shapes = shapes
        self._feedback = feedback
        self._column_of = {key: number for number, column in enumerate(layers.columns) for key in column}
        self._ports = self._in_ports()
        self._y = self._stacked()

    def layout(self) -> Layout:
        self._settle()
        self._straighten()
        top = min(self._y.values(), default=0)
        y = {key: MARGIN + (at - top) // _FINE for key, at in self._y.items()}
        bottom = max((y[key] + self._shapes[key].height for key in y), default=MARGIN)
        left, right = self._columns_x(y)
        boxes = {}
        for key in self._shapes:
            column = self._column_of[key]
            x = left[column] + (right[column] - left[column] - self._shapes[key].width) // 2
            boxes[key] = Box(x, y[key], self._shapes[key])
        curves = tuple(self._curve(number, boxes, left, right) for number in range(len(self._layers.segments)))
        loops = tuple(self._loops(boxes, left, right, bottom))
        return Layout(
            width=max(right, default=MARGIN) + MARGIN + _LANE * len(loops),
            height=bottom + MARGIN + _LANE * (len(loops) + 1 if loops else 0),
            boxes={key: boxes[key] for key in self._graph.nodes},
            curves=curves,
            loops=loops,
        )

    def _in_ports(self) -> dict[int, int]:
        """Return, for each edge, the height at which it ends, from the top of its target's box.

        The edges into one symbol or cell end one below the other. Their order is that of the symbols or way-points from
        which they come, from top to bottom. Feedback edges end lowest.
        """
        place = {key: number for column in self._layers.columns for number, key in enumerate(column)}
        comers: dict[tuple[str, int | None], list[tuple[int, int]]] = {}
        for segment in self._layers.segments:
            if segment.last:
                comers.setdefault((segment.target, segment.in_cell), []).append(
                    (place[segment.source], segment.edges[0])
                )
        for number in self._feedback:
            edge = self._graph.edges[number]
            comers.setdefault((edge.target, edge.in_cell), []).append((len(place), number))
        ports = {}
        for (target, cell), edges in comers.items():
            step = PORT_STEP if self._graph.nodes[target].kind in ("and", "or", "xor") else min(10, 28 // len(edges))
            middle = self._shapes[target].port(cell)
            for order, (_, edge_number) in enumerate(sorted(edges)):
                ports[edge_number] = middle + (2 * order - len(edges) + 1) * step // 2
        return ports

    def _stacked(self) -> dict[str, int]:
        found = {}
        for column in self._layers.columns:
            y = 0
            for key in column:
                found[key] = y
                y += (self._shapes[key].height + _ROW_GAP) * _FINE
        return found

    def _settle(self) -> None:
        """Move the symbols of every column to heights at which their edges are as level as possible."""
        near: dict[str, list[tuple[str, int]]] = {key: [] for key in self._shapes}  # the other end, and its weight
        weights, shifts = dict.fromkeys(self._shapes, 0), dict.fromkeys(self._shapes, 0)
        for segment in self._layers.segments:
            out, into = self._ends(segment)
            heavy = self._weight(segment)
            ends = ((segment.source, segment.target, out - into), (segment.target, segment.source, into - out))
            for key, other, offset in ends:
                near[key].append((other, heavy))
                weights[key] += heavy
                shifts[key] += offset * _FINE * heavy
        y, columns = self._y, [(column, self._offsets(column)) for column in self._layers.columns]
        for sweep in range(_SWEEPS):
            for column, offsets in columns if sweep % 2 == 0 else reversed(columns):
                wanted = []
                for key in column:
                    pull = -shifts[key]
                    for other, heavy in near[key]:
                        pull += y[other] * heavy
                    wanted.append((pull // weights[key], weights[key]) if weights[key] else (y[key], 1))
                y.update(zip(column, _apart(offsets, wanted), strict=True))

    def _offsets(self, column: tuple[str, ...]) -> list[int]:
        """Return the least distance of each symbol of a column from the first symbol, in 1/64 of a pixel (`_FINE`)."""
        offsets = [0]
        for key in column[:-1]:
            offsets.append(offsets[-1] + (self._shapes[key].height + _ROW_GAP) * _FINE)
        return offsets

    def _straighten(self) -> None:
        """Keep long edges at one height where there is room: they change height once, not in every column."""
        before = {segment.target: segment for segment in self._layers.segments if segment.target.startswith("~")}
        for column in self._layers.columns:
            for places in (range(len(column)), reversed(range(len(column)))):
                for place in places:
                    if (segment := before.get(column[place])) is not None:
                        level = self._y[segment.source] + (self._ends(segment)[0] - self._ends(segment)[1]) * _FINE
                        self._move(column, place, level)

    def _move(self, column: tuple[str, ...], place: int, level: int) -> None:
        """Move a way-point to the height `level`, or as near to it as its neighbours in the column allow.

        place: index of the way-point in `column`. level: the height, in 1/64 of a pixel (`_FINE`).
        """
        if place > 0:
            above = column[place - 1]
            level = max(level, self._y[above] + (self._shapes[above].height + _ROW_GAP) * _FINE)
        if place + 1 < len(column):
            height = self._shapes[column[place]].height
            level = min(level, self._y[column[place + 1]] - (height + _ROW_GAP) * _FINE)
        self._y[column[place]] = level

    def _ends(self, segment: Segment) -> tuple[int, int]:
        """Return the heights of a segment's two ends, in pixels from the top of the symbol or way-point at that end."""
        out = self._shapes[segment.source].port(segment.out_cell)
        into = self._ports[segment.edges[0]] if segment.last else self._shapes[segment.target].port(None)
        return out, into

    def _weight(self, segment: Segment) -> int:
        """Return how straight a segment is to be: the more of its ends are way-points, the straighter."""
        points = (segment.source.startswith("~")) + (segment.target.startswith("~"))
        return (2, 3, 8)[points]

    def _columns_x(self, y: Mapping[str, int]) -> tuple[list[int], list[int]]:
        """Return the left and right sides of the columns, in pixels; `y` has the top of each symbol and way-point.

        The steeper the edges that leave a column, the wider the gap after it.
        """
        steepest = [0] * len(self._layers.columns)
        for segment in self._layers.segments:
            out, into = self._ends(segment)
            column = self._column_of[segment.source]
            steepest[column] = max(steepest[column], abs(y[segment.source] + out - y[segment.target] - into))
        left, right, x = [], [], MARGIN
        for column, keys in enumerate(self._layers.columns):
            left.append(x)
            right.append(x + max(self._shapes[key].width for key in keys))
            x = right[-1] + 56 + min(80, steepest[column] // 8) + 2 * len(self._feedback)
        return left, right

    def _curve(self, number: int, boxes: Mapping[str, Box], left: list[int], right: list[int]) -> Curve:
        segment = self._layers.segments[number]
        source, target = boxes[segment.source], boxes[segment.target]
        out, into = self._ends(segment)
        y_out, y_in = source.y + out, target.y + into
        is_point = segment.source.startswith("~")
        start = left[self._column_of[segment.source]] if is_point else _right_side(source)
        return Curve(
            segment.edges,
            (start, y_out),
            (right[self._column_of[segment.source]], y_out),
            (left[self._column_of[segment.target]], y_in),
            (self._entry(segment, target, into, left[self._column_of[segment.target]]), y_in),
            segment.last,
        )

    def _entry(self, segment: Segment, target: Box, into: int, left: int) -> int:
        """Return the x in pixels at which a segment ends.

        The last segment of an edge ends at the left side of its target. Any other segment ends at `left`, the left side
        of the column that it reaches. The side of a circle lies farther to the right near the top and the bottom of the
        circle, so a segment to a circle ends farther to the right there.

        into: height at which the segment ends, from the top of the target.
        """
        if not segment.last:
            return left
        round_ = self._graph.nodes[segment.target].kind == "variable"
        return _left_side(target) + (_sagitta(ROUND // 2, into - ROUND // 2) if round_ else 0)

    def _loops(self, boxes: Mapping[str, Box], left: list[int], right: list[int], bottom: int) -> Iterator[Loop]:
        for order, number in enumerate(self._feedback):
            edge = self._graph.edges[number]
            source, target = boxes[edge.source], boxes[edge.target]
            y_out, y_in = source.y + source.shape.port(edge.out_cell), target.y + self._ports[number]
            x_out = right[self._column_of[edge.source]] + 6 + 3 * order
            x_in = left[self._column_of[edge.target]] - 10 - 3 * order
            lane = bottom + _LANE * (order + 1)
            corners = ((x_out, y_out), (x_out, lane), (x_in, lane), (x_in, y_in))
            yield Loop(number, ((_right_side(source), y_out), *corners, (_left_side(target), y_in)))


def _apart(offsets: list[int], wanted: list[tuple[int, int]]) -> list[int]:
    """Place the symbols of a column: as near as possible to the wanted heights, by least squares, without overlap.

    Gives the height of each symbol. All heights and distances are in 1/64 of a pixel; the result is rounded down.

    offsets: the least distance of each symbol from the first symbol of the column.
    wanted: for each symbol, the wanted height and the weight of this wish.
    """
    blocks: list[tuple[int, int, int]] = []  # sum of weighted heights, sum of weights, members
    for (height, weight), offset in zip(wanted, offsets, strict=True):
        total, heavy, members = (height - offset) * weight, weight, 1
        while blocks and blocks[-1][0] * heavy > total * blocks[-1][1]:
            above = blocks.pop()
            total, heavy, members = total + above[0], heavy + above[1], members + above[2]
        blocks.append((total, heavy, members))
    starts = [total // heavy for total, heavy, members in blocks for _ in range(members)]
    return [start + offset for start, offset in zip(starts, offsets, strict=True)]


def _sagitta(radius: int, offset: int) -> int:
    """Return how far a circle is from the side of its box, at a height from its centre; all in one unit."""
    return radius - isqrt(radius * radius - offset * offset)


def _left_side(box: Box) -> int:
    return box.x + (box.shape.width - box.shape.body_width) // 2


def _right_side(box: Box) -> int:
    return box.x + (box.shape.width + box.shape.body_width) // 2
