"""The memory that an agent shares with the process of one device: two rings of entries, and some words.

    word 0   UNTIL   end of validity of the newest command, ns       written by the agent
    word 1   ALIVE   when the process last showed life, ns           written by the process
    word 2   DONE    number of the newest command dealt with         written by the process
    word 6   SETTLES, word 7 LONGEST: times that the driver declares, ns; 0 until the driver has opened its device
    then     COMMANDS, entries of the agent                          then READINGS, entries of the process

A ring has a count and SLOTS slots. A writer fills the next slot and then raises the count; a reader takes the newest
slot. Each slot has the count and a check sum. So a reader notices an entry that was overwritten while it read, that was
not finished, or whose parts another processor core shows in another order; it then has no entry, never a wrong one.
Words are eight bytes at a multiple of eight, and are read and written whole.

The memory has no name (memfd): it is handed to the process as a file descriptor, and ends with the two.
"""

import mmap
import os
import struct
import zlib
from enum import IntEnum
from typing import NamedTuple

from heronry_agent.module import Value

SLOTS = 4
_WORDS, _SLOT_BYTES = 8, 1024
_COUNTS = 4  # first of the words that hold the counts of the rings
_HEAD = struct.Struct("<IHqq")  # check sum of the rest, length of the value, count, time in ns
_RING_BYTES = SLOTS * _SLOT_BYTES
BLOCK_BYTES = 8 * _WORDS + 2 * _RING_BYTES
MOST_BYTES = _SLOT_BYTES - _HEAD.size


class Word(IntEnum):
    """A number in the block that is read and written whole."""

    UNTIL = 0
    ALIVE = 1
    DONE = 2
    SETTLES = 6
    LONGEST = 7


class Ring(IntEnum):
    """The two rings of a block."""

    COMMANDS = 0
    READINGS = 1


class Entry(NamedTuple):
    """One entry of a ring; value None: there is none (a command: take the safe action)."""

    number: int  # 1 for the first entry
    time_ns: int
    value: Value | None


class SharedBlock:
    """The memory, from either side."""

    def __init__(self, descriptor: int) -> None:
        """Map the memory behind a file descriptor, which is not closed; raises OSError or ValueError."""
        self._map = mmap.mmap(descriptor, BLOCK_BYTES)
        self._words = memoryview(self._map)[: 8 * _WORDS].cast("q")

    @staticmethod
    def create() -> int:
        """Make the memory, all zeros; returns its file descriptor. Raises OSError."""
        descriptor = os.memfd_create("heronry-device")
        os.ftruncate(descriptor, BLOCK_BYTES)
        return descriptor

    def __getitem__(self, word: Word) -> int:
        return self._words[word]

    def __setitem__(self, word: Word, number: int) -> None:
        self._words[word] = number

    def put(self, ring: Ring, time_ns: int, value: Value | None) -> None:
        """Add an entry; raises ValueError for what is no value, and for a value of more than MOST_BYTES bytes."""
        data = encode_value(value)
        count = self._words[_COUNTS + ring] + 1
        start = self._start(ring, count)
        rest = _HEAD.pack(0, len(data), count, time_ns)[4:] + data
        self._map[start : start + 4 + len(rest)] = struct.pack("<I", zlib.crc32(rest)) + rest
        self._words[_COUNTS + ring] = count

    def newest(self, ring: Ring) -> Entry | None:
        """Return the newest entry; None if there is none that can be read."""
        for _ in range(SLOTS):  # the writer may overtake a reader that was paused
            count = self._words[_COUNTS + ring]
            entry = self._read(self._start(ring, count), count) if count > 0 else None
            if entry is not None or count == self._words[_COUNTS + ring]:
                return entry
        return None

    def count(self, ring: Ring) -> int:
        """Number of entries so far, as the writer says."""
        return self._words[_COUNTS + ring]

    def _read(self, start: int, count: int) -> Entry | None:
        slot = self._map[start : start + _SLOT_BYTES]
        proof, length, its_count, time_ns = _HEAD.unpack_from(slot)
        if length > MOST_BYTES or its_count != count or zlib.crc32(slot[4 : _HEAD.size + length]) != proof:
            return None
        try:
            return Entry(count, time_ns, decode_value(slot[_HEAD.size : _HEAD.size + length]))
        except ValueError:
            return None

    @staticmethod
    def _start(ring: Ring, count: int) -> int:
        return 8 * _WORDS + ring * _RING_BYTES + count % SLOTS * _SLOT_BYTES

    def close(self) -> None:
        """Unmap the memory."""
        self._words.release()
        self._map.close()


def encode_value(value: object) -> bytes:
    """Encode a value; raises ValueError for what is no value, and for a value of more than MOST_BYTES bytes."""
    try:
        data = _encoded(value)
    except (struct.error, UnicodeError):
        raise ValueError(f"{value!r:.60} has a number of more than 64 bits, or a text that cannot be written") from None
    if len(data) > MOST_BYTES:
        raise ValueError(f"a value has {len(data)} bytes, and may have at most {MOST_BYTES}")
    return data


def _encoded(value: object) -> bytes:
    match value:
        case None:
            return b"n"
        case float():
            return b"f" + struct.pack("<d", value)
        case int():
            return b"i" + struct.pack("<q", value)
        case str():
            return b"s" + value.encode()
        case bytes():
            return b"b" + value
        case tuple() if all(isinstance(item, int) for item in value):
            return b"t" + struct.pack(f"<{len(value)}q", *value)
    raise ValueError(f"{value!r:.60} is no value: use int, float, str, bytes or a tuple of int")


def decode_value(data: bytes) -> Value | None:
    """Decode what `encode_value` gives; raises ValueError for anything else."""
    kind, rest = data[:1], data[1:]
    try:
        match kind:
            case b"n" if not rest:
                return None
            case b"f":
                (number,) = struct.unpack("<d", rest)
                return float(number)
            case b"i":
                (whole,) = struct.unpack("<q", rest)
                return int(whole)
            case b"s":
                return rest.decode()
            case b"b":
                return rest
            case b"t":
                return struct.unpack(f"<{len(rest) // 8}q", rest)
            case _:
                pass
    except struct.error:
        pass
    raise ValueError("the bytes are no value")
