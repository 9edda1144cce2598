"""Stops code of a module that takes too long, by an alarm signal (setitimer(2)).

The time for which the process waits for a processor does not count, as for a step (`partition_process`): the kernel
counts it (schedstat). When the alarm comes too early for this reason, it is set again. Where the kernel does not count
it, the clock of the wall decides.

The alarm raises an exception in the code, wherever it computes or waits in Python. Code of a library that does not
return to Python is not stopped: then the module counts as hanging in its next step.

Only the main thread of a process gets the alarm; a partition has no other.
"""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

MOST_S = 0.05
"""Longest time in seconds that `save` or `restore` of a module may take."""

_LEAST_S = 0.001  # until the alarm is set again


class TookTooLong(BaseException):
    """Raised by the alarm in the code that takes too long."""


@contextmanager
def time_limit() -> Iterator[None]:
    """Raise TookTooLong in the body if it takes longer than MOST_S; a timer that runs already is put off until then."""
    begun_s = _spent_s()

    def ring(_number: int, _frame: FrameType | None) -> None:
        left_s = MOST_S - (_spent_s() - begun_s)
        if left_s <= 0:
            raise TookTooLong
        signal.setitimer(signal.ITIMER_REAL, max(left_s, _LEAST_S))

    before = signal.signal(signal.SIGALRM, ring)
    timer = signal.setitimer(signal.ITIMER_REAL, MOST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        signal.setitimer(signal.ITIMER_REAL, *timer)


def _spent_s() -> float:
    """Return a time in s that passes while this process computes or sleeps, but not while it waits for a processor."""
    try:
        with open("/proc/self/schedstat", "rb") as schedstat:  # noqa: PTH123 - no pathlib in the agent
            waited_ns = int(schedstat.read().split()[1])
    except (OSError, IndexError):
        waited_ns = 0
    return (time.monotonic_ns() - waited_ns) / 1e9
