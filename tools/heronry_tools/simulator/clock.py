"""Virtual time: a queue of what happens next.

Two things at the same instant happen in the order in which they were scheduled, but for arbitration, which waits until
everybody who had something to say at that instant has said it (`LATE`). Nothing else orders anything, so one seed gives
one run.
"""

import heapq
from collections.abc import Callable

EARLY, LATE = 0, 1


class Clock:
    """Events by time; `now_ns` only rises."""

    def __init__(self) -> None:
        self.now_ns = 0
        self._queue: list[tuple[int, int, int, Callable[[], None]]] = []
        self._count = 0

    def at(self, when_ns: int, what: Callable[[], None], turn: int = EARLY) -> None:
        """Let something happen at `when_ns`, or now if that is past."""
        self._count += 1
        heapq.heappush(self._queue, (max(when_ns, self.now_ns), turn, self._count, what))

    def run_until(self, end_ns: int) -> None:
        """Let everything happen that is due up to and including `end_ns`."""
        queue = self._queue
        while queue and queue[0][0] <= end_ns:
            self.now_ns, _, _, what = heapq.heappop(queue)
            what()
        self.now_ns = max(self.now_ns, end_ns)
