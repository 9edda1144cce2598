"""Reads what another process, a manager or a plant, writes to a pipe, as it comes, line by line.

A line is given when it is complete; the beginning of a line is kept until its end comes.
"""

import os
import select
from typing import IO

from heronry_manager.events import Event
from heronry_manager.events.reading import events_in

_MOST_BYTES = 65536  # what a pipe holds


class LineStream:
    """The lines of one process; `select` can wait for them."""

    def __init__(self, pipe: IO[bytes]) -> None:
        """Take over the pipe; no other reader may use it."""
        self._pipe, self._unread = pipe, b""
        self.has_ended = False  # nothing will come any more

    def fileno(self) -> int:
        """Return the descriptor of the pipe; it is readable when `take` has something to read."""
        return self._pipe.fileno()

    def take(self, wait_s: float = 0.0) -> list[bytes]:
        """Return the lines that have come; where none has, wait up to `wait_s` seconds."""
        if not select.select([self], [], [], wait_s)[0]:
            return []
        chunk = os.read(self.fileno(), _MOST_BYTES)
        self.has_ended = not chunk
        *lines, self._unread = (self._unread + chunk).split(b"\n")
        return lines


class EventStream:
    """The events of a manager's process; `select` can wait for them. Lines that hold no event are left out."""

    def __init__(self, pipe: IO[bytes]) -> None:
        """Take over the pipe; no other reader may use it."""
        self._lines = LineStream(pipe)

    @property
    def has_ended(self) -> bool:
        """Tell whether nothing will come any more."""
        return self._lines.has_ended

    def fileno(self) -> int:
        """Return the descriptor of the pipe; it is readable when `take` has something to read."""
        return self._lines.fileno()

    def take(self, wait_s: float = 0.0) -> list[Event]:
        """Return the events that have come; where none has, wait up to `wait_s` seconds."""
        return list(events_in(self._lines.take(wait_s)))
