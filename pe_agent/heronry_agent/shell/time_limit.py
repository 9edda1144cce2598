"""Stops code of a module that takes too long, by an alarm signal (setitimer(2)).

The alarm raises an exception in the code, wherever it computes or waits in Python. Code of a library that does not
return to Python is not stopped: then the module counts as hanging in its next step.

Only the main thread of a process gets the alarm; a partition has no other.
"""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

MOST_S = 0.05
"""Longest time in seconds that `save` or `restore` of a module may take."""


class TookTooLong(BaseException):
    """Raised by the alarm in the code that takes too long."""


@contextmanager
def time_limit() -> Iterator[None]:
    """Raise TookTooLong in the body if it takes longer than MOST_S, on the clock of the wall."""
    before = signal.signal(signal.SIGALRM, _raise)
    signal.setitimer(signal.ITIMER_REAL, MOST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _raise(_number: int, _frame: FrameType | None) -> None:
    raise TookTooLong
