"""The events that a process prints as lines of JSON."""

from collections.abc import Iterable
from typing import Any, TypeVar

from heronry_manager.events import Event
from heronry_manager.events.line import to_object
from heronry_manager.events.reading import events_in

E = TypeVar("E", bound=Event)


def next_event(lines: Iterable[str | bytes], kind: type[E], **fields: Any) -> E:
    """Return the next event of a kind whose fields have these values."""
    for told in events_in(lines):
        if isinstance(told, kind) and fields.items() <= to_object(told).items():
            return told
    raise AssertionError(f"the process ended before it told {kind.KIND} with {fields}")
