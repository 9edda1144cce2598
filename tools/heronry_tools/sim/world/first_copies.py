"""One bus out of two channels, for the observers of a run: of each sending the copy that went over a wire first.

The copies of one sending are known by the object that both channels were offered, not by what the nodes go by, since
that is what the oracles verify.
"""

from collections import deque
from collections.abc import Callable

from heronry_tools.sim.world.bus import Sent
from heronry_wire.frame import Frame

REMEMBERED_NS = 1_000_000_000


class FirstCopies:
    """Passes on what neither channel has carried before, to every one of `taps`."""

    def __init__(self) -> None:
        self.taps: list[Callable[[Sent], None]] = []
        self._seen: dict[int, Frame] = {}  # kept alive, so that no other frame gets its identity
        self._order: deque[tuple[int, int]] = deque()

    def see(self, sent: Sent) -> None:
        """Take a frame that a channel has carried."""
        while self._order and self._order[0][0] < sent.end_ns - REMEMBERED_NS:
            del self._seen[self._order.popleft()[1]]
        identity = id(sent.frame)
        if identity in self._seen:
            return
        self._seen[identity] = sent.frame
        self._order.append((sent.end_ns, identity))
        for tap in self.taps:
            tap(sent)
