"""A graph as text for other programs: as Mermaid, which Git servers show in Markdown, or as DOT, which Graphviz reads.

Mermaid and DOT lack the symbols of gates that the SVG picture has. So a gate gets the most similar shape, with the
gate's name in it. A module's symbol has a cell for each mode. In DOT an edge ends at the cell, which is a port. Mermaid
has no ports, so the words on the edge name the mode.
"""

from collections.abc import Iterator, Mapping
from typing import Final

from heronry_tools.reports.render.graph import Edge, Graph, Kind, Node

_BRACKETS: Final[Mapping[Kind, tuple[str, str]]] = {
    "module": ("[", "]"),
    "variable": ("((", "))"),
    "sensor": ("[\\", "/]"),
    "actuator": ("[/", "\\]"),
    "and": ("{{", "}}"),
    "or": ("{{", "}}"),
    "xor": ("{{", "}}"),
    "demux": ("{", "}"),
}
_SHAPES: Final[Mapping[Kind, str]] = {
    "module": "record",
    "variable": "circle",
    "sensor": "triangle, orientation=270",
    "actuator": "triangle, orientation=270",
    "and": "hexagon",
    "or": "hexagon",
    "xor": "hexagon, peripheries=2",
    "demux": "trapezium, orientation=90",
}


def mermaid(graph: Graph) -> str:
    """Write a graph as a Mermaid flow chart."""
    numbers = {key: f"n{number}" for number, key in enumerate(graph.nodes)}
    lines = ["flowchart LR"]
    for key, node in graph.nodes.items():
        lines.append(mermaid_node(numbers[key], node, "dead" if node.dead else "chosen" if node.chosen else ""))
    lines += [
        mermaid_edge(numbers, graph, edge, "-.->" if edge.dead else "==>" if edge.chosen else "-->")
        for edge in graph.edges
    ]
    lines.append("  classDef dead stroke-dasharray:4,color:#999,stroke:#999,text-decoration:line-through")
    lines.append("  classDef chosen stroke-width:3px")
    return "\n".join(lines) + "\n"


def mermaid_node(number: str, node: Node, look: str) -> str:
    """Write the line of Mermaid for one symbol.

    number: the number that stands for the symbol in the text. look: the name of its style class; empty: none.
    """
    before, after = _BRACKETS[node.kind]
    return f'  {number}{before}"{"<br/>".join(_words(node))}"{after}{f":::{look}" if look else ""}'


def mermaid_edge(numbers: Mapping[str, str], graph: Graph, edge: Edge, arrow: str) -> str:
    """Write one edge of a graph as a line of Mermaid.

    numbers: symbol -> its number in the text. arrow: the arrow as Mermaid writes it.
    """
    return mermaid_arrow(numbers[edge.source], arrow, edge_words(graph, edge), numbers[edge.target])


def mermaid_arrow(source: str, arrow: str, words: str, target: str) -> str:
    """Write an arrow with words on it."""
    label = words.replace("<", "#lt;")  # labels are HTML
    said = f'|"{label}"|' if label else ""
    return f"  {source} {arrow}{said} {target}"


def _words(node: Node) -> Iterator[str]:
    match node.kind:
        case "variable":
            yield f"{node.label}<br/>m = {node.note}"
            return
        case "demux":
            yield "DEMUX"
    yield node.label
    yield from node.note.splitlines()
    for cell in node.cells:
        yield f"<s>{cell.label}</s>" if cell.dead else f"<b>{cell.label}</b>" if cell.chosen else cell.label


def edge_words(graph: Graph, edge: Edge) -> str:
    """Return the words on an edge of a graph: the modes at its ends, and its versions."""
    return "; ".join(_edge_words(graph, edge))


def _edge_words(graph: Graph, edge: Edge) -> Iterator[str]:
    for key, cell in ((edge.source, edge.out_cell), (edge.target, edge.in_cell)):
        if cell is not None:
            yield graph.nodes[key].cells[cell].label.split()[0]
    if edge.label:
        yield edge.label


def dot(graph: Graph) -> str:
    """Write a graph for Graphviz."""
    lines = [
        f'digraph "{graph.name}" {{',
        "  rankdir=LR;",
        '  node [fontname="sans-serif", fontsize=10];',
        '  edge [fontname="sans-serif", fontsize=9];',
    ]
    lines += [f'  "{key}" [{_node_attributes(node)}];' for key, node in graph.nodes.items()]
    for edge in graph.edges:
        ends = " -> ".join((_port(edge.source, edge.out_cell), _port(edge.target, edge.in_cell)))
        attributes = [f'label="{edge.label}"'] if edge.label else []
        attributes += ['style=dashed, color="#999999"'] if edge.dead else ["penwidth=3"] if edge.chosen else []
        lines.append(f"  {ends} [{', '.join(attributes)}];" if attributes else f"  {ends};")
    return "\n".join([*lines, "}"]) + "\n"


def _port(key: str, cell: int | None) -> str:
    return f'"{key}"' if cell is None else f'"{key}":v{cell + 1}'


def _node_attributes(node: Node) -> str:
    attributes = [f"shape={_SHAPES[node.kind]}", f'label="{_dot_label(node)}"']
    if node.dead:
        attributes.append('style=dashed, color="#999999", fontcolor="#999999"')
    elif node.chosen:
        attributes.append("penwidth=3")
    return ", ".join(attributes)


def _dot_label(node: Node) -> str:
    cells = "".join(f"|<v{number}> {cell.label}" for number, cell in enumerate(node.cells, 1))
    name = f"m = {node.note}" if node.kind == "variable" else node.note.replace("\n", "\\n")
    first = "DEMUX\\n" if node.kind == "demux" else ""
    return f"{first}{node.label}\\n{name}{cells}" if name else f"{first}{node.label}{cells}"
