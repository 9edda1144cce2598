"""Virtual time: a queue of what happens next.

Two things at the same instant happen in the order in which they were scheduled, except arbitration, which waits until
every node has sent what it has to send at that instant (`at_last`). Nothing else orders anything, so one seed gives one
run.
"""

from collections import deque
from collections.abc import Callable
from heapq import heappop, heappush


class Clock:
    """Events by time; `now_ns` only rises."""

    __slots__ = ("_count", "_last", "_queue", "now_ns")

    def __init__(self) -> None:
        self.now_ns = 0
        self._queue: list[tuple[int, int, Callable[[], None]]] = []
        self._last: deque[Callable[[], None]] = deque()  # what `at_last` has scheduled
        self._count = 0

    def at(self, when_ns: int, what: Callable[[], None]) -> None:
        """Call `what` at `when_ns`, or now if that is past."""
        self._count = count = self._count + 1
        heappush(self._queue, (max(when_ns, self.now_ns), count, what))

    def at_last(self, what: Callable[[], None]) -> None:
        """Call `what` at this instant, after everything else that is due now."""
        self._last.append(what)

    def is_last_now(self) -> bool:
        """Tell whether nothing else is due at this instant."""
        return not self._last and (not self._queue or self._queue[0][0] > self.now_ns)

    def run_until(self, end_ns: int) -> None:
        """Call everything that is due up to and including `end_ns`."""
        queue, last = self._queue, self._last
        while True:
            if last and (not queue or queue[0][0] > self.now_ns):
                last.popleft()()
            elif queue and queue[0][0] <= end_ns:
                self.now_ns, _, what = heappop(queue)
                what()
            else:
                break
        self.now_ns = max(self.now_ns, end_ns)
