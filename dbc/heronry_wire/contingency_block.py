"""The contingencies that a PE has on board: its slices of configurations to which the manager refers by number.

Numbers are as in `packing`. Most contingencies do not change most PEs, so equal slices are kept once:

    number of different slices, then for each: its length and its bytes
    number of contingencies, then for each, from number 1: index of its slice
    number of bytes of all digests, then three bytes for each contingency: digest of the whole configuration, most
    significant byte first

The digest proves that the manager and the PE mean the same configuration by a number. If the block was made
from other contingencies or another spec than those of the manager, the digest under the number differs, and the PE
stages nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from heronry_wire.packing import PackingError, Unpacker, pack

_DIGEST_BYTES = 3


@dataclass(frozen=True, slots=True)
class Preloaded:
    """One PE's slice of a configuration, and the digest of the whole configuration (24 bits)."""

    slice: bytes
    digest: int


def write_block(contingencies: Sequence[Preloaded]) -> bytes:
    """Encode contingencies as the block that a PE keeps; the first of them has number 1.

    Without contingencies the block is empty.
    """
    if not contingencies:
        return b""
    different = {body: index for index, body in enumerate(dict.fromkeys(one.slice for one in contingencies))}
    bodies = b"".join(pack([len(body)]) + body for body in different)
    digests = b"".join(one.digest.to_bytes(_DIGEST_BYTES, "big") for one in contingencies)
    indices = pack([len(contingencies), *(different[one.slice] for one in contingencies)])
    return pack([len(different)]) + bodies + indices + pack([len(digests)]) + digests


def read_block(block: bytes) -> tuple[Preloaded, ...]:
    """Decode a block that `write_block` wrote; raises PackingError."""
    if not block:
        return ()
    numbers = Unpacker(block)
    slices = [numbers.text() for _ in range(numbers.number())]
    indices = numbers.numbers()
    digests = numbers.text()
    if numbers.left() or len(digests) != _DIGEST_BYTES * len(indices) or max(indices, default=0) >= len(slices):
        raise PackingError("a contingency on board lacks its slice or its digest, or bytes follow the last contingency")
    return tuple(
        Preloaded(slices[index], int.from_bytes(digests[at * _DIGEST_BYTES : (at + 1) * _DIGEST_BYTES], "big"))
        for at, index in enumerate(indices)
    )
