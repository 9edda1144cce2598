"""A flight that was recorded, at any moment of it: the events in order, and the state after each.

The states are made when they are asked for, from the nearest one that is kept; so many are kept that a step of the
slider costs few events, and memory stays small.
"""

import json
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from heronry_tools.watch.reducer import Reducer, State
from heronry_tools.watch.snapshot import Source
from heronry_tools.web.live import KEPT_LOADS, NOT_LISTED, Load, load_of

_BETWEEN_KEPT: Final = 200

Event = Mapping[str, Any]


class Recording:
    """All events of a feed that has an end."""

    def __init__(self, reducer: Reducer, events: Sequence[Event], source: Source) -> None:
        self._reducer, self._events = reducer, events
        self.times_ns = _rising(event["t_ns"] for event in events)
        state = reducer.start(source)
        self._kept: list[State] = [state]
        self._loads: list[Load] = []
        self.marks: list[dict[str, Any]] = []  # the reconfigurations, for the slider
        for number, event in enumerate(events, 1):
            state = reducer.after(state, event)
            if number % _BETWEEN_KEPT == 0:
                self._kept.append(state)
            if event["event"] == "bus_seen":
                self._loads.append(load_of(number, event))
        self.last = state
        for one in state.snapshot.reconfigurations:
            self.marks.append({"number": one.number, "epoch": one.epoch, "t_ns": one.done_ns, "what": one.sentence})

    @property
    def first_ns(self) -> int:
        """Time of the first event."""
        return self.times_ns[0] if self.times_ns else 0

    @property
    def last_ns(self) -> int:
        """Time of the last event."""
        return self.times_ns[-1] if self.times_ns else 0

    @property
    def begin_ns(self) -> int:
        """Time at which a page begins: when the first configuration runs."""
        return int(self.marks[0]["t_ns"]) if self.marks else self.first_ns

    def events_until(self, t_ns: int) -> int:
        """Number of events up to a time."""
        return bisect_right(self.times_ns, t_ns)

    def after(self, events: int, known: State | None = None) -> State:
        """Give the state after so many events, from a known earlier one if that is nearer."""
        kept = self._kept[events // _BETWEEN_KEPT]
        if known is not None and kept.snapshot.events <= known.snapshot.events <= events:
            kept = known
        return self._reducer.all(self._events[kept.snapshot.events : events], kept)

    def loads(self, after: int, until: int) -> list[Load]:
        """Give the loads of the last minutes among the events after `after`, up to `until`."""
        found = [load for load in self._loads if after < load["number"] <= until]
        return found[-KEPT_LOADS * max(1, len(self._reducer.spec.buses)) :]

    def lines(self) -> Iterator[str]:
        """Give all events, a line of JSON each."""
        for event in self._events:
            if event["event"] not in NOT_LISTED:
                yield json.dumps(event, separators=(",", ":"))


def _rising(times_ns: Iterable[int]) -> list[int]:
    """Give times of which none is before an earlier one: lines of two sources may cross by some milliseconds."""
    found: list[int] = []
    for t_ns in times_ns:
        found.append(max(t_ns, found[-1]) if found else t_ns)
    return found
