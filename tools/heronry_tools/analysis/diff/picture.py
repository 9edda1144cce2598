"""A difference as a Mermaid picture: what changed, and its neighbours, old and new in one graph.

What is new is green, what is gone red and dashed, what is changed amber; the neighbours keep their looks.
"""

from collections.abc import Iterator

from heronry_dg.model import Spec
from heronry_dg.situation import situation
from heronry_tools.analysis.diff.elements import element_changes
from heronry_tools.reports.render.build import build
from heronry_tools.reports.render.graph import Edge, Graph
from heronry_tools.reports.render.marks import marks
from heronry_tools.reports.render.text import mermaid_edge, mermaid_node

_LOOKS = (
    "  classDef added stroke:#1a7f37,stroke-width:3px",
    "  classDef removed stroke:#cf222e,stroke-width:3px,stroke-dasharray:5",
    "  classDef changed stroke:#bf8700,stroke-width:3px",
)
_ARROWS = {"added": "==>", "removed": "-.->", "": "-->"}


def mermaid_difference(old_spec: Spec, new_spec: Spec) -> str:
    """Draw what changed between two specs as a Mermaid flow chart."""
    old, new = _graph(old_spec), _graph(new_spec)
    both = Graph(new.name, {**old.nodes, **new.nodes}, tuple(dict.fromkeys((*old.edges, *new.edges))))
    classes = {key: _class(key, old, new) for key in both.nodes}
    classes |= {
        element.element: "changed"
        for element in element_changes(old_spec, new_spec)
        if element.change == "changed" and element.element in classes
    }
    edges = {edge: _edge_class(edge, old, new) for edge in both.edges}
    touched = {key for key, name in classes.items() if name}
    touched |= {end for edge, name in edges.items() if name for end in (edge.source, edge.target)}
    shown = [edge for edge in both.edges if edge.source in touched or edge.target in touched]
    numbers = {key: f"n{number}" for number, key in enumerate(_shown_nodes(both, touched, shown))}
    lines = ["flowchart LR"]
    if not numbers:
        lines.append('  none["no change in the graph"]')
    lines += [mermaid_node(numbers[key], both.nodes[key], classes[key]) for key in numbers]
    lines += [mermaid_edge(numbers, both, edge, _ARROWS[edges[edge]]) for edge in shown]
    return "\n".join([*lines, *_LOOKS]) + "\n"


def _graph(spec: Spec) -> Graph:
    return build(spec, marks(spec, situation(spec)))


def _class(key: str, old: Graph, new: Graph) -> str:
    if key not in old.nodes:
        return "added"
    return "" if key in new.nodes else "removed"


def _edge_class(edge: Edge, old: Graph, new: Graph) -> str:
    if edge not in old.edges:
        return "added"
    return "" if edge in new.edges else "removed"


def _shown_nodes(graph: Graph, touched: set[str], shown: list[Edge]) -> Iterator[str]:
    ends = {end for edge in shown for end in (edge.source, edge.target)}
    return (key for key in graph.nodes if key in touched or key in ends)
