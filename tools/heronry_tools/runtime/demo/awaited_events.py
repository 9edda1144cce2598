"""The events of one manager, for a benchmark that waits for one event after the other.

An event that does not come in time, or a manager that has ended, ends the benchmark with one sentence.
"""

import time
from collections import deque
from typing import IO, TypeVar

from heronry_manager import events
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet

_E = TypeVar("_E", bound=events.Event)
LONGEST_S = 60.0  # Python and the solver may take long to load; nothing else does


class AwaitedEvents:
    """The events of one manager, read as they come."""

    def __init__(self, fleet: Fleet, stream: IO[bytes]) -> None:
        """Begin to read `stream`, the events of a manager of `fleet`; nothing else may read this stream from now on."""
        self._fleet, self._stream = fleet, EventStream(stream)
        self._come: deque[events.Event] = deque()

    def wait(self, *kinds: type[_E], pe: str | None = None) -> _E:
        """Return the next event of one of `kinds`, about this PE if one is named.

        Raises SystemExit if no such event comes within LONGEST_S seconds.
        """
        last, until_s = "nothing", time.monotonic() + LONGEST_S
        while True:
            while self._come:
                told = self._come.popleft()
                last = told.kind
                if isinstance(told, kinds) and (pe is None or _is_about(told, pe)):
                    return told
            if time.monotonic() > until_s:
                wanted = " or ".join(f"'{kind.KIND}'" for kind in kinds)
                raise SystemExit(
                    f"the benchmark ends here: no event {wanted} came in {LONGEST_S:g} s; the last event was '{last}'"
                )
            self._read(max(0.0, until_s - time.monotonic()))

    def take(self) -> list[events.Event]:
        """Return the events that have come since the last call; raises SystemExit where the manager has ended."""
        self._read(0.0)
        come = list(self._come)
        self._come.clear()
        return come

    def _read(self, wait_s: float) -> None:
        self._come += self._stream.take(wait_s)
        if self._stream.has_ended:
            why = self._fleet.ended() or "a manager has closed its output of events; repeat the benchmark"
            raise SystemExit(f"the benchmark ends here: {why}")


def _is_about(told: events.Event, pe: str) -> bool:
    return isinstance(told, events.PeLost | events.PeJoined) and told.pe == pe
