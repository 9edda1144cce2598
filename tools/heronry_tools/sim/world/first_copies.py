"""Merges the two channels of a replicated bus for observers: only the first copy of each transmission is passed on.

Two frames are copies of one transmission if they are the same Python object, which the sender has given to both
channels. The nodes do not use this object, but compare bytes and times. The oracles verify the result of that
comparison.
"""

from collections import deque
from collections.abc import Callable

from heronry_tools.sim.world.bus import Sent
from heronry_wire.frame import Frame

REMEMBERED_NS = 1_000_000_000


class FirstCopies:
    """Calls every function in `taps` with the first copy of each transmission on a replicated bus."""

    def __init__(self) -> None:
        self.taps: list[Callable[[Sent], None]] = []
        self._seen: dict[int, Frame] = {}  # kept, so that no other frame gets the same `id()`
        self._order: deque[tuple[int, int]] = deque()

    def see(self, sent: Sent) -> None:
        """Call every function in `taps` with a frame that a channel has carried, if it is the first copy."""
        while self._order and self._order[0][0] < sent.end_ns - REMEMBERED_NS:
            del self._seen[self._order.popleft()[1]]
        identity = id(sent.frame)
        if identity in self._seen:
            return
        self._seen[identity] = sent.frame
        self._order.append((sent.end_ns, identity))
        for tap in self.taps:
            tap(sent)
