"""Reads the events of another process, a manager or a plant, as they come; each event is a line of JSON.

An event is given when its line is complete; the beginning of a line is kept until its end comes.
"""

import json
import os
import select
from typing import IO, Any

_MOST_BYTES = 65536  # what a pipe holds


class EventStream:
    """The events of one process; `select` can wait for them."""

    def __init__(self, pipe: IO[bytes]) -> None:
        """Take over the pipe; no other reader may use it."""
        self._pipe, self._unread = pipe, b""
        self.has_ended = False  # nothing will come any more

    def fileno(self) -> int:
        """Return the descriptor of the pipe; it is readable when `take` has something to read."""
        return self._pipe.fileno()

    def take(self, wait_s: float = 0.0) -> list[dict[str, Any]]:
        """Return the events that have come; where none has, wait up to `wait_s` seconds."""
        if not select.select([self], [], [], wait_s)[0]:
            return []
        chunk = os.read(self.fileno(), _MOST_BYTES)
        self.has_ended = not chunk
        *lines, self._unread = (self._unread + chunk).split(b"\n")
        return [json.loads(line) for line in lines]
