"""Readers of the manager's events, on the operator's socket: each gets a status first, then every event as a line.

    order of the reader         {"v": 1, "do": "follow"}
    lines from the manager      {"v": 1, "t_ns": ..., "event": "status", "status": {...}, "plan": {...}, "bus": ...}
                                {"v": 1, "t_ns": ..., "event": "pe_lost", ...}

A slow reader does not delay the manager: no call here blocks. Lines that the kernel does not take wait in a queue, one
for each reader, of at most LONGEST_QUEUE_BYTES. Once a queue is full, all further lines for its reader are dropped and
counted, until the reader has read all lines in the queue. Then the reader gets an event `lines_lost` with the number of
dropped lines, and a new status.
"""

import contextlib
import socket
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from heronry_manager.events import Event, LinesLost
from heronry_manager.events import Status as StatusEvent
from heronry_manager.events.line import to_line

MOST_FOLLOWERS = 16
LONGEST_QUEUE_BYTES = 512 * 1024

Status = Callable[[], StatusEvent]


@dataclass(slots=True)
class _Follower:
    waiting: deque[bytes] = field(default_factory=deque)
    waiting_bytes: int = 0
    needs_status: bool = True
    dropped: int = 0  # lines dropped since the queue was full

    def put(self, line: bytes) -> None:
        if self.needs_status or self.dropped or self.waiting_bytes + len(line) > LONGEST_QUEUE_BYTES:
            self.dropped += not self.needs_status
            return
        self.waiting.append(line)
        self.waiting_bytes += len(line)

    def sent(self, count: int) -> None:
        self.waiting_bytes -= count
        rest = self.waiting.popleft()[count:]
        if rest:
            self.waiting.appendleft(rest)


class Followers:
    """Sends the events of one manager to all readers on its socket."""

    def __init__(self) -> None:
        self._of: dict[socket.socket, _Follower] = {}

    def take(self, caller: socket.socket) -> bool:
        """Make a caller a reader from now on; returns False if there are MOST_FOLLOWERS readers already."""
        if len(self._of) >= MOST_FOLLOWERS:
            return False
        self._of[caller] = _Follower()
        return True

    def readers(self) -> list[socket.socket]:
        """Return the sockets of all readers; a socket becomes readable when its reader closes the connection."""
        return list(self._of)

    def writers(self) -> list[socket.socket]:
        """Return the sockets for which lines wait; each becomes writable when its reader reads earlier lines."""
        return [one for one, follower in self._of.items() if follower.waiting]

    def heard(self, caller: socket.socket) -> None:
        """Drop a reader that has closed its connection, and ignore what a reader sends.

        For a caller that is no reader this has no effect.
        """
        if caller not in self._of:
            return
        with contextlib.suppress(BlockingIOError):
            try:
                is_over = not caller.recv(4096)
            except ConnectionError:
                is_over = True
            if is_over:
                self._drop(caller)

    def tell(self, event: Event) -> None:
        """Queue an event for every reader; `pump` sends it."""
        if self._of:
            line = _line(event)
            for follower in self._of.values():
                follower.put(line)

    def pump(self, status: Status) -> None:
        """Send what the kernel takes, without waiting; `status` makes the first line for a new reader."""
        for caller, follower in list(self._of.items()):
            if follower.waiting:
                self._send(caller, follower)
            if not follower.waiting and (follower.dropped or follower.needs_status) and caller in self._of:
                self._begin(follower, status)
                self._send(caller, follower)

    def close(self) -> None:
        """Close the connections of all readers."""
        for caller in list(self._of):
            self._drop(caller)

    def _begin(self, follower: _Follower, status: Status) -> None:
        first, lost = status(), follower.dropped
        follower.needs_status, follower.dropped = False, 0
        if lost:
            follower.put(_line(LinesLost(first.t_ns, lost)))
        follower.put(_line(first))

    def _send(self, caller: socket.socket, follower: _Follower) -> None:
        try:
            while follower.waiting:
                follower.sent(caller.send(follower.waiting[0]))
        except BlockingIOError:
            return
        except OSError:
            self._drop(caller)

    def _drop(self, caller: socket.socket) -> None:
        del self._of[caller]
        caller.close()


def _line(event: Event) -> bytes:
    return to_line(event).encode() + b"\n"
