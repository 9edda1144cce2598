"""Virtual time: a queue of what happens next.

Two things at the same instant happen in the order in which they were scheduled, but for arbitration, which waits until
everybody who had something to say at that instant has said it (`LATE`). Nothing else orders anything, so one seed gives
one run.
"""

from collections.abc import Callable
from heapq import heappop, heappush

EARLY, LATE = 0, 1


class Clock:
    """Events by time; `now_ns` only rises."""

    __slots__ = ("_count", "_queue", "now_ns")

    def __init__(self) -> None:
        self.now_ns = 0
        self._queue: list[tuple[int, int, int, Callable[[], None]]] = []
        self._count = 0

    def at(self, when_ns: int, what: Callable[[], None], turn: int = EARLY) -> None:
        """Let something happen at `when_ns`, or now if that is past."""
        self._count = count = self._count + 1
        heappush(self._queue, (max(when_ns, self.now_ns), turn, count, what))

    def is_last_now(self) -> bool:
        """Tell whether nothing else is due at this instant."""
        return not self._queue or self._queue[0][0] > self.now_ns

    def run_until(self, end_ns: int) -> None:
        """Let everything happen that is due up to and including `end_ns`."""
        queue = self._queue
        while queue and queue[0][0] <= end_ns:
            self.now_ns, _, _, what = heappop(queue)
            what()
        self.now_ns = max(self.now_ns, end_ns)
