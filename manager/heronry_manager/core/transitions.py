"""A state machine written as a table: each possible change of state, the event that makes it, and why.

The *owner*, the object that has the state, keeps it in an attribute and changes it only by `after`. So a change that
the table lacks raises an InvariantError immediately. The diagrams of docs/protocol/ are made from the
same rows, so they show exactly what can happen.

    beginnings    states in which a new owner may begin, and why
    rows          state before, event, state after, and why; for each state and event there is one row at most
"""

from collections.abc import Iterable, Mapping
from enum import Enum
from typing import Generic, TypeVar

from heronry_wire.sansio import InvariantError

State = TypeVar("State", bound=Enum)
Event = TypeVar("Event", bound=Enum)


class TransitionTable(Generic[State, Event]):
    """All possible changes of state of one state machine."""

    def __init__(self, beginnings: Mapping[State, str], rows: Iterable[tuple[State, Event, State, str]]) -> None:
        self.beginnings = beginnings
        self.rows = tuple(rows)
        self._after = {(before, event): after for before, event, after, _ in self.rows}

    def after(self, state: State, event: Event) -> State:
        """Return the state that an event leads to; raises InvariantError if the event cannot happen in this state."""
        found = self._after.get((state, event))
        if found is None:
            raise InvariantError(f"event {event.name} cannot happen in state {state.name}")
        return found

    def may_be(self, state: State, event: Event | None) -> bool:
        """Tell whether `event` can have led to `state`; if `event` is None, whether `state` can be the first one."""
        if event is None:
            return state in self.beginnings
        return any((last, after) == (event, state) for _, last, after, _ in self.rows)
