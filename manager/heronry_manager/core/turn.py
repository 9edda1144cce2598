"""One call of the manager's core: its time, and the actions that the core has requested so far.

The objects of the core share one `Turn`, so they need not pass the time and the list of actions to one another. From
one call to the next, the `Turn` keeps what all of them need: the time, the term of this mastership, the memory, and the
kinds of the last events, which an InvariantError lists.
"""

from collections import deque
from collections.abc import Callable
from typing import Concatenate, ParamSpec, Protocol

from heronry_manager.core.memory import NOTHING, Memory, Record
from heronry_manager.core.vocabulary import Emit, Keep, ManagerAction
from heronry_manager.events import Event
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, management_id
from heronry_wire.sansio import Send

_RECENT_EVENTS = 40
_Fields = ParamSpec("_Fields")


class Encodable(Protocol):
    """A message of `heronry_wire.management` that can be sent as a frame."""

    def encode(self) -> bytes:
        """Return the payload of the frame."""


class Turn:
    """Holds what the objects of a manager's core share during one call of the core (head of this file).

    node: node-ID of the manager.
    silent: whether the manager sends nothing on the bus, and remembers nothing.
    """

    def __init__(self, node: int, now_ns: int, *, term: int, memory: Memory = NOTHING, silent: bool = False) -> None:
        self.node, self.term, self.memory = node, term, memory
        self.silent = silent
        self.now_ns = now_ns
        self.recent: deque[str] = deque(maxlen=_RECENT_EVENTS)
        self.seal: Callable[[list[ManagerAction]], list[ManagerAction]] | None = None  # adds TAGs
        self._actions: list[ManagerAction] = []

    def begin(self, now_ns: int) -> None:
        """Begin a call of the core at `now_ns`."""
        self.now_ns = now_ns

    def do(self, *actions: ManagerAction) -> None:
        """Have the driver do these actions, after those of this turn so far; a `silent` manager sends no frames."""
        self._actions += [action for action in actions if not (self.silent and isinstance(action, Send))]

    def send(self, command: Command, message: Encodable) -> None:
        """Send a command on the manager's bus."""
        self.do(Send(0, Frame(management_id(self.node, command), message.encode())))

    def keep(self, record: Record) -> None:
        """Add a record to the memory, and request that the driver writes the record to the journal.

        If this manager is `silent`, do nothing.
        """
        if not self.silent:
            self.memory = self.memory.after(record)
            self.do(Keep(record))

    def emit(
        self, kind: Callable[Concatenate[int, _Fields], Event], *fields: _Fields.args, **named: _Fields.kwargs
    ) -> None:
        """Add an event to the stream, with the time of this turn: its kind and its fields."""
        event = kind(self.now_ns, *fields, **named)
        self.recent.append(f"{self.now_ns} {event.kind}")
        self.do(Emit(event))

    def end(self) -> list[ManagerAction]:
        """Return all actions that were requested since the last call of this method, in order, and forget them.

        With a key, the function in the attribute `seal` adds the TAGs to them; it is None without a key.
        """
        actions, self._actions = self._actions, []
        return actions if self.seal is None else self.seal(actions)
