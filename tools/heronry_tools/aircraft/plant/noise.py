"""Noise that is the same in every process: a function of a name and a time.

A random generator has a state, so two processes that read one device at one time would get different noise. A hash has
no state. Python's own `hash` of a text differs between processes; hence BLAKE2.
"""

import hashlib
import math
import struct

_DRAWS = 4
_WORDS = struct.Struct(f">{_DRAWS}H")
_LARGEST = 0xFFFF
# Each draw is uniform on -1..1 with variance 1/3; the sum of four draws has variance 4/3.
_ONE_SIGMA = math.sqrt(3.0 / _DRAWS)


def noise(name: str, now_ns: int) -> float:
    """Return a nearly normal value with mean 0 and standard deviation 1, never beyond 3.5.

    The same name and time give the same value in every process.
    """
    digest = hashlib.blake2b(f"{name}@{now_ns}".encode(), digest_size=_WORDS.size).digest()
    draws: tuple[int, ...] = _WORDS.unpack(digest)
    total = 0.0
    for draw in draws:
        total += 2.0 * draw / _LARGEST - 1.0
    return total * _ONE_SIGMA
