"""Noise that is the same in every process: a function of a name and a time, and of nothing else.

A generator would have a state, and two processes that read the same device at the same time would differ; a hash has
none. Python's own `hash` of a text changes from process to process, hence BLAKE2.
"""

import hashlib
import math
import struct

_DRAWS = 4
_WORDS = struct.Struct(f">{_DRAWS}H")
_LARGEST = 0xFFFF
# Each draw is uniform on -1..1, with variance 1/3; the sum of four has 4/3.
_ONE_SIGMA = math.sqrt(3.0 / _DRAWS)


def noise(name: str, now_ns: int) -> float:
    """One draw with mean 0 and standard deviation 1, never beyond 3.5: nearly normal, the same in every process."""
    digest = hashlib.blake2b(f"{name}@{now_ns}".encode(), digest_size=_WORDS.size).digest()
    draws: tuple[int, ...] = _WORDS.unpack(digest)
    total = 0.0
    for draw in draws:
        total += 2.0 * draw / _LARGEST - 1.0
    return total * _ONE_SIGMA
