"""New inputs from old ones, drawn from a seed: the same seed gives the same inputs, on every machine.

A few blind changes one after the other: a bit, a byte, a number that is often a boundary, a piece that is cut out,
doubled, or taken from another input. Here no input is kept because it reaches new code; `guided` does that.
"""

from collections.abc import Iterator, Sequence
from random import Random

_MOST_CHANGES = 4
_LONGEST_PIECE = 24
_LONGEST = 4_096
_BOUNDARIES = (b"\0", b"\xff", b"\x7f", b"\x80", b"\0\0", b"\xff\xff", b"\x7f\xff", b"\x80\0", b"\0\0\0\0", b"\xff" * 4)
_TEXTS = (b"0", b"-1", b'"', b"{", b"[", b"null", b"1e999", b"9" * 30, b"\n", b": ", b"\xed\xa0\x80", b"\\ud800")


def inputs(seeds: Sequence[bytes], random: Random) -> Iterator[bytes]:
    """Yield the seeds, and then changed inputs without end."""
    yield from seeds
    while True:
        data = bytearray(random.choice(seeds))
        for _ in range(random.randint(1, _MOST_CHANGES)):
            _change(data, seeds, random)
        yield bytes(data[:_LONGEST])


def _change(data: bytearray, seeds: Sequence[bytes], random: Random) -> None:
    at = random.randrange(len(data) + 1)
    piece = random.randrange(1, _LONGEST_PIECE)
    match random.randrange(7):
        case 0 if at < len(data):
            data[at] ^= 1 << random.randrange(8)
        case 1 if at < len(data):
            data[at] = random.randrange(256)
        case 2:
            del data[at : at + piece]
        case 3:
            data[at:at] = data[at : at + piece]
        case 4:
            other = random.choice(seeds)
            start = random.randrange(len(other) + 1)
            data[at : at + piece] = other[start : start + piece]
        case 5:
            boundary = random.choice(_BOUNDARIES)
            data[at : at + len(boundary)] = boundary
        case _:
            data[at:at] = random.choice(_TEXTS) if random.randrange(2) else random.randbytes(piece)
