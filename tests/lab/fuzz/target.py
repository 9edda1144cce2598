"""A target of the fuzzer: its name, the function that reads the bytes, and a few inputs that get far into it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Target:
    """One decoder, or one core.

    run: takes any bytes. It catches the exceptions that are allowed; any that leaves it is a finding.
    seeds: the first inputs, each valid to its end, made by the encoder.
    """

    name: str
    run: Callable[[bytes], None]
    seeds: Callable[[], Iterable[bytes]]


class Story:
    """Bytes as a source of choices: numbers in order, and zeros when they have run out."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def __bool__(self) -> bool:
        """Tell whether bytes are left."""
        return self._at < len(self._data)

    def number(self, below: int) -> int:
        """Return a number below this bound, from as few bytes as can hold it."""
        length = max(1, ((below - 1).bit_length() + 7) // 8)
        return int.from_bytes(self.bytes(length).ljust(length, b"\0"), "big") % below

    def bytes(self, length: int) -> bytes:
        """Return `length` bytes, or the rest."""
        self._at += length
        return self._data[self._at - length : self._at]
