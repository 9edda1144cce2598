"""A graph as a picture: one SVG file that needs no other file.

If there are several sheets, each is drawn completely before the next one. The edges of a sheet are drawn first. Over
them come the edges that are in use in the configuration (`Edge.chosen`), and then the symbols. In the file every symbol
has its key, and every edge has the keys of the two symbols at its ends, so that programs can read the picture, too.

`uncoloured` draws the graph for a page that colours the symbols itself. The drawing has no style, and every line has
the names of all its edges. Every symbol has a cross; the page shows this cross only on a dead or lost symbol.
"""

from collections.abc import Callable, Iterator
from xml.sax.saxutils import escape, quoteattr

from heronry_tools.reports.render.graph import Edge, Graph
from heronry_tools.reports.render.layout import Curve, Layout, Loop
from heronry_tools.reports.render.sheets import Sheet, sheets
from heronry_tools.reports.render.symbols import symbol

_STYLE = """
text { font-family: "DejaVu Sans", Verdana, sans-serif; text-anchor: middle; fill: #1b1f24; }
.name, .inside { font-size: 11px; } .small { font-size: 9px; }
.note, .label { font-size: 9px; fill: #57606a; }
.label { stroke: #fff; stroke-width: 3px; paint-order: stroke; text-anchor: end; }
.body, .cell, .line, .edge, .crossed { fill: none; stroke: #1b1f24; stroke-width: 1.2; }
.body { fill: #fff; } .variable .body { fill: #eef4fb; } .sensor .body, .actuator .body { fill: #f3efe4; }
.chosen > .body, .chosen > .line { stroke-width: 3; } .cell.chosen { fill: #bfe3c6; stroke-width: 2; }
.edge { stroke: #57606a; } .edge.chosen { stroke: #1b1f24; stroke-width: 3; }
.edge.dead { stroke: #b4b9bf; stroke-dasharray: 4 3; }
.dead > .body, .dead > .line, .cell.dead { stroke: #a0a6ad; } .dead > text, text.dead { fill: #a0a6ad; }
text.dead { text-decoration: line-through; } .crossed { stroke: #c0392b; stroke-width: 2; }
.again > .body { stroke-dasharray: 3 2; } .fold { stroke: #d0d7de; }
"""
_ARROW = (
    '<marker id="arrow" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" '
    'markerUnits="userSpaceOnUse" orient="auto"><path d="M0,1L8,4L0,7Z" fill="#1b1f24"/></marker>'
)


def svg(graph: Graph, title: str = "Dependency graph") -> str:
    """Draw a graph; the same graph gives the same bytes."""
    drawn = sheets(graph)
    width, height = max(sheet.layout.width for sheet in drawn), sum(sheet.layout.height for sheet in drawn)
    size = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img">',
        f"<title>{escape(f'{title} of {graph.name}')}</title>",
        f"<style>{_STYLE}</style>",
        _ARROW,
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
    ]
    top = 0
    for sheet in drawn:
        lines += _sheet(sheet, top, width)
        top += sheet.layout.height
    return "\n".join([*lines, "</svg>"]) + "\n"


def uncoloured(graph: Graph, edge_key: Callable[[Edge], str]) -> str:
    """Draw a graph as SVG without colours, for a page whose own style sheet gives the colours.

    edge_key: gives the name of an edge, without spaces.
    """
    drawn = sheets(graph)
    width, height = max(sheet.layout.width for sheet in drawn), sum(sheet.layout.height for sheet in drawn)
    arrow = _ARROW.replace(' fill="#1b1f24"', ' class="head"')
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" role="group">',
        arrow,
    ]
    top = 0
    for sheet in drawn:
        lines += _sheet(sheet, top, width, edge_key)
        top += sheet.layout.height
    return "\n".join([*lines, "</svg>"]) + "\n"


def _sheet(sheet: Sheet, top: int, width: int, edge_key: Callable[[Edge], str] | None = None) -> Iterator[str]:
    """Draw one sheet; its upper edge is at `top`, in px.

    edge_key: gives the name by which a page finds an edge, if this page colours the symbols and edges itself.
        None: the drawing has its own colours.
    """
    if top:
        yield f'<path class="fold" d="M0,{top}H{width}"/>'
    yield f'<g transform="translate(0,{top})">'
    yield from _edges(sheet.graph, sheet.layout, edge_key)
    for key, node in sheet.graph.nodes.items():
        yield from symbol(node, sheet.layout.boxes[key], crossed=node.dead or edge_key is not None)
    yield from _labels(sheet.graph, sheet.layout)
    yield "</g>"


def _edges(graph: Graph, layout: Layout, edge_key: Callable[[Edge], str] | None) -> Iterator[str]:
    drawn: list[Curve | Loop] = [*layout.curves, *layout.loops]
    for piece in sorted(drawn, key=lambda piece: _rank(graph, piece)):
        names = [] if edge_key is None else [edge_key(graph.edges[number]) for number in _numbers(piece)]
        yield _path(graph, piece, f" data-edges={quoteattr(' '.join(names))}" if names else "")


def _numbers(piece: Curve | Loop) -> tuple[int, ...]:
    return (piece.edge,) if isinstance(piece, Loop) else piece.edges


def _rank(graph: Graph, piece: Curve | Loop) -> int:
    """Return the highest rank of the edges in a segment: 2 for a chosen edge, 0 for a dead one, 1 for others."""
    return max(_liveliness(graph.edges[number]) for number in _numbers(piece))


def _liveliness(edge: Edge) -> int:
    return 0 if edge.dead else 2 if edge.chosen else 1


def _path(graph: Graph, piece: Curve | Loop, named: str) -> str:
    kind = ("edge dead", "edge", "edge chosen")[_rank(graph, piece)]
    first = graph.edges[_numbers(piece)[0]]
    ends = f"data-from={quoteattr(first.source)}"
    if isinstance(piece, Loop) or piece.last:
        ends += f' data-to={quoteattr(first.target)} marker-end="url(#arrow)"'
    way = _loop(piece) if isinstance(piece, Loop) else _curve(piece)
    return f'<path class="{kind}" d="{way}" {ends}{named}/>'


def _curve(curve: Curve) -> str:
    (x_out, y_out), (x_in, y_in) = curve.leave, curve.enter
    middle = (x_out + x_in) // 2
    return f"M{curve.start[0]},{curve.start[1]}H{x_out}C{middle},{y_out} {middle},{y_in} {x_in},{y_in}" + (
        f"H{curve.end[0]}" if curve.end[0] != x_in else ""
    )


def _loop(loop: Loop) -> str:
    return "M" + "L".join(f"{x},{y}" for x, y in loop.points)


def _labels(graph: Graph, layout: Layout) -> Iterator[str]:
    """Write the label of each edge, a version, at the end of the edge; an edge without a label gets none."""
    ends = [(curve.edges[0], curve.end) for curve in layout.curves if curve.last]
    ends += [(loop.edge, loop.points[-1]) for loop in layout.loops]
    for number, (x, y) in ends:
        if label := graph.edges[number].label:
            yield f'<text class="label" x="{x - 9}" y="{y - 3}">{escape(label)}</text>'
