"""The time at the head of each line that a program prints, so that lines of several terminals can be put in one order.

The time is this computer's local time of day with milliseconds, as `candump -t A` and the logs of the system show it.
No decision depends on this time: all decisions, and the `t_ns` of events, use ns of the monotonic clock. A time of the
monotonic clock is converted when its line is printed. So the lines of programs that were started at different times
agree, even if the clock of the day was set in between.
"""

import time

_NS_PER_S, _NS_PER_MS = 1_000_000_000, 1_000_000


def time_of_day(monotonic_ns: int | None = None) -> str:
    """Return a time of the monotonic clock as HH:MM:SS.mmm of the local time; without an argument, the present time."""
    now_ns = time.time_ns()
    at_ns = now_ns if monotonic_ns is None else now_ns - (time.monotonic_ns() - monotonic_ns)
    seconds, rest_ns = divmod(at_ns, _NS_PER_S)
    return f"{time.strftime('%H:%M:%S', time.localtime(seconds))}.{rest_ns // _NS_PER_MS:03}"
