"""Whole numbers in as few bytes as possible: seven bits a byte, the least significant group first."""

from collections.abc import Iterable


class PackingError(ValueError):
    """The bytes end too early, or a number has more than 70 bits."""


def pack(numbers: Iterable[int]) -> bytes:
    """Encode numbers of 0 or more, one after the other."""
    out = bytearray()
    for number in numbers:
        rest = number
        while rest > 0x7F:
            out.append(rest & 0x7F | 0x80)
            rest >>= 7
        out.append(rest)
    return bytes(out)


class Unpacker:
    """Decodes bytes that `pack` has made, from the first to the last."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def number(self) -> int:
        """Read one number of at most 70 bits; raises PackingError."""
        number = shift = 0
        while self._at < len(self._data) and shift < 70:
            byte = self._data[self._at]
            self._at += 1
            number |= (byte & 0x7F) << shift
            if byte < 0x80:
                return number
            shift += 7
        raise PackingError("a number is cut off, or has more than 70 bits")

    def numbers(self) -> list[int]:
        """Decode a number n, and return the n numbers that follow it; raises PackingError."""
        return [self.number() for _ in range(self.number())]

    def text(self) -> bytes:
        """Decode a number n, and return the n bytes that follow it; raises PackingError."""
        length = self.number()
        found = self._data[self._at : self._at + length]
        if len(found) < length:
            raise PackingError("an entry is cut off")
        self._at += length
        return found

    def left(self) -> int:
        """Number of bytes that have not been decoded yet."""
        return len(self._data) - self._at
