"""Gives out the events of a demo in the order of their times.

A demo has several sources of events: the pipes of its managers, which are read some time after the events, and the
demo's own actions and observations of the buses. So an event is held for a moment, in which an earlier event may still
come. An event that comes even later, from a process that stood still, is given out when it comes.
"""

from collections.abc import Callable, Mapping
from typing import Any

Tell = Callable[[Mapping[str, Any]], None]

HELD_NS = 200_000_000


class OrderedTelling:
    """Holds events, and gives each of them out when it has been held long enough."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._held: list[Mapping[str, Any]] = []

    def take(self, event: Mapping[str, Any]) -> None:
        """Hold an event."""
        self._held.append(event)

    def tell_until(self, until_ns: int | None = None) -> None:
        """Give out the events up to this time, the earliest first; None: all of them."""
        self._held.sort(key=lambda one: one["t_ns"])
        while self._held and (until_ns is None or self._held[0]["t_ns"] <= until_ns):
            self._tell(self._held.pop(0))
