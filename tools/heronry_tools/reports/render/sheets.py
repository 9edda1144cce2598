"""A wide graph on several sheets, one below the other, as a text is broken into lines.

A module stands on one sheet, together with its gates, its devices and the other branches of its DEMUX. Data go from
sheet to sheet by the name of a variable. So a variable is drawn on every sheet where a module gives or reads it. It is
drawn solid on the first sheet where a module gives it, and dashed on the others.

To choose the sheets, the whole graph is first laid out in one wide picture. The symbols at the left end of this picture
go to the first sheet, those to their right go to the next sheet, and so on. So data flow from left to right on a sheet,
and then on to the sheet below.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

from heronry_tools.reports.render.graph import Graph
from heronry_tools.reports.render.layout import Layout, laid_out

_WIDEST = 2000  # pixels of a sheet, where possible
_MOST = 16  # sheets of a graph
_VARIABLE = "variable:"

_Middles = Mapping[str, int]  # symbol -> the middle of its box, from the left, in the picture in one piece


@dataclass(frozen=True, slots=True)
class Sheet:
    """One sheet of a picture: a graph, or a part of a graph, with the layout of what is on this sheet."""

    graph: Graph
    layout: Layout


def sheets(graph: Graph) -> tuple[Sheet, ...]:
    """Lay a graph out on as few sheets as possible, each at most `_WIDEST` pixels wide.

    There are at most `_MOST` sheets. If that is not enough, some sheets are wider.
    """
    whole = laid_out(graph)
    middles = {key: box.x + box.shape.width // 2 for key, box in whole.boxes.items()}
    found: tuple[Sheet, ...] = (Sheet(graph, whole),)
    parts = whole.width // _WIDEST
    while parts < _MOST and any(sheet.layout.width > _WIDEST for sheet in found):
        parts += 1
        found = tuple(Sheet(part, laid_out(part)) for part in _cut(graph, middles, whole.width, parts))
    return found


def _cut(graph: Graph, middles: _Middles, width: int, parts: int) -> Iterator[Graph]:
    """Divide a graph into at most `parts` graphs, by the horizontal places of its symbols.

    middles: these places, in a picture of the whole graph.
    width: width of this picture in pixels.
    """
    of = {key: _middle(group, middles) * parts // width for group in _groups(graph) for key in group}
    on = [of[edge.target if edge.source.startswith(_VARIABLE) else edge.source] for edge in graph.edges]
    homes = _homes(graph, on)
    of |= {key: middles[key] * parts // width for key in graph.nodes if key not in of and key not in homes}
    for sheet in sorted({*of.values()}):
        edges = tuple(edge for edge, there in zip(graph.edges, on, strict=True) if there == sheet)
        here = {end for edge in edges for end in (edge.source, edge.target)}
        here |= {key for key, there in of.items() if there == sheet}
        nodes = {
            key: replace(node, again=homes.get(key, sheet) != sheet) for key, node in graph.nodes.items() if key in here
        }
        yield Graph(graph.name, nodes, edges)


def _groups(graph: Graph) -> list[set[str]]:
    """Divide all symbols except variables into groups; two symbols are in one group if edges connect them.

    Edges to or from variables do not count.
    """
    joined: dict[str, list[str]] = {key: [] for key in graph.nodes if not key.startswith(_VARIABLE)}
    for edge in graph.edges:
        if edge.source in joined and edge.target in joined:
            joined[edge.source].append(edge.target)
            joined[edge.target].append(edge.source)
    groups, seen = list[set[str]](), set[str]()
    for root in joined:
        group, waiting = set[str](), [root]
        while waiting:
            key = waiting.pop()
            if key not in seen:
                seen.add(key)
                group.add(key)
                waiting += joined[key]
        if group:
            groups.append(group)
    return groups


def _middle(group: Collection[str], middles: _Middles) -> int:
    """Return the horizontal place of a group of connected symbols: that of its rightmost module, or of any symbol."""
    modules = [key for key in group if key.startswith("module:")]
    return max(middles[key] for key in modules or group)


def _homes(graph: Graph, on: list[int]) -> dict[str, int]:
    """Return for each variable the one sheet on which it is drawn solid; on other sheets it is drawn dashed.

    This is the first sheet with an edge that leads to the variable. If there is none, it is the first sheet with
    an edge that leads from the variable.

    on: for each edge of the graph, the number of its sheet.
    """
    given: dict[str, int] = {}
    read: dict[str, int] = {}
    for edge, sheet in zip(graph.edges, on, strict=True):
        for found, key in ((read, edge.source), (given, edge.target)):
            if key.startswith(_VARIABLE):
                found[key] = min(sheet, found.get(key, sheet))
    return read | given
