"""The difference between two specs as a Mermaid picture: what changed, and its neighbours, in one graph.

New elements are green, removed elements red and dashed, changed elements amber. Neighbours, which did not change, are
plain.
"""

from collections.abc import Container, Iterator
from typing import NamedTuple

from heronry_dg.model import Spec
from heronry_dg.situation import situation
from heronry_tools.analysis.diff.elements import element_changes
from heronry_tools.reports.render.build import build
from heronry_tools.reports.render.graph import Edge, Graph
from heronry_tools.reports.render.marks import marks
from heronry_tools.reports.render.text import edge_words, mermaid_arrow, mermaid_node

_LOOKS = (
    "  classDef added stroke:#1a7f37,stroke-width:3px",
    "  classDef removed stroke:#cf222e,stroke-width:3px,stroke-dasharray:5",
    "  classDef changed stroke:#bf8700,stroke-width:3px",
)
_SHAFTS = {"added": "==>", "removed": "-.->", "": "-->"}


class Arrow(NamedTuple):
    """One flow of data in the picture.

    words: the label of the arrow, which names a mode by its number.
    modes: the names of the modes at both ends. Two arrows are equal only if these names are equal, too: the same number
        may stand for different modes in the old and the new spec.
    """

    source: str
    target: str
    words: str
    modes: tuple[str, ...]


def mermaid_difference(old_spec: Spec, new_spec: Spec) -> str:
    """Draw what changed between two specs as a Mermaid flow chart."""
    old, new = _graph(old_spec), _graph(new_spec)
    nodes = {**old.nodes, **new.nodes}
    classes = {key: _class(key, old.nodes, new.nodes) for key in nodes}
    classes |= {
        element.element: "changed"
        for element in element_changes(old_spec, new_spec)
        if element.change == "changed" and element.element in classes
    }
    before, after = _arrows(old), _arrows(new)
    arrows = {arrow: _class(arrow, before, after) for arrow in dict.fromkeys((*before, *after))}
    touched = {key for key, name in classes.items() if name}
    touched |= {end for arrow, name in arrows.items() if name for end in (arrow.source, arrow.target)}
    shown = [arrow for arrow in arrows if arrow.source in touched or arrow.target in touched]
    ends = {end for arrow in shown for end in (arrow.source, arrow.target)}
    numbers = {key: f"n{number}" for number, key in enumerate(key for key in nodes if key in touched | ends)}
    lines = ["flowchart LR"]
    if not numbers:
        lines.append('  none["no change in the graph"]')
    lines += [mermaid_node(numbers[key], nodes[key], classes[key]) for key in numbers]
    lines += [
        mermaid_arrow(numbers[arrow.source], _SHAFTS[arrows[arrow]], arrow.words, numbers[arrow.target])
        for arrow in shown
    ]
    return "\n".join([*lines, *_LOOKS]) + "\n"


def _graph(spec: Spec) -> Graph:
    return build(spec, marks(spec, situation(spec)))


def _arrows(graph: Graph) -> tuple[Arrow, ...]:
    return tuple(
        Arrow(edge.source, edge.target, edge_words(graph, edge), tuple(_modes(graph, edge))) for edge in graph.edges
    )


def _modes(graph: Graph, edge: Edge) -> Iterator[str]:
    for key, cell in ((edge.source, edge.out_cell), (edge.target, edge.in_cell)):
        if cell is not None:
            yield graph.nodes[key].cells[cell].label


def _class(one: object, old: Container[object], new: Container[object]) -> str:
    if one not in old:
        return "added"
    return "" if one in new else "removed"
