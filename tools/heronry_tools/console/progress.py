"""Progress of long work on standard error: one line that is overwritten.

It is shown only where standard error is a terminal, and not to a program that reads JSON (`wish`).
"""

import sys
import threading
import time
from types import TracebackType
from typing import Final, Self

_EVERY_S: Final = 0.2
_FIRST_S: Final = 2.0  # work that is done sooner shows nothing


class _Wish:
    """Whether the command that runs in this process may show progress."""

    is_told = True


def wish(*, is_told: bool) -> None:
    """Choose whether progress is shown from now on, where standard error is a terminal."""
    _Wish.is_told = is_told


def _is_told() -> bool:
    return _Wish.is_told and sys.stderr.isatty()


class Progress:
    """Shows on standard error how many steps of a piece of work are done.

    As a context manager it clears its line on the terminal at the end.
    """

    def __init__(self) -> None:
        self._shown_at = 0.0
        self._begun_at = time.monotonic()
        self._what, self._done, self._total = "", 0, 0
        self._visible = _is_told()

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


class Working:
    """Shows on standard error that work without countable steps goes on, from its third second on, and for how long.

    As a context manager it clears its line at the end, so the result is printed after it. The work runs in the thread
    of the caller, and must start no process by fork meanwhile.
    """

    def __init__(self, what: str) -> None:
        """Show the words `what`, and the time."""
        self._what, self._is_told = what, _is_told()
        self._over = threading.Event()
        self._teller = threading.Thread(target=self._tell, daemon=True)

    def __enter__(self) -> Self:
        if self._is_told:
            self._teller.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._is_told:
            self._over.set()
            self._teller.join()

    def _tell(self) -> None:
        begun_s, wait_s = time.monotonic(), _FIRST_S
        while not self._over.wait(wait_s):
            wait_s = 1.0
            show_line(f"{self._what}: {time.monotonic() - begun_s:.0f} s")
        if wait_s != _FIRST_S:
            show_line("")


def show_line(text: str) -> None:
    """Write a line that the next call overwrites, if standard error is a terminal; an empty text clears the line."""
    if _is_told():
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
