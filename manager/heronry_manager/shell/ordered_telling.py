"""Passes events on to a reader in the order of their times.

Two kinds of events come late:

    - events whose content the manager first has to read from a PE; their `heard_ns` is the time of the event
    - in a demo, events from another process

So each event is held until it is HELD_NS old. If an earlier event comes meanwhile, the earlier one is passed on first.
An event that is older than HELD_NS when it comes is passed on immediately, out of order.
"""

from collections.abc import Callable
from dataclasses import replace

from heronry_manager.events import Event, ModuleFailed

Tell = Callable[[Event], None]

HELD_NS = 200_000_000


class OrderedTelling:
    """Holds each event until it is HELD_NS old, and then passes it on; earlier events go first."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._held: list[Event] = []

    def take(self, event: Event) -> None:
        """Hold an event until `tell_until` passes it on.

        If the event has the time `heard_ns` (`module_failed`), this time replaces the event's own time `t_ns`.
        """
        self._held.append(replace(event, t_ns=event.heard_ns) if isinstance(event, ModuleFailed) else event)

    def tell_until(self, until_ns: int | None = None) -> None:
        """Pass on the held events with times up to `until_ns`, the earliest first; with None, all of them."""
        self._held.sort(key=lambda one: one.t_ns)
        while self._held and (until_ns is None or self._held[0].t_ns <= until_ns):
            self._tell(self._held.pop(0))

    def due_ns(self) -> int | None:
        """Return the time (ns) at which the earliest held event is HELD_NS old; None: no event is held."""
        return min(one.t_ns for one in self._held) + HELD_NS if self._held else None
