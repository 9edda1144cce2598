"""The present state of a system that is watched: events come from a thread, and pages wait for changes.

One event loop owns the state, so nothing here is locked. A page that is slow gets the difference between the state that
it has and the present state. So it misses states in between, and nothing else.

Only two things from the past are kept: the last lines of events, for downloads, and the loads of the buses over the
last ten minutes.
"""

import asyncio
import time
from collections import deque
from collections.abc import Iterable
from typing import Any, Final
from zlib import compress, decompress

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.events import Event
from heronry_manager.events.line import to_line
from heronry_tools.watch.changed_spec import goes_on
from heronry_tools.watch.reducer import Reducer, State
from heronry_tools.watch.snapshot import Snapshot, Source
from heronry_tools.web.plots.live import LivePlots

KEPT_LINES: Final = 5_000
KEPT_LOADS: Final = 600  # of each bus: ten minutes
_LOADS_APART_NS: Final = 950_000_000  # a feed tells them twice a second, and each is the load of a whole second
BY_THE_CLOCK: Final = (events.BusSeen, events.Heard)  # told also where nothing is heard any more
NOT_LISTED: Final = (*BY_THE_CLOCK, events.PeSeen, events.Feed, events.Status, events.Runs)  # too many, or no events

Load = dict[str, Any]


def load_of(number: int, event: events.BusSeen) -> Load:
    """Return the load of a bus in a `bus_seen` event, in the form that a page reads.

    number: the number of the event in the feed.
    """
    seen = {"bus": event.bus, "load": event.load, "peak": event.peak, "bits_per_s": event.bits_per_s}
    return {"number": number, "t_ns": event.t_ns, **seen}


class DrawnLoads:
    """Tells which loads of buses the page shows in its charts: one per second for each bus."""

    def __init__(self) -> None:
        self._last_ns: dict[str, int] = {}  # by bus

    def takes(self, event: events.BusSeen) -> bool:
        """Tell whether the page shows the load of `event`; if so, remember its time."""
        bus, t_ns = event.bus, event.t_ns
        if 0 <= t_ns - self._last_ns.get(bus, t_ns - _LOADS_APART_NS) < _LOADS_APART_NS:
            return False
        self._last_ns[bus] = t_ns
        return True


class Live:
    """The present snapshot of a live feed, with its last events and loads."""

    def __init__(self, reducer: Reducer, source: Source) -> None:
        self._reducer = reducer
        self._state: State = reducer.start(source)
        self._loads: deque[Load] = deque(maxlen=KEPT_LOADS * max(1, len(reducer.spec.buses)))
        self._drawn = DrawnLoads()
        self._lines: deque[bytes] = deque(maxlen=KEPT_LINES)  # compressed: plans are long
        self._last_came_s = time.monotonic()
        self._waiting: set[asyncio.Event] = set()
        self.plots = LivePlots(reducer.spec)
        self.trouble: str | None = None  # why nothing comes at present

    def change_to(self, spec: Spec) -> None:
        """Go on with another spec, to which the aircraft has changed."""
        self._reducer = Reducer(spec)
        self._state = goes_on(self._state, self._reducer)
        self._loads.clear()
        self.plots = LivePlots(spec)
        self._wake()

    @property
    def snapshot(self) -> Snapshot:
        """Return the present snapshot."""
        return self._state.snapshot

    def age_s(self) -> float:
        """Return the time in seconds since an event, the connection or the bus last showed that the system is there."""
        return time.monotonic() - self._last_came_s

    def take_all(self, come: Iterable[Event], trouble: str | None, *, is_alive: bool) -> None:
        """Take the events of one poll of a feed.

        trouble: why nothing comes at present; None if all is well.
        is_alive: the manager's connection or the bus shows that the system is there.
        """
        if is_alive:
            self._last_came_s = time.monotonic()
        self.trouble = trouble
        for event in come:
            self.take(event)

    def take(self, event: Event) -> None:
        """Take the next event of the feed."""
        self._state = self._reducer.after(self._state, event)
        if not isinstance(event, BY_THE_CLOCK):
            self._last_came_s = time.monotonic()
        if isinstance(event, events.BusSeen) and self._drawn.takes(event):
            self._loads.append(load_of(self._state.snapshot.events, event))
        if not isinstance(event, NOT_LISTED):
            self._lines.append(compress(to_line(event).encode(), 1))
        self._wake()

    def waits(self, sentence: str) -> None:
        """Set the reason why no events come, at present or ever again, as a sentence for the pages."""
        self.trouble = sentence
        self._wake()

    def loads(self, after: int) -> list[Load]:
        """Return the bus loads that came with the events after the event number `after` of the feed."""
        return [load for load in self._loads if load["number"] > after]

    def lines(self) -> Iterable[str]:
        """Return the last events, a line of JSON each."""
        return tuple(decompress(line).decode() for line in self._lines)

    async def changed(self, longest_s: float) -> bool:
        """Wait until an event comes or `waits` is called; returns False if neither happens in `longest_s` seconds."""
        woken = asyncio.Event()
        self._waiting.add(woken)
        try:
            async with asyncio.timeout(longest_s):
                await woken.wait()
        except TimeoutError:
            return False
        finally:
            self._waiting.discard(woken)
        return True

    def _wake(self) -> None:
        for woken in self._waiting:
            woken.set()
