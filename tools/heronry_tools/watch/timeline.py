"""A recorded feed, of which any moment can be shown.

A state is computed when it is needed, from the nearest earlier state that is kept. One state is kept for every 256
events, so that a jump to another time is fast, and little memory is used.
"""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate

from heronry_manager.events import Event
from heronry_tools.watch.reducer import Reducer, State
from heronry_tools.watch.snapshot import Reconfiguration, Snapshot, Source

_EVERY = 256  # events between two states that are kept


class Timeline:
    """The events of a recording, in the order of the feed, and the state at any time."""

    def __init__(self, reducer: Reducer, events: Sequence[Event], source: Source = "log") -> None:
        self.events, self.reducer = events, reducer
        self.times_ns = list(accumulate((event.t_ns for event in events), max))  # a late event gets the time before
        self._kept: list[State] = [reducer.start(source)]  # before event 0, _EVERY, 2 * _EVERY, ...

    @property
    def begins_ns(self) -> int:
        """Return the time of the first event; 0 if there is no event."""
        return self.times_ns[0] if self.times_ns else 0

    @property
    def ends_ns(self) -> int:
        """Return the time of the last event; 0 if there is no event."""
        return self.times_ns[-1] if self.times_ns else 0

    def at(self, t_ns: int) -> Snapshot:
        """Return the snapshot after all events up to and including `t_ns`."""
        return self.after(self.events_until(t_ns)).snapshot

    def last(self) -> Snapshot:
        """Return the snapshot after all events."""
        return self.after(len(self.events)).snapshot

    def reconfigurations(self) -> list[Reconfiguration]:
        """Return all reconfigurations, oldest first, and among them the epochs that a manager adopted.

        A snapshot has only the last hundred. No more of them pass between two states that are kept, since each has at
        least three events: what it was planned for, the plan, and its end.
        """
        last = self.after(len(self.events))
        found = {one.number: one for state in (*self._kept, last) for one in state.snapshot.reconfigurations}
        return [found[number] for number in sorted(found)]

    def events_until(self, t_ns: int) -> int:
        """Return the number of events up to and including `t_ns`."""
        return bisect_right(self.times_ns, t_ns)

    def after(self, count: int, known: State | None = None) -> State:
        """Return the state after the first `count` events.

        known: a state after some of these events; the computation continues from it if that is shorter.
        """
        number = count // _EVERY
        while len(self._kept) <= number:
            begin = (len(self._kept) - 1) * _EVERY
            self._kept.append(self.reducer.all(self.events[begin : begin + _EVERY], self._kept[-1]))
        nearest, begin = self._kept[number], number * _EVERY
        if known is not None and begin <= known.snapshot.events <= count:
            nearest, begin = known, known.snapshot.events
        return self.reducer.all(self.events[begin:count], nearest)
