"""A node's own transmit queue, in the order of bus arbitration (protocol rule 13).

Every sender keeps its frames in this queue, and hands over one frame at a time. The reason: SocketCAN's own queue is
first-in-first-out. A heartbeat behind twenty SLICE frames would wait for all of them, and the timing analysis would not
hold.

- *Order.* Frames of one identifier stay in their order.
- *Full queue.* The queue is bounded, so that the memory does not fill up while the bus carries no frames. A full queue
  drops the newest of its least urgent frames, and counts this in `dropped`.
- *Expiry.* A frame may have an expiry time, after which it is dropped and counts in `expired`. So a frame that waited
  during a pause of its sender is not sent late.
- *Standing back.* Until the time `stands_back_until_ns`, which a sender may set, data frames and all frames of a lower
  priority than data stay in the queue.
"""

from bisect import insort

from heronry_wire.frame import Frame, arbitration_key
from heronry_wire.identifiers import STANDARD_DATA_IDS

CAPACITY = 512
_FOR_EVER_NS = 1 << 63
FIRST_HELD_BACK = arbitration_key(Frame(STANDARD_DATA_IDS[0], b""))  # arbitration key of the most urgent data frame


class TransmitQueue:
    """The frames of one node that wait to be sent, the most urgent first."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self.dropped = 0  # frames dropped because the queue was full
        self.expired = 0
        self._capacity = capacity
        self._frames: list[tuple[int, int, Frame, int]] = []  # the most urgent last; each ends with its expiry time
        self._count = 0
        self.stands_back_until_ns = 0

    def __len__(self) -> int:
        return len(self._frames)

    def push(self, frame: Frame, until_ns: int | None = None) -> None:
        """Add a frame; a full queue drops its least urgent frame.

        until_ns: time in ns at which the frame expires; None: never.
        """
        self._count += 1
        insort(
            self._frames, (-arbitration_key(frame), -self._count, frame, _FOR_EVER_NS if until_ns is None else until_ns)
        )
        if len(self._frames) > self._capacity:
            del self._frames[0]
            self.dropped += 1

    def limit(self, frame: Frame, until_ns: int, now_ns: int) -> None:
        """Let one queued frame equal to `frame` expire at `until_ns`: the first that would expire later.

        Drops all frames that have expired at `now_ns`.
        """
        kept = [one for one in self._frames if one[3] >= now_ns]
        self.expired += len(self._frames) - len(kept)
        self._frames = kept
        for place in range(len(kept) - 1, -1, -1):
            key, count, waiting, latest_ns = kept[place]
            if waiting == frame and latest_ns > until_ns:
                kept[place] = key, count, waiting, until_ns
                return

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Remove every 11-bit frame with one of these identifiers."""
        self._frames = [one for one in self._frames if one[2].extended or one[2].can_id not in identifiers]

    def clear(self) -> int:
        """Drop all frames; gives their number."""
        count = len(self._frames)
        self._frames.clear()
        return count

    def first(self, now_ns: int) -> Frame | None:
        """Return the most urgent frame that may be sent now, without removing it; None where no frame may.

        Frames that have expired at `now_ns` are dropped.
        """
        while self._frames and self._frames[-1][3] < now_ns:
            self._frames.pop()
            self.expired += 1
        if not self._frames or (now_ns < self.stands_back_until_ns and -self._frames[-1][0] >= FIRST_HELD_BACK):
            return None
        return self._frames[-1][2]

    def pop(self) -> Frame:
        """Remove the most urgent frame, and give it; raises IndexError where the queue is empty."""
        return self._frames.pop()[2]
