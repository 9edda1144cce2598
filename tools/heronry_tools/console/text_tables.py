"""Tables as text: coloured on a terminal that can show colours, plain anywhere else.

Two functions write the same `Table`: one in colour, with the package rich; the other as plain lines, with no
further package. The plain lines are suited to `grep`.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

_BAR = 5  # characters; wide tables must fit narrow terminals


@dataclass(frozen=True, slots=True)
class Bar:
    """A bar that shows a share of a capacity, with a text beside the bar; a share of 1 fills the bar."""

    share: float
    text: str


@dataclass(frozen=True, slots=True)
class Bad:
    """A cell whose value is a problem, shown in red."""

    text: str


Cell = str | Bar | Bad


@dataclass(frozen=True, slots=True)
class Table:
    """A table with one title row."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]


def print_tables(headline: str, tables: Sequence[Table]) -> None:
    """Print a headline and tables to standard output."""
    if not (sys.stdout.isatty() and _print_rich(headline, tables)):
        print(headline)
        for table in tables:
            print()
            print("\n".join(_plain(table)))


def bar(used: int, capacity: int, text: str) -> Bar:
    """Return the bar for a used part of a capacity, in the unit of the capacity; a capacity of 0 gives an empty bar."""
    return Bar(used / capacity if capacity else 0.0, text)


def _plain(table: Table) -> Iterator[str]:
    """Write a table as lines with aligned columns; the last column is not padded."""
    texts = [table.columns, *([_in_words(cell) for cell in row] for row in table.rows)]
    widths = [max(len(row[column]) for row in texts) for column in range(len(table.columns) - 1)]
    for row in texts:
        cells = (text.ljust(width) for text, width in zip(row, [*widths, 0], strict=True))
        yield "  ".join(cells).rstrip()


def _in_words(cell: Cell) -> str:
    match cell:
        case Bar(share, text):
            return f"[{'#' * _filled(share):.<{_BAR}}] {text}"
        case Bad(text):
            return text
        case _:
            return cell


def _filled(share: float) -> int:
    """Return the number of filled cells of a bar; 0 only for a share of 0, all of them only for 1 or more."""
    if share <= 0:
        return 0
    return min(_BAR if share >= 1 else _BAR - 1, max(1, round(share * _BAR)))


def _print_rich(headline: str, tables: Sequence[Table]) -> bool:
    """Print with rich; returns False where rich is not installed."""
    try:
        from rich.box import SIMPLE_HEAD  # noqa: PLC0415 - an extra
        from rich.console import Console  # noqa: PLC0415 - as above
        from rich.table import Table as RichTable  # noqa: PLC0415 - as above
        from rich.text import Text  # noqa: PLC0415 - as above
    except ImportError:
        return False

    def rendered(cell: Cell) -> Text:
        match cell:
            case Bar(share, text):
                colour = "green" if share < 0.7 else "yellow" if share < 0.9 else "red"
                full = _filled(share)
                return Text.assemble(("█" * full, colour), ("░" * (_BAR - full), "dim"), f" {text}")
            case Bad(text):
                return Text(text, style="bold red")
            case _:
                return Text(cell)

    console = Console()
    console.print(Text(headline))
    for table in tables:
        rich_table = RichTable(box=SIMPLE_HEAD, pad_edge=False)
        for column in table.columns:
            rich_table.add_column(column, overflow="fold")
        for row in table.rows:
            rich_table.add_row(*map(rendered, row))
        console.print(rich_table)
    return True
