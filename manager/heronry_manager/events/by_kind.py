"""Tables of what a reader does with an event of each kind: `dict([on(PeLost, tell_loss), on(PeJoined, ...)])`."""

from collections.abc import Callable
from typing import Any, TypeVar

from heronry_manager.events.event import Event

_E = TypeVar("_E", bound=Event)
_T = TypeVar("_T")


def on(kind: type[_E], do: Callable[[_E], _T]) -> tuple[type[Event], Callable[[Any], _T]]:
    """Return an entry of a table: a kind, and a function that only gets events of this kind."""
    return kind, do
