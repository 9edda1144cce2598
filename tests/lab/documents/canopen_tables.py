"""The object dictionary of a PE, from the table that the agent serves."""

from collections.abc import Iterator

from heronry_wire.canopen_objects import MOST_ELEMENTS, OBJECTS, Entry, Kind, Variable
from lab.documents.markdown import table


def objects() -> str:
    """Return every object, and every sub-index that differs from the others of its object."""
    rows = [row for entry in OBJECTS for row in _rows(entry)]
    return table(["index", "sub-index", "name", "type", "access", "value", "meaning"], rows)


def _rows(entry: Entry) -> Iterator[list[str]]:
    index = f"{entry.index:04X}h"
    if entry.kind in (Kind.VAR, Kind.DOMAIN):
        yield [index, "", *_cells(entry.variables[0])]
        return
    yield [index, "", entry.name, "", "", "", entry.meaning]
    if entry.count is not None:
        yield ["", "0", *_cells(entry.count)]
    if entry.kind is Kind.ARRAY:
        last = "n" if entry.most == MOST_ELEMENTS else str(entry.most)
        yield ["", "1" if entry.most == 1 else f"1..{last}", *_cells(entry.variables[0])]
        return
    for sub_index, variable in enumerate(entry.variables, start=1):
        yield ["", str(sub_index), *_cells(variable)]


def _cells(variable: Variable) -> list[str]:
    value = variable.value
    shown = f"{value:X}h" if isinstance(value, int) and variable.of_node else "" if value is None else str(value)
    if variable.of_node:
        shown += " + node-ID"
    return [variable.name, variable.type.name, variable.access.value, shown, variable.meaning]
