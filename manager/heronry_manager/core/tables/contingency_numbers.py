"""Which contingencies fit into the PEs themselves, and the number of each (protocol rule 5).

A PE that holds its slice of a configuration needs no SLICE frames for it: PREPARE gives the number of the
configuration. Configurations are numbered by their importance, the most important first. A PE holds configurations 1
to N, where N is the greatest number for which its `table_bytes` have room; N is 4095 at most, since PREPARE has 12 bits
for the number. For all other configurations the manager sends slices.

The manager works out from its own file what every PE holds. A PE whose table has no contingencies, or was made from
another file, reports that its slice is not on board, and gets the slice (`epoch`). So manager and PEs need
not agree beforehand, and no PE stages another configuration than the manager means.
"""

from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_manager.contingency.configuration_code import ConfigurationCode
from heronry_manager.contingency.contingencies import Contingencies
from heronry_manager.core.tables.compilation import Compiler
from heronry_wire.compressed_table import compressed
from heronry_wire.contingency_block import Preloaded, write_block
from heronry_wire.pe_table import PeTable

MOST_NUMBERS = 4095  # 12 bits in PREPARE, without 0


@dataclass(frozen=True, slots=True)
class OnBoard:
    """The contingencies that one PE has on board.

    held: the PE has its slices of the configurations numbered 1 to `held`.
    block: these slices, encoded.
    room: bytes that the PE's table has for them.
    """

    pe: str
    held: int
    block: bytes
    room: int  # bytes


class ContingencyNumbers:
    """Gives the number of each configuration on board, and tells which PEs hold their slice of it."""

    def __init__(self, spec: Spec, made: Contingencies, held: Iterable[OnBoard]) -> None:
        self._code = ConfigurationCode(spec)
        self._called = made.configurations[:MOST_NUMBERS]
        self._numbers = {self._code.encode(one): number for number, one in enumerate(self._called, start=1)}
        self._held = {one.pe: one.held for one in held}

    def number(self, configuration: Configuration) -> int:
        """Return the number by which PREPARE can name a configuration; 0: it has none."""
        return self._numbers.get(self._code.encode(configuration), 0)

    def configuration(self, number: int) -> Configuration | None:
        """Return the configuration with this number; None: there is none."""
        return self._called[number - 1] if 0 < number <= len(self._called) else None

    def holds(self, pe: str, number: int) -> bool:
        """Tell whether a PE has its slice of a configuration on board, if its table comes from this manager's file."""
        return 0 < number <= self._held[pe]

    def status(self) -> dict[str, Any]:
        """Return how many plans were made ahead (`plans`), and for how many a PE has its slice (`on_board`, by PE)."""
        return {"plans": len(self._called), "on_board": dict(self._held)}


def on_board(spec: Spec, made: Contingencies) -> list[OnBoard]:
    """Return the slices of contingencies for every PE: as many as its table has room for."""
    compiler = Compiler(spec)
    compiled = [compiler.configuration(one) for one in made.configurations[:MOST_NUMBERS]]
    return [
        _filled(pe.name, [Preloaded(one.slices[pe.node_id], one.digest) for one in compiled], pe.table_bytes)
        for pe in spec.pes.values()
    ]


def loaded(table: PeTable, one: OnBoard) -> PeTable:
    """Return a PE's table with the contingencies `one`, which replace those that the table had."""
    return replace(table, contingencies=b64encode(one.block).decode())


class PeTables:
    """Gives the text of each PE's table, with the contingencies that it holds on board."""

    def __init__(self, compiler: Compiler, held: Iterable[OnBoard]) -> None:
        """Take the compiler of a spec, and what the PEs hold; `held` has no entry for a PE without contingencies."""
        self._compiler, self._held = compiler, {one.pe: one for one in held}

    def text(self, pe: str) -> str:
        """Return the text of a PE's table."""
        table = self._compiler.table(pe)
        return (loaded(table, self._held[pe]) if pe in self._held else table).to_json()

    def contents(self) -> dict[str, bytes]:
        """Return the table of every PE as it goes over the bus, by name; this takes some milliseconds for each."""
        return {pe: compressed(self.text(pe)) for pe in self._compiler.pes}


def _filled(pe: str, slices: Sequence[Preloaded], room: int) -> OnBoard:
    """Encode as many slices, from the first on, as fit into `room` bytes."""
    fits, too_many = 0, len(slices) + 1
    while too_many - fits > 1:
        middle = (fits + too_many) // 2
        if len(write_block(slices[:middle])) <= room:
            fits = middle
        else:
            too_many = middle
    return OnBoard(pe, fits, write_block(slices[:fits]), room)
