"""Progress of long work on standard error, where that is a terminal: one line that is overwritten."""

import sys
import time
from types import TracebackType
from typing import Final, Self

_EVERY_S: Final = 0.2


class Progress:
    """Shows on standard error how many steps of a piece of work are done.

    As a context manager it clears its line on the terminal at the end.
    """

    def __init__(self) -> None:
        self._shown_at = 0.0
        self._begun_at = time.monotonic()
        self._what, self._done, self._total = "", 0, 0
        self._visible = sys.stderr.isatty()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._visible:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()

    def begin(self, what: str, total: int) -> None:
        """Begin a piece of work of `total` steps; 0: it has no steps, and only `what` is shown."""
        self._what, self._done, self._total = what, 0, total
        self._begun_at = time.monotonic()
        self._show()

    def step(self, steps: int = 1) -> None:
        """Count steps that are done."""
        self._done += steps
        if self._visible and time.monotonic() - self._shown_at >= _EVERY_S:
            self._show()

    def _show(self) -> None:
        if self._visible:
            self._shown_at = time.monotonic()
            spent_s = self._shown_at - self._begun_at
            sys.stderr.write("\r\x1b[K" + progress_line(self._what, self._done, self._total, spent_s))
            sys.stderr.flush()


def show_line(text: str) -> None:
    """Write a line that the next call overwrites, if standard error is a terminal; an empty text clears the line."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)


def progress_line(what: str, done: int, total: int, spent_s: float) -> str:
    """Return the line with the number of steps done.

    After the first step and before the last, the line also has the time left, estimated from the pace so far.
    spent_s: the time since the work began, in s.
    """
    if not total:
        return what
    line = f"{what}: {done} of {total}"
    if not done or done >= total:
        return line
    left_s = round(spent_s / done * (total - done))
    return f"{line}, {left_s // 60}:{left_s % 60:02d} left"
