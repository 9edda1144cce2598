"""Carries a command's output from a user-mode Linux to this program's stdout and stderr while it is written.

Into a terminal: through a console of the guest and a pipe, so that the command sees a terminal of the same size. Into
anything else: through a file that both sides see, followed as it grows, so that the command sees no terminal and no
byte is lost when the guest stops. Where stdout and stderr go to one place they share one file, which keeps their order.
"""

import os
from pathlib import Path

from heronry_tools.runtime.vcan.guest import TERMINAL


class Streams:
    """The command's stdout and stderr: where they begin in the guest, and how they get to this program's own."""

    def __init__(self, folder: Path) -> None:
        self.places: list[str] = []
        self.console: int | None = None  # the guest's end of the terminal's pipe
        self._routes: list[tuple[int, int]] = []  # (read from, write to)
        one_place = os.path.sameopenfile(1, 2)
        for ours, name in ((1, "stdout"), (2, "stderr")):
            if os.isatty(ours):
                self._add_terminal(ours)
            elif ours == 2 and one_place:
                self.places.append(self.places[0])
            else:
                self._add_file(ours, folder / name)

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
        """Copy what has come since the last call; tell whether there was any."""
        moved = False
        for source, sink in self._routes:
            while chunk := _read_now(source):
                moved = True
                _write_all(sink, chunk)
        return moved

    def close(self) -> None:
        """Close this program's ends; the files themselves are removed with their folder."""
        for source, _ in self._routes:
            os.close(source)
        if self.console is not None:
            os.close(self.console)


def _read_now(source: int) -> bytes:
    try:
        return os.read(source, 1 << 16)
    except BlockingIOError:
        return b""


def _write_all(sink: int, chunk: bytes) -> None:
    while chunk:
        chunk = chunk[os.write(sink, chunk) :]
