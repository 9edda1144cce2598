"""Carries the output of a command in a user-mode Linux (the guest) to this program's stdout and stderr, as it comes.

How the output is carried depends on where this program's stdout or stderr goes:

    terminal        through a console of the guest and a pipe, so that the command sees a terminal of the same size
    anything else   through a file that both sides see. This program follows the file as it grows, so no byte is lost
                    when the guest stops. The command sees no terminal

If stdout and stderr go to the same place, the command's stdout and stderr share one file, which keeps their order.

If stdin and stdout are a terminal, what the user types goes to the command through a second pipe into the same console.
Meanwhile the user's terminal is raw, so that the guest's terminal interprets every key, Ctrl-C included. If stdin or
stdout is no terminal, the command's standard input is empty.
"""

import os
import select
import termios
import tty
from pathlib import Path
from typing import Any

from heronry_tools.runtime.vcan.guest import TERMINAL


class Streams:
    """Brings the command's stdout and stderr from the guest to the stdout and stderr of this program."""

    def __init__(self, folder: Path) -> None:
        self.places: list[str] = []
        self.console: int | None = None  # the guest's end of the terminal's pipe
        self.keyboard: int | None = None  # the guest's end of the pipe for what is typed
        self._typed: int | None = None  # our end of it
        self._modes: list[Any] = []  # of the user's terminal, to be set again
        self._routes: list[tuple[int, int]] = []  # (read from, write to)
        one_place = os.path.sameopenfile(1, 2)
        for ours, name in ((1, "stdout"), (2, "stderr")):
            if os.isatty(ours):
                self._add_terminal(ours)
            elif ours == 2 and one_place:
                self.places.append(self.places[0])
            else:
                self._add_file(ours, folder / name)
        if os.isatty(0) and os.isatty(1):
            self.keyboard, self._typed = os.pipe()
            self._modes = termios.tcgetattr(0)
            tty.setraw(0)

    @property
    def source(self) -> str:
        """Return the file that is the command's standard input in the guest."""
        return os.devnull if self.keyboard is None else TERMINAL

    def _add_terminal(self, ours: int) -> None:
        self.places.append(TERMINAL)
        if self.console is None:
            source, self.console = os.pipe()
            os.set_blocking(source, False)
            self._routes.append((source, ours))

    def _add_file(self, ours: int, file: Path) -> None:
        file.touch()
        self.places.append(str(file))
        self._routes.append((os.open(file, os.O_RDONLY), ours))

    def pump(self) -> bool:
        """Copy the output that has come since the last call; returns whether there was any."""
        moved = self._type()
        for source, sink in self._routes:
            while chunk := _read_now(source):
                moved = True
                _write_all(sink, chunk)
        return moved

    def _type(self) -> bool:
        if self._typed is None or not select.select([0], [], [], 0)[0]:
            return False
        typed = os.read(0, 1 << 12)
        _write_all(self._typed, typed)
        return bool(typed)

    def close(self) -> None:
        """Close this program's ends of files and pipes; the files themselves are removed with their folder."""
        for source, _ in self._routes:
            os.close(source)
        for end in (self.console, self.keyboard, self._typed):
            if end is not None:
                os.close(end)
        if self._modes:
            termios.tcsetattr(0, termios.TCSADRAIN, self._modes)


def _read_now(source: int) -> bytes:
    try:
        return os.read(source, 1 << 16)
    except BlockingIOError:
        return b""


def _write_all(sink: int, chunk: bytes) -> None:
    while chunk:
        chunk = chunk[os.write(sink, chunk) :]
