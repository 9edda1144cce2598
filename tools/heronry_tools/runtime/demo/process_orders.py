"""The orders to a running demo: kill the process of a PE, and start it again.

Only the demo can do that, as the processes are its own. So it listens on a socket beside that of its manager, under the
same name with ".demo" behind it. A view that gives the orders of an operator (`heronry top`, `heronry web`) finds the
socket by that of the manager:

    view   {"do": "kill", "what": "pe:nav"}, or "start"             one message
    demo   {"v": 1, "done": true, "sentence": "pe:nav is killed ..."}, and closes the connection

    waiting    the caller has connected; the demo has read nothing yet
    answered   its one message was read, the order was carried out or refused, and the connection is closed

The demo's loop calls `execute`, which never blocks. A caller that says nothing, or only looks whether the demo listens,
costs a descriptor until it closes; of more than MOST_CALLERS the one that has waited longest is closed. A message that
is no order is refused with a sentence. An order that was given twice is refused the second time, as the process has
ended, or runs, by then. If the demo is itself killed, its socket stays and nobody listens; the next demo of this name,
which holds the lock of the name (`manager_name`), replaces the socket.
"""

import json
import os
import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from heronry_manager.shell.control_place import active_of, checked_length, user_beyond
from heronry_manager.shell.control_protocol import Answer, answer_line, read_answer
from heronry_tools.console.errors import UserError

ORDERS: Final[Mapping[str, str]] = {"kill": "kill", "start": "restore"}
"""The words of views, and those of the demo for the same."""

MOST_CALLERS: Final = 8
_MOST_BYTES: Final = 65_536
_PATIENCE_S: Final = 10.0
_ENDED: Final = Answer(done=False, sentence="the demo does not answer: has it ended?")

Do = Callable[[str, str], str]
"""Kills or restores a PE, and says so in a sentence; raises UserError where that cannot be done."""


class ProcessOrders:
    """The demo's end: the socket on which it takes orders; at the end of a `with` block the socket is removed."""

    def __init__(self, manager: Path) -> None:
        """Listen beside the socket of the demo's manager; raises UserError or ControlError if that cannot be done."""
        self._path = checked_length(_beside(manager))
        self._callers: list[socket.socket] = []  # the one that has waited longest first
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._path.unlink(missing_ok=True)
        before = os.umask(0o177)
        try:
            self._listener.bind(str(self._path))
        except OSError as error:
            self._listener.close()
            raise UserError(f"{self._path}: {error.strerror}, so the demo cannot take orders") from error
        finally:
            os.umask(before)
        self._listener.setblocking(False)
        self._listener.listen()  # with room for more callers than are let in: a full queue refuses the next one at once

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._path.unlink(missing_ok=True)
        for one in (self._listener, *self._callers):
            one.close()

    def readers(self) -> list[socket.socket]:
        """Return the sockets that become readable when `execute` has something to do."""
        return [self._listener, *self._callers]

    def execute(self, ready: Sequence[object], do: Do) -> None:
        """Let in who has connected, and carry out with `do` what has been ordered.

        ready: what can be read; sockets of others are passed over.
        """
        for caller in [one for one in self._callers if one in ready]:
            self._callers.remove(caller)
            with caller, suppress(OSError):  # it may have gone
                message = caller.recv(_MOST_BYTES)
                if message:
                    caller.send(answer_line(_done(message, do)))
        if self._listener in ready:
            with suppress(OSError):  # as above
                self._let_in()

    def _let_in(self) -> None:
        caller, _ = self._listener.accept()
        caller.setblocking(False)
        if user_beyond(caller) not in (0, os.getuid()):
            caller.close()
            return
        if len(self._callers) == MOST_CALLERS:
            self._callers.pop(0).close()
        self._callers.append(caller)


def _done(message: bytes, do: Do) -> Answer:
    """Carry out an order, and return the answer to it."""
    try:
        order = json.loads(message)
    except (ValueError, RecursionError):
        order = None
    match order:
        case {"do": str(word), "what": str(what)} if word in ORDERS:
            try:
                return Answer(done=True, sentence=do(ORDERS[word], what.removeprefix("pe:")))
            except UserError as error:
                return Answer(done=False, sentence=str(error))
        case _:
            return Answer(done=False, sentence='this is no order to a demo; write {"do": "kill", "what": "pe:NAME"}')


def takes_orders(manager: Path) -> bool:
    """Tell whether a demo listens beside the socket of a manager, active or standby."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as line:
        line.settimeout(_PATIENCE_S)
        try:
            line.connect(str(_beside(manager)))
        except OSError:
            return False
    return True


def order_demo(manager: Path, do: str, what: str) -> Answer:
    """Order the demo beside the socket of a manager to kill or start the process of a PE; returns its answer.

    do: one of `ORDERS`.
    what: the PE, as pe:NAME.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as line:
        line.settimeout(_PATIENCE_S)
        try:
            line.connect(str(_beside(manager)))
            line.send(json.dumps({"do": do, "what": what}).encode())
            return read_answer(line.recv(_MOST_BYTES)) or _ENDED
        except OSError:
            return _ENDED


def _beside(manager: Path) -> Path:
    active = active_of(manager)
    return active.with_name(f"{active.name}.demo")
