"""The boot count of a PE, 0..255, by which other nodes notice every restart, even one within a heartbeat period.

A PE needs a new count at its start, and whenever it begins anew after an outage of the bus. A file keeps a *reserve*: a
count that is at most `RESERVE` ahead of the present count. The agent may use all counts up to the reserve without a
further write to the disk. There are three ways to a new count:

    in one process       the last count is in memory, and the next count is the last one plus 1
    from start to start  a process begins with the count after the reserve on the disk (at random if the disk has none),
                         and writes a reserve of its own before it sends a frame
    no disk              at the start there is no folder, or the disk is full, is read-only or takes longer than
                         `LONGEST_START_S` seconds. Then the count is drawn at random, and the other nodes do not
                         recognize one restart in 256. If the reserve can be read, the drawn count is neither the
                         reserve nor the count after it

In flight the agent never waits for the disk: a thread writes the reserve. A disk that fails does not stop the agent.
The agent reports the problem and continues. The thread tries again every `RETRY_S` seconds, and the agent reports when
the reserve is written again.
"""

import threading
from collections.abc import Callable
from pathlib import Path
from secrets import randbelow

from heronry_wire.ordinary_file import read_ordinary, replace_ordinary

RESERVE = 16
RETRY_S = 10.0
LONGEST_START_S = 2.0
_COUNTS = 256
_MOST_BYTES = 8  # a count has three digits


class BootCount:
    """Gives the boot counts of one PE."""

    def __init__(self, folder: Path | None, node: int, tell: Callable[[str], None]) -> None:
        """Keep the counts in a file of `folder`; None: there is no file, and the first count is random.

        tell: called with a sentence when the disk fails, and when it works again; perhaps by another thread.
        """
        self._file = None if folder is None else folder / f"pe-{node}.incarnation"
        self._tell = tell
        self._count: int | None = None  # the last one given
        self._reserved: int | None = None  # the last count that the file covers; written by the thread
        self._problem: str | None = None
        self._writer: threading.Thread | None = None
        self._tried, self._ended = threading.Event(), threading.Event()

    def next(self) -> int:
        """Return the next boot count; the first call may wait for the disk, at most for LONGEST_START_S."""
        if self._count is None:
            self._count = self._first()
        else:
            self._count = (self._count + 1) % _COUNTS
            if self._file is not None and self._left() <= RESERVE // 2:
                self._write()
        return self._count

    def close(self) -> None:
        """Stop the thread that writes the file."""
        self._ended.set()

    def _first(self) -> int:
        if self._file is None:
            return randbelow(_COUNTS)
        before = self._read(self._file)
        count = randbelow(_COUNTS) if before is None else (before + 1) % _COUNTS
        self._count = count
        self._write()
        self._tried.wait(LONGEST_START_S)
        if self._reserved is not None:
            return count
        if self._problem is None:
            self._told(f"{self._file}: the disk takes longer than {LONGEST_START_S:g} s")
        return (count + 1 + randbelow(_COUNTS - 2)) % _COUNTS  # neither that of the last start nor that of the next one

    def _left(self) -> int:
        """How many counts after the present one the reserve on the disk covers, 0..RESERVE; 0 if it covers none."""
        assert self._count is not None
        left = 0 if self._reserved is None else (self._reserved - self._count) % _COUNTS
        return left if left <= RESERVE else 0

    def _read(self, file: Path) -> int | None:
        try:
            text = read_ordinary(file, _MOST_BYTES).decode("ascii", "replace").strip()
        except FileNotFoundError:
            return None
        except OSError as error:
            self._told(f"{file}: {error.strerror}")
            return None
        return int(text) % _COUNTS if text.isascii() and text.isdecimal() else None

    def _write(self) -> None:
        if self._writer is None or not self._writer.is_alive():
            self._writer = threading.Thread(target=self._keep_writing, daemon=True)
            self._writer.start()

    def _keep_writing(self) -> None:
        """Write the file until it covers more than RESERVE / 2 counts after the present one.

        A failed write is repeated after RETRY_S seconds, but not after `close`.
        """
        while self._left() <= RESERVE // 2:
            is_put = self._put()
            self._tried.set()
            if not is_put and self._ended.wait(RETRY_S):
                return

    def _put(self) -> bool:
        assert self._file is not None
        assert self._count is not None
        reserved = (self._count + RESERVE) % _COUNTS
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            replace_ordinary(self._file, f"{reserved}\n".encode())
        except OSError as error:
            self._told(f"{error.filename or self._file}: {error.strerror}")
            return False
        self._reserved = reserved
        if self._problem is not None:
            self._problem = None
            self._tell(f"{self._file}: the boot count is kept again")
        return True

    def _told(self, problem: str) -> None:
        if self._problem is None:
            self._tell(
                f"{problem}; the agent continues and tries again, and until then a restart may not be recognized "
                "(use --state-dir to name a folder that can be written)"
            )
        self._problem = problem
