"""Readings of all devices in a file that processes share: one process writes it 120 times a second, the others read it.

A reader must never wait for the writer (`heronry_agent.device`). So the file has several slots, and a number at its
head that counts the writes. The writer fills the slot after the newest one, then increments the number. A reader copies
the slot that the number points to. Then it reads the number again. If the writer may have overwritten the slot
meanwhile, the reader copies again.

The file is complete before it gets its name, so a reader finds either all of it or no file.
"""

import json
import mmap
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from heronry_agent.module import Value

_SLOTS = 8
_SLOT_BYTES = 4096
_HEAD = struct.Struct("<Q")
_LENGTH = struct.Struct("<I")
_HEAD_BYTES = 64


class Snapshot(NamedTuple):
    """The readings of all devices at one time."""

    time_ns: int  # on the monotonic clock of this computer
    height_m: float  # of the wheels above the runway
    readings: Mapping[str, Value | None]
    refusing: frozenset[str]  # actuators that take no command


class Writer:
    """Makes the file of the shared readings, and writes snapshots of the readings into it."""

    def __init__(self, file: Path) -> None:
        unfinished = file.with_suffix(".new")
        unfinished.write_bytes(bytes(_HEAD_BYTES + _SLOTS * _SLOT_BYTES))
        with unfinished.open("r+b") as opened:
            self._memory = mmap.mmap(opened.fileno(), 0)
        self._count = 0
        self._file, self._unfinished = file, unfinished

    def write(self, snapshot: Snapshot) -> None:
        """Write the readings of all devices; from then on readers get these readings.

        Raises ValueError if the readings do not fit into a slot.
        """
        readings = {name: value for name, value in snapshot.readings.items() if value is not None}
        form = [snapshot.time_ns, snapshot.height_m, readings, sorted(snapshot.refusing)]
        data = json.dumps(form, separators=(",", ":")).encode()
        if len(data) > _SLOT_BYTES - _LENGTH.size:
            raise ValueError(
                f"the readings of all devices take {len(data)} bytes, too many for a slot of {_SLOT_BYTES} bytes"
            )
        start = _HEAD_BYTES + (self._count + 1) % _SLOTS * _SLOT_BYTES
        self._memory[start : start + _LENGTH.size + len(data)] = _LENGTH.pack(len(data)) + data
        self._count += 1
        self._memory[: _HEAD.size] = _HEAD.pack(self._count)
        if self._count == 1:
            self._unfinished.rename(self._file)


class Reader:
    """Reads the newest snapshot from the file that the writing process shares."""

    def __init__(self, file: Path) -> None:
        """Open the file; raises FileNotFoundError if the writer has not made it yet."""
        with file.open("rb") as opened:
            self._memory = mmap.mmap(opened.fileno(), 0, prot=mmap.PROT_READ)
        self._held: tuple[int, Snapshot] | None = None

    def newest(self) -> Snapshot:
        """Return the snapshot that was written last."""
        while True:
            (count,) = _HEAD.unpack_from(self._memory)
            if self._held is not None and self._held[0] == count:
                return self._held[1]
            start = _HEAD_BYTES + count % _SLOTS * _SLOT_BYTES
            (length,) = _LENGTH.unpack_from(self._memory, start)
            data = self._memory[start + _LENGTH.size : start + _LENGTH.size + min(length, _SLOT_BYTES)]
            (now,) = _HEAD.unpack_from(self._memory)
            if now - count < _SLOTS - 1:
                self._held = count, _snapshot(data)
                return self._held[1]


def _snapshot(data: bytes) -> Snapshot:
    time_ns, height_m, readings, refusing = json.loads(data)
    whole = {name: tuple(value) if isinstance(value, list) else value for name, value in readings.items()}
    return Snapshot(time_ns, height_m, whole, frozenset(refusing))
