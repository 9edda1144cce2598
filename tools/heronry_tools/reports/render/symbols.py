"""The symbols of a dependency graph as SVG elements, after the paper by Rawashdeh et al. (docs/semantics.md).

Figure 1 of the paper shows modules and variables, Figure 2 the gates, and Figure 3 the devices.

Each symbol has a box, and is drawn in it. A module has a cell for each mode; the cell of the running mode is filled. A
symbol may have a mark:

    dead     crossed out: the module cannot run, the gate cannot hold, or no module can give the variable
    chosen   bold lines: in the plan the module runs, the gate holds, or the variable is given
"""

from collections.abc import Iterator
from xml.sax.saxutils import escape, quoteattr

from heronry_tools.reports.render.graph import Node
from heronry_tools.reports.render.layout import Box
from heronry_tools.reports.render.shapes import CELL_ROW, NAME_LINE, NOTE_LINE


def symbol(node: Node, box: Box, *, crossed: bool) -> Iterator[str]:
    """Yield the lines of SVG for one symbol; `crossed`: draw a diagonal line across the symbol."""
    set_marks = (("dead", node.dead), ("chosen", node.chosen), ("again", node.again))
    marks = "".join(f" {name}" for name, set_ in set_marks if set_)
    attribute = "data-again" if node.again else "data-key"  # a key is unique in a picture
    yield f"<g class={quoteattr(f'node {node.kind}{marks}')} {attribute}={quoteattr(node.key)}>"
    yield f"<title>{escape(_title(node))}</title>"
    yield from _module(node, box) if node.kind == "module" else _small(node, box)
    if crossed:
        x, width, height = _body_x(box), box.shape.body_width, box.shape.body_height
        yield f'<path class="crossed" d="M{x - 4},{box.y + height + 4}L{x + width + 4},{box.y - 4}"/>'
    yield "</g>"


def _title(node: Node) -> str:
    words = f"{node.key.partition(':')[2]}: {node.label}" if node.key.startswith("gate:") else node.label
    return f"{node.kind} {words}"


def _body_x(box: Box) -> int:
    return box.x + (box.shape.width - box.shape.body_width) // 2


def _module(node: Node, box: Box) -> Iterator[str]:
    shape = box.shape
    yield f'<rect class="body" x="{box.x}" y="{box.y}" width="{shape.width}" height="{shape.height}"/>'
    middle = box.x + shape.width // 2
    text = NAME_LINE * len(shape.name) + NOTE_LINE * len(shape.note)
    yield from _lines(box, middle, box.y + ((shape.head or shape.height) - text) // 2)
    for number, cell in enumerate(node.cells):
        y = box.y + shape.head + CELL_ROW * number
        marks = "".join(f" {name}" for name, set_ in (("dead", cell.dead), ("chosen", cell.chosen)) if set_)
        yield f'<rect class="cell{marks}" x="{box.x}" y="{y}" width="{shape.width}" height="{CELL_ROW}"/>'
        yield f'<text class="name{marks}" x="{middle}" y="{y + 14}">{escape(cell.label)}</text>'


def _small(node: Node, box: Box) -> Iterator[str]:
    """Draw a symbol that is not a module; its name, if the symbol shows one, stands below."""
    x, y, width, height = _body_x(box), box.y, box.shape.body_width, box.shape.body_height
    middle, level = x + width // 2, y + height // 2
    inside = node.label
    match node.kind:
        case "variable":
            yield f'<circle class="body" cx="{middle}" cy="{level}" r="{width // 2}"/>'
            inside = node.note
        case "sensor" | "actuator":
            inside = ""
            yield f'<path class="body" d="M{x},{y}L{x + width},{level}L{x},{y + height}Z"/>'
        case "and":
            bend = x + width // 2
            bow = f"C{x + width + 7},{y} {x + width + 7},{y + height} {bend},{y + height}"
            yield f'<path class="body" d="M{x},{y}H{bend}{bow}H{x}Z"/>'
        case "demux":
            inside = "DEMUX"
            lower, upper = y + height - 9, y + 9
            yield f'<path class="body" d="M{x},{upper}L{x + width},{y}V{y + height}L{x},{lower}Z"/>'
        case _:
            yield f'<path class="body" d="{_shield(x, y, width, height)}"/>'
            if node.kind == "xor":
                yield f'<path class="line" d="M{x - 5},{y}Q{x + 4},{level} {x - 5},{y + height}"/>'
    if inside:
        size = "inside" if len(inside) < 4 else "inside small"
        yield f'<text class="{size}" x="{middle}" y="{level + 4}">{escape(inside)}</text>'
    yield from _lines(box, box.x + box.shape.width // 2, y + height + 2)


def _shield(x: int, y: int, width: int, height: int) -> str:
    """Return the outline of an OR gate: hollow at its inputs, pointed at its output."""
    right, level, bend = x + width, y + height // 2, x + width * 2 // 3
    return (
        f"M{x},{y}H{x + width // 3}Q{bend},{y} {right},{level}Q{bend},{y + height} {x + width // 3},{y + height}"
        f"H{x}Q{x + 9},{level} {x},{y}Z"
    )


def _lines(box: Box, middle: int, top: int) -> Iterator[str]:
    """Write the lines of the name of a symbol, and below them the lines of the symbol's note."""
    for line in box.shape.name:
        yield f'<text class="name" x="{middle}" y="{top + 11}">{escape(line)}</text>'
        top += NAME_LINE
    for line in box.shape.note:
        yield f'<text class="note" x="{middle}" y="{top + 9}">{escape(line)}</text>'
        top += NOTE_LINE
