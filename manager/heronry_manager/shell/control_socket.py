"""The operator's UNIX-domain socket of a running manager, read by the driver's loop. No call here blocks.

A lock beside the socket shows that a manager listens: the manager holds it as long as its process lives, and the kernel
releases it however the process ends. A manager that gets the lock replaces a socket that a killed manager has left
behind. A second manager does not get the lock, and stops with an error. Only the manager's user and root can open the
socket. The kernel names the user of each caller, and callers of any other user are dropped.

A caller that has begun to follow the manager's events (`followers`) can give no more orders, and counts as a follower
and not as a caller.

The manager takes one order in each turn of its loop, from its callers in turn. So orders, however many arrive, cannot
delay the manager's own frames by more than one order takes, and a caller with many orders does not delay those of
others. Nothing more is read from a caller while a line of it waits; its next order waits for the answer to this one.

A caller that sends too much without a line break, or does not read its answer, is dropped. If there are MOST_CALLERS
already, or the process has no descriptor left, the caller that has been idle for longest makes room for a new one. If
none is idle, the caller whose waiting lines are longest makes room. If every caller waits for an answer, the new one is
dropped. One file descriptor is kept in reserve, to accept a new caller
when the process has no other descriptor left. Without the reserve this caller would stay in the kernel's queue, and
would wake the manager's loop again and again.
"""

import contextlib
import errno
import fcntl
import os
import select
import socket
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from heronry_manager.core.vocabulary import OperatorSaid, Reply
from heronry_manager.shell.control_place import ControlError, checked_length, listening_folder, user_beyond
from heronry_manager.shell.control_protocol import (
    LONGEST_ORDER_BYTES,
    Answer,
    FlyScript,
    Follow,
    Reload,
    answer_line,
    read_order,
)
from heronry_manager.shell.followers import Followers
from heronry_manager.shell.script_orders import ReloadSaid, ScriptSaid

MOST_CALLERS = 16


