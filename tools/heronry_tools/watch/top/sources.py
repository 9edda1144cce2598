"""The source of the snapshots of `heronry top`: a live feed, or a recording with a cursor in time."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.watch.changed_spec import goes_on
from heronry_tools.watch.live_feeds import Feed
from heronry_tools.watch.recording import Recording
from heronry_tools.watch.reducer import Reducer
from heronry_tools.watch.snapshot import Snapshot
from heronry_tools.watch.top.orders import Operator

SPEEDS = (1, 4, 16)
_NS_PER_S = 1_000_000_000


class LiveSource:
    """A live feed, with the snapshot of its events so far."""

    is_recorded = False

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._shows(feed.spec)
        self._state = self._reducer.start(feed.source)

    def _shows(self, spec: Spec) -> None:
        feed, self._reducer = self._feed, Reducer(spec)
        self.operator = None if feed.socket is None else Operator(spec, feed.socket)

    def readers(self) -> Sequence[Any]:
        """Return the descriptors of the feed that become readable when the feed has received something."""
        return self._feed.readers()

    def look(self) -> None:
        """Read the events that have come from the feed, and update the snapshot with them."""
        events = self._feed.poll()
        if self._feed.spec.digest != self._reducer.spec.digest:
            self._shows(self._feed.spec)
            self._state = goes_on(self._state, self._reducer)
        self._state = self._reducer.all(events, self._state)

    def snapshot(self) -> Snapshot:
        """Return the present snapshot."""
        return self._state.snapshot

    def note(self) -> str:
        """Return a sentence about what is wrong with the feed; empty if nothing is."""
        return self._feed.trouble or ""

    def close(self) -> None:
        """Close the feed."""
        self._feed.close()


class RecordedSource:
    """A recording with a cursor in time, which the user moves, or which runs by itself."""

    is_recorded = True
    operator = None

    def __init__(self, recording: Recording, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        """Put the cursor at the end of the recording.

        clock_ns: gives the time in ns; a running cursor moves as this time passes.
        """
        self.timeline, self._clock_ns = recording.timeline(), clock_ns
        self.at_ns = self.timeline.ends_ns
        self._speed, self._ran_ns = 0, 0

    def readers(self) -> Sequence[Any]:
        """Return no file descriptor, since nothing has to wait for a recording."""
        return ()

    def look(self) -> None:
        """If the cursor runs, move it by the time since the last call, times its speed."""
        now_ns = self._clock_ns()
        if self._speed:
            self.move_to(self.at_ns + self._speed * (now_ns - self._ran_ns))
            if self.at_ns >= self.timeline.ends_ns:
                self._speed = 0
        self._ran_ns = now_ns

    def play(self) -> None:
        """Let the cursor run at the next higher speed; after the highest speed, stop the cursor.

        A cursor at the end of the recording is first moved to the start.
        """
        faster = [speed for speed in SPEEDS if speed > self._speed]
        if self.at_ns >= self.timeline.ends_ns:
            self.at_ns = self.timeline.begins_ns
        self._speed, self._ran_ns = (faster[0] if faster else 0), self._clock_ns()

    def move(self, by_ns: int) -> None:
        """Move the cursor by `by_ns`, backwards if `by_ns` is negative."""
        self.move_to(self.at_ns + by_ns)

    def move_to(self, at_ns: int) -> None:
        """Move the cursor to a time, or to the nearer end of the recording if the time is outside of it."""
        self.at_ns = min(max(at_ns, self.timeline.begins_ns), self.timeline.ends_ns)

    def to_reconfiguration(self, *, is_next: bool) -> None:
        """Move the cursor to the next or previous reconfiguration; if there is none, to the end or start."""
        times = [one.done_ns for one in self.timeline.reconfigurations()]
        if is_next:
            self.move_to(min((t for t in times if t > self.at_ns), default=self.timeline.ends_ns))
        else:
            self.move_to(max((t for t in times if t < self.at_ns), default=self.timeline.begins_ns))

    def snapshot(self) -> Snapshot:
        """Return the snapshot at the cursor."""
        return self.timeline.at(self.at_ns)

    def note(self) -> str:
        """Return the position of the cursor, and its speed."""
        begins_ns = self.timeline.begins_ns
        at_s, whole_s = (self.at_ns - begins_ns) / _NS_PER_S, (self.timeline.ends_ns - begins_ns) / _NS_PER_S
        return f"log {at_s:.2f} of {whole_s:.2f} s" + (f", {self._speed}x" if self._speed else "")

    def close(self) -> None:
        """Do nothing, since nothing is open."""


TopSource = LiveSource | RecordedSource


def source_of(opened: Feed | Recording) -> TopSource:
    """Return the source for an opened feed or recording."""
    return RecordedSource(opened) if isinstance(opened, Recording) else LiveSource(opened)
