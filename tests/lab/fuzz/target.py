"""What is fuzzed: a name, what takes the bytes, and a few inputs that get far into it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Target:
    """One reader of bytes, or one core.

    run: takes any bytes. What it is allowed to raise for them it catches; whatever comes out of it is a finding.
    seeds: inputs that are read to their end, to begin from; made by the code that writes what is read.
    """

    name: str
    run: Callable[[bytes], None]
    seeds: Callable[[], Iterable[bytes]]


class Story:
    """Bytes as a source of choices: numbers in order, and zeros when they have run out."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def __bool__(self) -> bool:
        """Tell whether there is more."""
        return self._at < len(self._data)

    def number(self, below: int) -> int:
        """Give a number below this bound, from as many bytes as that takes."""
        length = max(1, ((below - 1).bit_length() + 7) // 8)
        return int.from_bytes(self.bytes(length).ljust(length, b"\0"), "big") % below

    def bytes(self, length: int) -> bytes:
        """Give so many bytes, or what is left."""
        self._at += length
        return self._data[self._at - length : self._at]
