"""Which contingencies fit into the PEs themselves.

A PE that holds its slice of a configuration needs no SLICE frames when the configuration is wanted: its number, in
PREPARE, is enough. Configurations are numbered in the order in which they are wanted on board, so a PE holds those from
1 to as far as its `table_bytes` reach (and PREPARE's 12 bits). Beyond them the manager sends slices as ever.

The block that a PE gets (numbers as in `heronry_wire.packing`; most contingencies leave most PEs alone, so slices are
kept once):

    number of different slices, then for each: its length and its bytes
    number of contingencies, then for each, from number 1: index of its slice
"""

from collections.abc import Sequence
from dataclasses import dataclass

from heronry_dg.model import Spec
from heronry_manager.compilation import Compiler
from heronry_manager.contingency.contingencies import Contingencies
from heronry_wire.packing import pack

MOST_NUMBERS = 4095  # 12 bits in PREPARE, without 0


@dataclass(frozen=True, slots=True)
class OnBoard:
    """What one PE holds: the slices of the configurations numbered 1 to `held`."""

    pe: str
    held: int
    block: bytes
    room: int  # bytes


def on_board(spec: Spec, made: Contingencies) -> list[OnBoard]:
    """Fill every PE as far as it goes."""
    compiler = Compiler(spec)
    compiled = [compiler.configuration(one).slices for one in made.configurations[:MOST_NUMBERS]]
    return [_filled(pe.name, [slices[pe.node_id] for slices in compiled], pe.table_bytes) for pe in spec.pes.values()]


def _filled(pe: str, slices: Sequence[bytes], room: int) -> OnBoard:
    """Hold as many of the first slices as there is room for: one more never takes less room."""
    fits, too_many = 0, len(slices) + 1
    while too_many - fits > 1:
        middle = (fits + too_many) // 2
        if len(block(slices[:middle])) <= room:
            fits = middle
        else:
            too_many = middle
    return OnBoard(pe, fits, block(slices[:fits]) if fits else b"", room)


def block(slices: Sequence[bytes]) -> bytes:
    """Write the slices of the contingencies from number 1 on as a PE keeps them."""
    different = {body: index for index, body in enumerate(dict.fromkeys(slices))}
    bodies = b"".join(pack([len(body)]) + body for body in different)
    return pack([len(different)]) + bodies + pack([len(slices), *(different[body] for body in slices)])
