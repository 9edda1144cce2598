"""A recorded feed, of which any moment can be shown."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any

from heronry_tools.watch.reducer import Reducer, State
from heronry_tools.watch.snapshot import Snapshot, Source

_EVERY = 256  # events between two states that are kept


class Timeline:
    """The events of a recording, in the order in which they were told, and the snapshot at any time."""

    def __init__(self, reducer: Reducer, events: Sequence[Mapping[str, Any]], source: Source = "log") -> None:
        self.events = events
        self._reducer, self._start = reducer, reducer.start(source)
        self._times = list(accumulate((event["t_ns"] for event in events), max))  # what is told late counts from then
        self._kept: list[State] = [self._start]  # before event 0, _EVERY, 2 * _EVERY, ...

    @property
    def begins_ns(self) -> int:
        """Time of the first event; 0 where there is none."""
        return self._times[0] if self._times else 0

    @property
    def ends_ns(self) -> int:
        """Time of the last event."""
        return self._times[-1] if self._times else 0

    def at(self, t_ns: int) -> Snapshot:
        """Give the snapshot after all events up to and including `t_ns`."""
        return self._after(bisect_right(self._times, t_ns))

    def last(self) -> Snapshot:
        """Give the snapshot after all events."""
        return self._after(len(self.events))

    def reconfigurations(self) -> list[int]:
        """Times at which a reconfiguration was done."""
        return [event["t_ns"] for event in self.events if event["event"] in ("reconfigured", "epoch_seen")]

    def _after(self, count: int) -> Snapshot:
        number = count // _EVERY
        while len(self._kept) <= number:
            begin = (len(self._kept) - 1) * _EVERY
            self._kept.append(self._reducer.all(self.events[begin : begin + _EVERY], self._kept[-1]))
        return self._reducer.all(self.events[number * _EVERY : count], self._kept[number]).snapshot
