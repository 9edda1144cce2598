"""When frames arrived, in ns of CLOCK_MONOTONIC, although SocketCAN stamps them with the clock of the day.

The clock of the day may be set while a node flies, by hours too, and it runs on while a computer is suspended, which
CLOCK_MONOTONIC does not. So the time between two stamps, or between a stamp and now, may be anything. Two facts limit
what a step can do:

    empty   the queue of the bus was empty at some look, so a frame read since then arrived later than that look
    two     a frame was stamped before or after the step. Both are tried, and the earlier arrival is taken

So a frame never seems newer than it is, whatever the clock of the day does (a paused process must not take an old LEASE
for a new one), and never older than the last look at an empty queue: for a node that runs, a few milliseconds.

The software bus stamps frames with CLOCK_MONOTONIC (`StampedMessage`): there the clock of the day is not used.
This file is the only one that flies and reads the clock of the day for more than a log.
"""

import time
from typing import Any

import can

_NS_PER_S = 1_000_000_000


class StampedMessage(can.Message):
    """A message of python-can from a bus that knows when it arrived, in ns of this computer's CLOCK_MONOTONIC."""

    __slots__ = ("monotonic_ns",)

    def __init__(self, monotonic_ns: int, **fields: Any) -> None:
        super().__init__(**fields)
        self.monotonic_ns = monotonic_ns


class ArrivalTimes:
    """The ages of the frames of one bus: `look` before each reading of the bus, `found_empty` after reading all."""

    def __init__(self) -> None:
        self._looked_ns = 0
        self._empty_ns: int | None = None  # the last look that found nothing left
        self._offset_ns: int | None = None  # of the clock of the day, at the last look
        self._offset_before_ns = 0  # and at the look before

    def look(self) -> None:
        """Read both clocks. A pause between the two readings can only make the offset too small, frames too new."""
        day_ns = time.time_ns()
        self._looked_ns = time.monotonic_ns()
        offset_ns = day_ns - self._looked_ns
        self._offset_before_ns = offset_ns if self._offset_ns is None else self._offset_ns
        self._offset_ns = offset_ns

    def found_empty(self) -> None:
        """Note that nothing is left to read: each later frame arrives after the last look."""
        self._empty_ns = self._looked_ns

    def age_ns(self, message: can.Message) -> int:
        """Time in ns from the arrival of a message to the last look, 0 or more."""
        if isinstance(message, StampedMessage):
            return max(0, self._looked_ns - message.monotonic_ns)
        offset_ns = max(self._offset_ns or 0, self._offset_before_ns)
        arrived_ns = int(message.timestamp * _NS_PER_S) - offset_ns
        if self._empty_ns is not None:
            arrived_ns = max(arrived_ns, self._empty_ns)
        return max(0, self._looked_ns - arrived_ns)

    def arrived_ns(self, message: can.Message) -> int:
        """Time in ns of CLOCK_MONOTONIC at which a message arrived, at the latest at the last look."""
        return self._looked_ns - self.age_ns(message)
