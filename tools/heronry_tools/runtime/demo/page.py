"""The page of a demo: a process of `heronry web`.

    started   the process has been started. Its first line has the address of the page
    serving   the first line has been read
    ended     the process has ended; the demo goes on

The page process gets what it shows from the manager's socket, and gives its orders to the manager and to the demo
(`process_orders`), as every other view does.
"""

import json
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

from heronry_tools.console.errors import UserError

_END_S: Final = 5.0


class Page:
    """The process that serves the page of a demo; at the end of a `with` block the process is ended."""

    def __init__(self, spec_file: Path, manager: Path, log: Path) -> None:
        """Start the process that serves the page.

        manager: the socket of the manager that the page shows.
        log: the file for the standard error of the process.
        """
        self._is_told, self._log = False, log
        command = ["heronry_tools.cli", "web", str(spec_file), "--socket", str(manager), "--operate", "--json"]
        with log.open("ab") as errors:
            self._process = subprocess.Popen(
                [sys.executable, "-m", *command, "--until-eof", "--starts-later"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
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
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            stream.close()

    def readers(self) -> list[Any]:
        """Return what becomes readable when the page has sent its address; nothing after that."""
        return [] if self._is_told else [self._said]

    @property
    def is_served(self) -> bool:
        """Tell whether the page has sent its address."""
        return self._is_told

    @property
    def _said(self) -> IO[bytes]:
        assert self._process.stdout is not None
        return self._process.stdout

    def address(self) -> str:
        """Read the first line of the page process, and give the address in it.

        To be called when one of `readers` is readable. Raises UserError where the page cannot be served.
        """
        line = self._said.readline()
        if not line:
            self._process.wait()
            words = self._log.read_text(errors="replace").strip().rpartition("\n")[2]
            raise UserError(f"the page cannot be served: {words or 'its process was killed'}")
        self._is_told = True
        return str(json.loads(line)["address"])
