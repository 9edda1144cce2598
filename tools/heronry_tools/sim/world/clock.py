"""Virtual time: a queue of callbacks, ordered by time.

Two callbacks of one instant are called in the order in which they were scheduled. Arbitration is the one exception: it
comes after all other callbacks of its instant, when each node has sent its frames (`at_last`). So a seed always gives
the same flight.
"""

from collections import deque
from collections.abc import Callable
from heapq import heappop, heappush


class Clock:
    """A queue of callbacks by time; `now_ns` never falls."""

    __slots__ = ("_count", "_last", "_queue", "now_ns")

    def __init__(self) -> None:
        self.now_ns = 0
        self._queue: list[tuple[int, int, Callable[[], None]]] = []
        self._last: deque[Callable[[], None]] = deque()  # scheduled by `at_last`
        self._count = 0

    def at(self, when_ns: int, what: Callable[[], None]) -> None:
        """Call `what` at `when_ns`, or at the present instant if that time is past."""
        self._count = count = self._count + 1
        heappush(self._queue, (max(when_ns, self.now_ns), count, what))

    def at_last(self, what: Callable[[], None]) -> None:
        """Call `what` at this instant, after every other callback of this instant."""
        self._last.append(what)

    def is_last_now(self) -> bool:
        """Tell whether no other callback is due at this instant."""
        return not self._last and (not self._queue or self._queue[0][0] > self.now_ns)

    def run_until(self, end_ns: int) -> None:
        """Call every callback that is due up to and including `end_ns`."""
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