class ControlSocket:
    """The socket on which a running manager takes orders, and the connections of its callers."""

    def __init__(self, path: Path) -> None:
        """Listen on `path`; raises ControlError if another manager listens there, or the path cannot be used."""
        self.path = checked_length(path)
        self.followers = Followers()
        self._lock = _locked(listening_folder(path) / f"{path.name}.lock")
        self._callers: dict[socket.socket, bytes] = {}  # caller -> what has come of its next lines; last served: last
        self._awaiting_answer: dict[int, socket.socket] = {}
        self._number = 0
        self._reserve: int | None = None  # file descriptor
        self._reserve_again()
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._listen()
        except OSError as error:
            self.close()
            raise ControlError(f"{path}: {error.strerror}; name another socket with --socket") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.path.unlink(missing_ok=True)
        self.close()

    def readers(self) -> list[socket.socket]:
        """Return the objects that an event loop must watch: if one of them is readable, `poll` has something to do."""
        heard = [one for one, lines in self._callers.items() if b"\n" not in lines]
        return [self._listener, *heard, *self.followers.readers()]

    @property
    def has_orders(self) -> bool:
        """Tell whether an order has come that `poll` can return, so that the event loop must not wait."""
        return self._next() is not None

    def poll(self) -> list[OperatorSaid | ScriptSaid | ReloadSaid]:
        """Return the next order if one has arrived, without waiting.

        Takes at most one line, of one caller. A line that is no order is answered with an error.
        """
        ready, _, _ = select.select(self.readers(), [], [], 0)
        for one in ready:
            if one is self._listener:
                self._let_in()
            elif one in self._callers:
                self._hear(one)
            else:
                self.followers.heard(one)  # no effect on a caller that was dropped in this loop, to make room
        caller = self._next()
        if caller is None:
            return []
        line, _, rest = self._callers.pop(caller).partition(b"\n")
        self._callers[caller] = rest
        said = self._understood(caller, line)
        return [] if said is None else [said]

    def answer(self, reply: Reply) -> None:
        """Answer an order; the answer is lost if the caller has closed the connection."""
        caller = self._awaiting_answer.pop(reply.number, None)
        if caller in self._callers:
            self._tell(caller, Answer(reply.done, reply.sentence, reply.status, reply.is_unusable))

    def close(self) -> None:
        """Close the socket and all connections, and release the lock."""
        self.followers.close()
        for one in (self._listener, *self._callers):
            one.close()
        self._callers.clear()
        if self._reserve is not None:
            os.close(self._reserve)
            self._reserve = None
        self._lock.close()

    def _listen(self) -> None:
        self.path.unlink(missing_ok=True)
        before = os.umask(0o177)
        try:
            self._listener.bind(str(self.path))
        finally:
            os.umask(before)
        self._listener.setblocking(False)
        self._listener.listen()

    def _let_in(self) -> None:
        with contextlib.suppress(OSError):  # the caller may have closed the connection already
            caller = self._accept()
            caller.setblocking(False)
            self._reserve_again()
            if user_beyond(caller) in (0, os.getuid()) and self._has_room():
                self._callers[caller] = b""
            else:
                caller.close()
        self._reserve_again()

    def _reserve_again(self) -> None:
        if self._reserve is None:
            with contextlib.suppress(OSError):
                self._reserve = os.open(os.devnull, os.O_RDONLY)

    def _accept(self) -> socket.socket:
        """Accept a caller; if the process has no file descriptor left, close the reserved one first.

        Raises OSError if the caller cannot be accepted.
        """
        try:
            return self._listener.accept()[0]
        except OSError as error:
            if error.errno not in (errno.EMFILE, errno.ENFILE) or self._reserve is None:
                raise
        os.close(self._reserve)
        self._reserve = None
        return self._listener.accept()[0]

    def _has_room(self) -> bool:
        """Make room for one more caller if there is none; tell whether one more caller can be accepted now.

        To make room, a caller that does not wait for an answer is dropped (see the file's head); if all callers wait
        for an answer, the result is False.
        """
        if len(self._callers) < MOST_CALLERS and self._reserve is not None:
            return True
        waiting = set(self._awaiting_answer.values())
        others = {one: lines for one, lines in self._callers.items() if one not in waiting}
        if not others:
            return False
        idle = next((one for one, lines in others.items() if b"\n" not in lines), None)
        self._drop(idle or max(others, key=lambda one: len(others[one])))
        return True

    def _next(self) -> socket.socket | None:
        """Return the caller whose line is taken next: of those with a complete line, the one served longest ago."""
        waiting = set(self._awaiting_answer.values())
        return next((one for one, lines in self._callers.items() if b"\n" in lines and one not in waiting), None)

    def _hear(self, caller: socket.socket) -> None:
        try:
            chunk = caller.recv(LONGEST_ORDER_BYTES)
        except OSError:
            chunk = b""
        lines = self._callers.pop(caller) + chunk
        self._callers[caller] = lines
        if not chunk or (len(lines) > LONGEST_ORDER_BYTES and b"\n" not in lines):
            self._drop(caller)

    def _understood(self, caller: socket.socket, line: bytes) -> OperatorSaid | ScriptSaid | ReloadSaid | None:
        order = read_order(line)
        if isinstance(order, str):
            self._tell(caller, Answer(done=False, sentence=order, is_unusable=True))
            return None
        if isinstance(order, Follow):
            self._follow(caller)
            return None
        self._number += 1
        self._awaiting_answer[self._number] = caller
        if isinstance(order, FlyScript):
            return ScriptSaid(self._number, order)
        if isinstance(order, Reload):
            return ReloadSaid(self._number, order)
        return OperatorSaid(self._number, order)

    def _follow(self, caller: socket.socket) -> None:
        """Make a caller a follower of events; if there are too many followers already, tell the caller so."""
        if self.followers.take(caller):
            del self._callers[caller]
        else:
            self._tell(
                caller,
                Answer(
                    done=False,
                    sentence="too many readers follow this manager already: end one (heronry top, web, record)",
                ),
            )

    def _tell(self, caller: socket.socket, answer: Answer) -> None:
        line = answer_line(answer)
        try:
            sent = caller.send(line)
        except OSError:
            sent = 0
        if sent < len(line):  # the caller does not read its answers
            self._drop(caller)

    def _drop(self, caller: socket.socket) -> None:
        if self._callers.pop(caller, None) is not None:
            caller.close()
            self._awaiting_answer = {number: one for number, one in self._awaiting_answer.items() if one is not caller}


def _locked(file: Path) -> IO[bytes]:
    """Lock a file until it is closed; raises ControlError if it cannot be opened, or another process holds the lock."""
    try:
        lock = file.open("a+b", buffering=0)
    except OSError as error:
        raise ControlError(f"{file}: {error.strerror}; name another socket with --socket") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.seek(0)
        owner = lock.read(20).decode("ascii", "replace").strip() or "unknown"
        lock.close()
        where = file.with_suffix("")
        raise ControlError(
            f"a manager (process {owner}) listens on {where} already: stop it, or name another socket with --socket"
        ) from None
    with contextlib.suppress(OSError):  # a full disk stops no manager; only the number of the process is not told then
        lock.truncate(0)
        lock.write(b"%d\n" % os.getpid())
    return lock
