"""The size of a symbol of a drawn graph, and the heights at which edges of the graph meet it, in pixels.

The *box* of a symbol holds everything that belongs to the symbol, its name included. Heights are measured from the top
of the box. A module is drawn as a rectangle with its name in it. If a module has more than one mode, the rectangle also
has a cell for each mode. The name of a variable, a device or a DEMUX stands below its symbol.
"""

from dataclasses import dataclass

from heronry_tools.reports.render.graph import Node

NAME_PX, NOTE_PX = 11, 9  # sizes of type
NAME_LINE, NOTE_LINE, CELL_ROW = 14, 12, 20  # heights of lines
ROUND = 36  # diameter of a variable, and side of a device
GATE_WIDTH = 42
PORT_STEP = 11  # between the inputs of a gate
_LONGEST_LINE = 17  # characters


@dataclass(frozen=True, slots=True)
class Shape:
    """The size of a symbol's box, the size of the body drawn in it, and the symbol's lines of text.

    All sizes are in px.
    """

    width: int
    height: int
    body_width: int
    body_height: int
    name: tuple[str, ...]
    note: tuple[str, ...]
    head: int = 0  # of a module: height above its cells

    def port(self, cell: int | None) -> int:
        """Return the height at which edges meet the symbol, in px below the top of the symbol.

        cell: number of the cell of the module that the edges meet; None: the edges meet the symbol as a whole.
        """
        if cell is not None:
            return self.head + CELL_ROW * cell + CELL_ROW // 2
        return (self.head or self.body_height) // 2


def shape_of(node: Node, inputs: int) -> Shape:
    """Return the shape of a symbol with this number of inputs."""
    if node.kind == "module":
        return _module(node)
    if node.kind in ("and", "or", "xor"):
        height = max(30, PORT_STEP * inputs + 6)
        return Shape(GATE_WIDTH, height, GATE_WIDTH, height, (), ())
    name = wrapped(node.label, "_")
    note = () if node.kind == "variable" else _note(node)
    body = GATE_WIDTH if node.kind == "demux" else ROUND
    width = max(body, _text_width(name, NAME_PX), _text_width(note, NOTE_PX))
    return Shape(width, body + NAME_LINE * len(name) + NOTE_LINE * len(note) + 6, body, body, name, note)


def _module(node: Node) -> Shape:
    name, note = wrapped(node.label, "_"), _note(node)
    text = NAME_LINE * len(name) + NOTE_LINE * len(note) + 10
    cells = tuple(cell.label for cell in node.cells)
    width = max(64, _text_width(name, NAME_PX), _text_width(note, NOTE_PX), _text_width(cells, NAME_PX)) + 14
    height = text + CELL_ROW * len(cells) if cells else max(48, text)
    return Shape(width, height, width, height, name, note, head=text if cells else 0)


def _note(node: Node) -> tuple[str, ...]:
    return tuple(line for note in node.note.splitlines() for line in wrapped(note, " "))


def wrapped(text: str, separator: str) -> tuple[str, ...]:
    """Break a text after separators into lines of limited length; a part without a separator stays whole."""
    lines: list[str] = []
    words = [word + separator for word in text.split(separator)]
    words[-1] = words[-1][: -len(separator)]
    for word in words:
        if lines and len(lines[-1] + word) <= _LONGEST_LINE:
            lines[-1] += word
        else:
            lines.append(word)
    return tuple(line.strip() for line in lines if line.strip())


def _text_width(lines: tuple[str, ...], size_px: int) -> int:
    """Estimate the width of the widest line in a wide sans-serif face; rather too large than too small."""
    return max((len(line) * size_px * 66 // 100 for line in lines), default=0)
