"""The bytes of what comes in parts: a bundle (object 2030h of a PE, docs/code.md), a table (2026h, docs/canopen.md).

A part says to which whole it belongs, by SHA-256 and length, and where in the whole it begins. So a transfer goes on
after an interruption, whoever sends the rest. This file keeps no state.
"""

import struct
from typing import NamedTuple, Self

_PART = struct.Struct("<32sII")
_RECEIVED = struct.Struct("<32sI")


class Transfer(NamedTuple):
    """What is being transferred: the SHA-256 of the whole (32 bytes), and how many bytes it has."""

    digest: bytes
    length: int


class Part(NamedTuple):
    """Some bytes of the whole, from index `at` on."""

    transfer: Transfer
    at: int
    data: bytes

    def encode(self) -> bytes:
        """Return the value that is written into sub-index 1."""
        return _PART.pack(self.transfer.digest, self.transfer.length, self.at) + self.data

    @classmethod
    def decode(cls, content: bytes) -> Self | None:
        """Read a value that was written into sub-index 1; None where it is no part."""
        if len(content) <= _PART.size:
            return None
        digest, length, at = _PART.unpack_from(content)
        return cls(Transfer(digest, length), at, content[_PART.size :])


class Received(NamedTuple):
    """How far a transfer has come: the SHA-256 of its whole, and the bytes that came in order."""

    digest: bytes
    length: int

    def encode(self) -> bytes:
        """Return the value that is read from sub-index 2."""
        return _RECEIVED.pack(self.digest, self.length)

    @classmethod
    def decode(cls, value: bytes) -> Self | None:
        """Read the value of sub-index 2; None where it is none."""
        return cls(*_RECEIVED.unpack(value)) if len(value) == _RECEIVED.size else None
