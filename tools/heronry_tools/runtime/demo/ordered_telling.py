"""Passes the events of a demo on in the order of their times.

A demo has several sources of events: the pipes of its managers, which are read some time after the events, and the
demo's own actions and observations of the buses. So each event is held for a moment, in case an earlier event comes
within it. An event that comes even later, from a process that stood still, is passed on when it comes.
"""

from collections.abc import Callable, Mapping
from typing import Any

Tell = Callable[[Mapping[str, Any]], None]

HELD_NS = 200_000_000


class OrderedTelling:
    """Holds events, and passes each of them on when it has been held long enough."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._held: list[Mapping[str, Any]] = []

    def take(self, event: Mapping[str, Any]) -> None:
        """Hold an event until it is passed on."""
        self._held.append(event)

    def tell_until(self, until_ns: int | None = None) -> None:
        """Pass on the held events with times up to `until_ns`, the earliest first; with None, all of them."""
        self._held.sort(key=lambda one: one["t_ns"])
        while self._held and (until_ns is None or self._held[0]["t_ns"] <= until_ns):
            self._tell(self._held.pop(0))
