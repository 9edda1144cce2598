"""Writes a folder of `heronry record` (`recorded_folder`): frames and events of a live feed, in rotating files.

The files come in pairs: one with frames, one with events. The folder never exceeds its limit: before a new pair is
begun, the oldest pairs are deleted until there is room for the new one. The events of each pair but the first begin
with the event `resumed`. It holds the whole snapshot, so that a reader needs no earlier pair.

Each call of `write` hands its frames and events to the kernel, so they are kept even if this process is killed
afterwards.
"""

import json
import time
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from heronry_dg.model import Spec
from heronry_manager.events import Event, Resumed
from heronry_manager.events.line import to_line
from heronry_tools.console.errors import UserError
from heronry_tools.recording.recorded_folder import EVENTS_SUFFIX, FORMAT, FRAMES_SUFFIX, HEAD
from heronry_tools.watch.reducer import Reducer
from heronry_tools.watch.snapshot import Source, document
from heronry_wire.command_parser import program_version
from heronry_wire.frame import LoggedFrame, format_log_line

PAIRS = 8  # pairs of files for which the limit has room
LEAST_BYTES = 16_000_000  # least limit: a pair then holds much more than the snapshot with which it begins


_DIGITS = 8  # of the number of a pair in the names of its files


class Recorder:
    """Writes the frames and events of a live feed to one folder of `heronry record`."""

    def __init__(self, folder: Path, spec: Spec, source: Source, spec_text: bytes, limit_bytes: int) -> None:
        """Begin a folder, which must be empty or new; raises UserError if it is neither, or cannot be written.

        limit_bytes: largest size of the whole folder; LEAST_BYTES or more.
        """
        self._folder, self._reducer = folder, Reducer(spec)
        self._state = self._reducer.start(source)
        self._pair_bytes, self._limit_bytes = limit_bytes // PAIRS, limit_bytes
        self._number = 0
        self._written = 0  # bytes of the present pair
        self._offset_ns = time.time_ns() - time.monotonic_ns()
        self._frames: IO[bytes]
        self._events: IO[bytes]
        self._begin_folder(spec, source, spec_text)
        self._begin_pair()

    def write(self, frames: Iterable[LoggedFrame], events: Iterable[Event]) -> None:
        """Write frames and events; raises UserError where the disk does not take them."""
        try:
            for logged in frames:
                date = LoggedFrame(logged.time_ns + self._offset_ns, logged.channel, logged.frame)
                self._put(self._frames, format_log_line(date))
            for event in events:
                self._state = self._reducer.after(self._state, event)
                self._put(self._events, to_line(event))
            self._frames.flush()
            self._events.flush()
            if self._written >= self._pair_bytes:
                self._end_pair()
                self._begin_pair()
        except OSError as error:
            raise UserError(
                f"{self._folder} cannot be written any further ({error.strerror}); it holds the flight up to now: make "
                "room, and record into a new folder"
            ) from error

    def close(self) -> None:
        """Close the two files that are being written: the one of the frames, and the one of the events."""
        self._end_pair()

    def _begin_folder(self, spec: Spec, source: Source, spec_text: bytes) -> None:
        folder = self._folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise UserError(f"{folder} is not empty: name a new folder, so that no flight is mixed with another")
            name = f"{spec.name}.dg.yaml"
            (folder / name).write_bytes(spec_text)
            head = {
                "v": FORMAT,
                "heronry": program_version(),
                "spec": spec.name,
                "spec_digest": spec.digest,
                "spec_file": name,
                "source": source,
                "began": datetime.now(UTC).isoformat(timespec="milliseconds"),
                "date_offset_ns": self._offset_ns,
                "limit_bytes": self._limit_bytes,
            }
            (folder / HEAD).write_text(json.dumps(head, indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            raise UserError(f"{folder} cannot be written: {error.strerror}; name another folder") from error

    def _put(self, stream: IO[bytes], line: str) -> None:
        data = line.encode() + b"\n"
        stream.write(data)
        self._written += len(data)

    def _begin_pair(self) -> None:
        self._make_room()
        self._number += 1
        self._written = 0
        name = self._folder / f"{self._number:0{_DIGITS}}"
        self._frames = name.with_suffix(FRAMES_SUFFIX).open("wb")
        self._events = name.with_suffix(EVENTS_SUFFIX).open("wb")
        if self._number > 1:
            view, plan = self._state.snapshot, self._state.running.plan
            self._put(self._events, to_line(Resumed(view.t_ns, document(view), plan)))

    def _end_pair(self) -> None:
        for stream in (self._frames, self._events):
            with suppress(OSError):
                stream.close()

    def _make_room(self) -> None:
        """Delete the oldest pairs of files until there is room for the next one."""
        sizes = {file: file.stat().st_size for file in sorted(self._folder.iterdir())}
        pairs = sorted({file.name[:_DIGITS] for file in sizes if file.name.endswith((FRAMES_SUFFIX, EVENTS_SUFFIX))})
        while pairs and sum(sizes.values()) + 2 * self._pair_bytes > self._limit_bytes:
            oldest = pairs.pop(0)
            for file in [one for one in sizes if one.name.startswith(oldest)]:
                file.unlink()
                del sizes[file]
