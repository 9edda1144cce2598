"""The standard identifiers 300..1499: name, types, unit and notes.

This file looks up the default identifier distribution of CANaerospace V1.7, sections 5.1 to 5.10, which is stored in
`nod.csv` beside this file; the head of `nod.csv` names the source and the corrections. The list is read at the first
look-up, so an agent that needs no look-up never reads it.

An identifier that is not in the list is reserved or not assigned, and a spec must not give it to a variable.
"""

import csv
from functools import cache
from importlib.resources import files
from typing import NamedTuple

from heronry_wire.canaerospace import DataType


class StandardIdentifier(NamedTuple):
    """One row of the default identifier distribution."""

    can_id: int
    name: str
    types: tuple[DataType, ...]
    unit: str  # as the specification prints it; empty where there is none
    notes: str

    @property
    def byte_2_is_an_index(self) -> bool:
        """Whether byte 2 numbers a waypoint, tyre or brake, so that it cannot carry version and validity."""
        return self.notes.startswith("service code field contains")


def standard_identifier(can_id: int) -> StandardIdentifier | None:
    """Look up an identifier; None when the list does not assign it."""
    return standard_identifiers().get(can_id)


@cache
def standard_identifiers() -> dict[int, StandardIdentifier]:
    """Return the whole list by identifier; one shared dict, to be read only."""
    text = files(__package__).joinpath("nod.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    return {int(row["id"]): _from_row(row) for row in rows}


def _from_row(row: dict[str, str]) -> StandardIdentifier:
    types = tuple(DataType[name] for name in row["types"].split("|"))
    return StandardIdentifier(int(row["id"]), row["name"], types, row["unit"], row["notes"])
