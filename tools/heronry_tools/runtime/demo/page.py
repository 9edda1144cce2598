"""The page of a demo: a process of `heronry web`, and the orders that come from it.

    started   the process has been started. Its first line has the address of the page
    serving   the first line has been read
    ended     the process has ended; the demo goes on

The page process gets what it shows from the manager's socket, as every other client does. But only the demo can kill
and restore a PE. So the page process and the demo share a socket pair:

    page process   {"do": "kill", "what": "nav"}, or the same with "restore" in place of "kill"
    demo           {"done": ..., "sentence": ...}
"""

import json
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

from heronry_tools.console.errors import UserError

_MOST_BYTES: Final = 4096
_END_S: Final = 5.0

Do = Callable[[str, str], str]
"""Kills or restores a PE, and says so in a sentence; raises UserError where that cannot be done."""


class Page:
    """The process that serves the page of a demo; at the end of a `with` block the process is ended."""

    def __init__(self, spec_file: Path, manager: Path, log: Path) -> None:
        """Start the process that serves the page.

        manager: the socket of the manager that the page shows.
        log: the file for the standard error of the process.
        """
        self._orders, theirs = socket.socketpair()
        self._is_told, self._log = False, log
        command = ["heronry_tools.cli", "web", str(spec_file), "--socket", str(manager), "--operate", "--json"]
        with theirs, log.open("ab") as errors:
            self._process = subprocess.Popen(
                [sys.executable, "-m", *command, "--until-eof", "--demo-orders", str(theirs.fileno())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,  # with its own share of the processors: nodes go first in theirs
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._orders):
            assert stream is not None
            stream.close()

    def readers(self) -> list[Any]:
        """Return the descriptors that become readable when the page has sent something."""
        return [self._said] if not self._is_told else [self._orders] if self._orders.fileno() >= 0 else []

    @property
    def is_served(self) -> bool:
        """Tell whether the page has sent its address."""
        return self._is_told

    @property
    def _said(self) -> IO[bytes]:
        assert self._process.stdout is not None
        return self._process.stdout

    def address(self) -> str | None:
        """Read the first line of the page process, and give the address in it; None if the line was read before.

        To be called when one of `readers` is readable. Raises UserError where the page cannot be served.
        """
        if self._is_told:
            return None
        line = self._said.readline()
        if not line:
            self._process.wait()
            words = self._log.read_text(errors="replace").strip().rpartition("\n")[2]
            raise UserError(f"the page cannot be served: {words or 'its process was killed'}")
        self._is_told = True
        return str(json.loads(line)["address"])

    def execute(self, do: Do) -> None:
        """Read an order of the page, carry it out with `do`, and answer."""
        line = self._orders.recv(_MOST_BYTES)
        if not line:  # the page has ended; the flight goes on
            self._orders.close()
            return
        order = json.loads(line)
        try:
            answer = {"done": True, "sentence": do(order["do"], order["what"])}
        except UserError as error:
            answer = {"done": False, "sentence": str(error)}
        self._orders.sendall(json.dumps(answer).encode() + b"\n")
