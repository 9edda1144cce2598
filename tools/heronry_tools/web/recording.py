"""A recorded flight as the page shows it: its timeline with marks, its loads, and a file of its events."""

from collections.abc import Iterator, Sequence
from typing import Any

from heronry_manager.events import BusSeen, Event
from heronry_manager.events.line import to_line
from heronry_tools.watch.reducer import Reducer
from heronry_tools.watch.snapshot import Source
from heronry_tools.watch.timeline import Timeline
from heronry_tools.web.live import KEPT_LOADS, NOT_LISTED, DrawnLoads, Load, load_of


class Recording(Timeline):
    """The timeline of a recorded flight, with the loads that the page draws and a mark at each reconfiguration."""

    def __init__(self, reducer: Reducer, events: Sequence[Event], source: Source) -> None:
        super().__init__(reducer, events, source)
        drawn = DrawnLoads()
        seen = ((number, one) for number, one in enumerate(events, 1) if isinstance(one, BusSeen))
        self._loads = [load_of(number, one) for number, one in seen if drawn.takes(one)]
        done = self.reconfigurations()
        self.marks: list[dict[str, Any]] = [  # the reconfigurations, for the slider
            {"number": one.number, "epoch": one.epoch, "t_ns": one.done_ns, "what": one.sentence} for one in done
        ]
        self._first_ns = done[0].done_ns if done else self.begins_ns

    @property
    def first_configuration_ns(self) -> int:
        """Return the time (ns) at which the first configuration runs; if none ever runs, the begin of the recording.

        A page begins at this time.
        """
        return self._first_ns

    def loads(self, after: int, until: int) -> list[Load]:
        """Return the loads of the buses in the events numbered above `after` and up to `until`.

        If these loads span more than ten minutes, only those of the last ten minutes are given.
        """
        found = [load for load in self._loads if after < load["number"] <= until]
        return found[-KEPT_LOADS * max(1, len(self.reducer.spec.buses)) :]

    def lines(self) -> Iterator[str]:
        """Return every event that the page lists (all except `NOT_LISTED`), a line of JSON each."""
        for event in self.events:
            if not isinstance(event, NOT_LISTED):
                yield to_line(event)
