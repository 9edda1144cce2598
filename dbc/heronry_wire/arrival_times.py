"""Converts the time-stamp of a received frame to the time of arrival on CLOCK_MONOTONIC.

SocketCAN stamps frames with the clock of the day. An operator or a program may set this clock in flight, even by hours.
While a computer is suspended, this clock runs on, and CLOCK_MONOTONIC does not. So a time-stamp alone does not show how
old a frame is. Each time before it reads the bus, the caller takes a *look*: it reads both clocks. Between two looks
the clock of the day may have been set. Two rules limit the error that this causes:

    two offsets   The offset is the clock of the day minus CLOCK_MONOTONIC. The time of arrival is computed twice: with
                  the offset at the last look, and with the offset at the look before the last one. The earlier of the
                  two results is used
    empty queue   If a reading leaves the queue of the bus empty, each frame that is read later has arrived after the
                  look that the caller took for this reading. No later frame gets an earlier time of arrival than that
                  look

By the first rule a frame never seems newer than it is. So a process that was paused does not take an old LEASE for a
new one. By the second rule a frame in a running node never seems more than a few milliseconds too old.

The software bus stamps frames with CLOCK_MONOTONIC (`StampedMessage`); for these frames the clock of the day is not
used. Apart from logs, no other file that runs in flight reads the clock of the day.
"""

import time
from typing import Any

from heronry_wire.bare_can import can

_NS_PER_S = 1_000_000_000


class StampedMessage(can.Message):
    """A message of python-can that has its time of arrival, in ns of this computer's CLOCK_MONOTONIC."""

    __slots__ = ("monotonic_ns",)

    def __init__(self, monotonic_ns: int, **fields: Any) -> None:
        super().__init__(**fields)
        self.monotonic_ns = monotonic_ns


class ArrivalTimes:
    """Computes the ages and the times of arrival of the frames of one bus.

    The reader of the bus calls `look` before each reading. It calls `found_empty` after a reading that has left no
    frame unread.
    """

    def __init__(self) -> None:
        self._looked_ns = 0
        self._empty_ns: int | None = None  # the last look that found nothing left
        self._offset_ns: int | None = None  # clock of the day minus CLOCK_MONOTONIC, at the last look
        self._offset_before_ns = 0  # the same difference, at the look before the last one

    def look(self) -> None:
        """Read both clocks, to compare them with the time-stamps of the frames that are read next."""
        day_ns = time.time_ns()
        self._looked_ns = time.monotonic_ns()
        offset_ns = day_ns - self._looked_ns
        self._offset_before_ns = offset_ns if self._offset_ns is None else self._offset_ns
        self._offset_ns = offset_ns

    def found_empty(self) -> None:
        """Note that the queue of the bus is empty: each frame that is read later has arrived after the last `look`."""
        self._empty_ns = self._looked_ns

    def age_ns(self, message: can.Message) -> int:
        """Return the time in ns from the arrival of a message to the last call of `look`; 0 or more."""
        if isinstance(message, StampedMessage):
            return max(0, self._looked_ns - message.monotonic_ns)
        return self.age_of(int(message.timestamp * _NS_PER_S))

    def age_of(self, day_ns: int) -> int:
        """Return the time in ns from a time-stamp of the clock of the day to the last call of `look`; 0 or more."""
        offset_ns = max(self._offset_ns or 0, self._offset_before_ns)
        arrived_ns = day_ns - offset_ns
        if self._empty_ns is not None:
            arrived_ns = max(arrived_ns, self._empty_ns)
        return max(0, self._looked_ns - arrived_ns)

    def arrived_ns(self, message: can.Message) -> int:
        """Time in ns of CLOCK_MONOTONIC at which a message arrived; never later than the last `look`."""
        return self._looked_ns - self.age_ns(message)
