"""The command socket of a client of a software bus: it offers frames to the hub, and gives the hub commands.

A client has a mailbox for one frame. The mailbox is full from the offer of a frame until the client has read
the hub's `DONE`; only then the next frame may be offered. A `DONE` is read when a caller sends, gives a command,
or waits for the mailbox. The hub gives one answer to each command.

Threads may share a link: a lock allows one send or command at a time. The time spent waiting for the lock counts
towards the caller's time-out. With the time-out None a call waits for ever, with 0 not at all.

If the hub is gone (the socket ends) or refuses this client, a call raises CanOperationError of python-can with a
sentence. If the process of the hub still exists but does not run (SIGSTOP), offers time out, and commands time
out after `_ANSWER_TIMEOUT_S`.
"""

import errno
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from heronry_tools.runtime.softbus.place import how_to_start
from heronry_tools.runtime.softbus.protocol import (
    DONE,
    MAX_COMMAND_BYTES,
    BusFrame,
    decode_command,
    encode_command,
    encode_frame,
)
from heronry_wire.bare_can import can
from heronry_wire.frame import Frame, Malformed

_ANSWER_TIMEOUT_S = 5.0


class Link:
    """A connected command socket; `path` is the path of the hub, which error messages name."""

    def __init__(self, command: socket.socket, path: str) -> None:
        command.setblocking(False)
        self._command = command
        self._path = path
        self._lock = threading.Lock()
        self._mailbox_full = False
        self._commands = 0
        self._answered = 0
        self._answer: dict[str, Any] = {}

    def offer(self, frame: Frame, dlc: int, timeout_s: float | None) -> None:
        """Put a frame into the mailbox as soon as the mailbox is empty.

        timeout_s: how long to wait, in seconds; None: without end.
        Raises can.CanOperationError if the mailbox is still full after `timeout_s`, or if another thread is still
            waiting to send.
        """
        deadline_s = deadline_after(timeout_s)
        with self._locked(timeout_s):
            if not self._wait_for_mailbox(deadline_s):
                reason = f"{self._path}: the last frame is still waiting for the bus; send this frame again later"
                raise can.CanOperationError(reason, errno.ENOBUFS)
            self._send(encode_frame(BusFrame(frame, dlc, time.monotonic_ns())))
            self._mailbox_full = True

    def linger(self, timeout_s: float) -> bool:
        """Wait until the mailbox is empty, for at most `timeout_s`; returns whether the mailbox is empty."""
        deadline_s = deadline_after(timeout_s)
        with self._locked(timeout_s):
            return self._wait_for_mailbox(deadline_s)

    def ask(self, command: dict[str, Any], *passed: socket.socket) -> dict[str, Any]:
        """Send a command to the hub, and return the hub's answer.

        passed: sockets that the hub gets together with the command. Raises can.CanOperationError if no answer comes.
        """
        deadline_s = deadline_after(_ANSWER_TIMEOUT_S)
        with self._locked(_ANSWER_TIMEOUT_S):
            self._send(encode_command(command), passed)
            self._commands += 1
            while self._answered < self._commands:
                if not self._take_in(deadline_s):
                    raise can.CanOperationError(f"{self._path}: the bus does not answer; stop it, and start it again")
            return self._answer

    def put(self, record: bytes) -> None:
        """Send a record to which the hub gives no answer here."""
        self._send(record)

    def close(self) -> None:
        """Close the socket."""
        self._command.close()

    @contextmanager
    def _locked(self, timeout_s: float | None) -> Iterator[None]:
        if not self._lock.acquire(timeout=-1 if timeout_s is None else max(timeout_s, 0)):
            raise can.CanOperationError(
                f"{self._path}: another thread is still waiting to send; try again later, or send from one thread"
            )
        try:
            yield
        finally:
            self._lock.release()

    def _wait_for_mailbox(self, deadline_s: float | None) -> bool:
        while self._mailbox_full:
            if not self._take_in(deadline_s):
                return False
        return True

    def _take_in(self, deadline_s: float | None) -> bool:
        record = read_record(self._command, MAX_COMMAND_BYTES, self._path, deadline_s)
        if record == DONE:
            self._mailbox_full = False
        elif record is not None:
            self._answer = self._checked(record)
            self._answered += 1
        return record is not None

    def _send(self, record: bytes, passed: tuple[socket.socket, ...] = ()) -> None:
        try:
            if passed:
                socket.send_fds(self._command, [record], [each.fileno() for each in passed])
            else:
                self._command.send(record)
        except OSError as error:
            raise hub_is_gone(self._path) from error

    def _checked(self, record: bytes) -> dict[str, Any]:
        answer = decode_command(record)
        if isinstance(answer, Malformed):
            raise can.CanOperationError(
                f"{self._path}: what answers there is no software bus of this version of heronry ({answer.reason}); "
                "choose another path, or start the bus again with this version"
            )
        if "refused" in answer:
            raise can.CanOperationError(f"{self._path}: the bus refuses this client: {answer['refused']}")
        return answer


def read_record(source: socket.socket, max_bytes: int, path: str, deadline_s: float | None) -> bytes | None:
    """Read one record from a non-blocking socket, or return None at the deadline (time.monotonic).

    Raises can.CanOperationError if the hub is gone.
    """
    try:
        while True:
            with suppress(BlockingIOError):
                record = source.recv(max_bytes)
                break
            left_s = None if deadline_s is None else deadline_s - time.monotonic()
            if left_s is not None and left_s <= 0:
                return None
            select.select([source], [], [], left_s)
    except (OSError, ValueError) as error:  # ValueError: another thread has closed it
        raise hub_is_gone(path) from error
    if not record:
        raise hub_is_gone(path)
    return record


def deadline_after(timeout_s: float | None) -> float | None:
    """Return the deadline of a time-out that starts now, as a time of time.monotonic.

    timeout_s: the time-out in seconds; None: there is no deadline, and the result is None.
    """
    return None if timeout_s is None else time.monotonic() + timeout_s


def hub_is_gone(path: str) -> can.CanOperationError:
    """Return the error for a hub that has ended, or for a bus that this process has shut down."""
    return can.CanOperationError(f"{path}: the bus is gone; {how_to_start(path)}")
