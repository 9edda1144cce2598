"""Which commands on a bus come from a holder of the key: every tag worked out again, from the frames alone.

A command and the TAG that follows it are a pair. A pair of any sender is *proven* if the tag is that of some number:
TAG shows its lowest 13 bits, and the others are tried, up to a span beyond the highest that was proven of that manager
in that term. This knows nothing of what the nodes believed, and keeps no order: what is replayed is proven as often as
it is sent, at the place that it had the first time.

SLICE names no term and is left out: the digest of a configuration proves it. So is WELCOME, whose tag covers a nonce
as well.
"""

from collections import defaultdict, deque
from typing import NamedTuple

from heronry_tools.sim.world.bus import Sent
from heronry_wire.authentication import Key, Place
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import MANAGER_NODES, Command, management_id
from heronry_wire.management import (
    NUMBER_SPAN,
    WELCOME_KIND,
    ManagementMessage,
    SliceBody,
    SliceHead,
    decode_command,
    decode_tag,
    is_welcome,
)

_REMEMBERED = 64  # commands of one kind that wait for their TAG: more than a PE holds


class Proven(NamedTuple):
    """A pair that was sent: its manager, its place in the manager's numbers, and the command."""

    manager: int
    place: Place
    message: ManagementMessage


class ProvenCommands:
    """Follows the commands on one bus."""

    def __init__(self, key: Key) -> None:
        self._key = key
        self._commands = {
            management_id(manager, command): (manager, command)
            for manager in MANAGER_NODES
            for command in Command
            if command not in (Command.TAG, Command.SLICE)
        }
        self._tags = {management_id(manager, Command.TAG): manager for manager in MANAGER_NODES}
        self._waiting: defaultdict[tuple[int, int], deque[bytes]] = defaultdict(lambda: deque(maxlen=_REMEMBERED))
        self._highest: dict[tuple[int, int], int] = {}  # number, by manager and term

    def take(self, sent: Sent) -> Proven | None:
        """Take a frame of any sender; gives what it proves."""
        command = self._commands.get(sent.frame.can_id)
        if command is not None:
            if not is_welcome(sent.frame.data) or command[1] is not Command.CONTROL:
                self._waiting[command].append(sent.frame.data)
            return None
        manager = self._tags.get(sent.frame.can_id)
        return None if manager is None else self._proven(manager, decode_tag(sent.frame.data))

    def newest(self, manager: int) -> Place:
        """Highest place that was proven of a manager."""
        return max((Place(t, number) for (m, t), number in self._highest.items() if m == manager), default=Place(0, 0))

    def _proven(self, manager: int, fields: tuple[int, ...] | None) -> Proven | None:
        if fields is None or fields[0] in (Command.SLICE, WELCOME_KIND):
            return None
        kind, low, tag = fields
        waiting = self._waiting[manager, kind]
        for payload in waiting:
            message = decode_command(kind, payload)
            if isinstance(message, Malformed):
                continue
            assert not isinstance(message, SliceHead | SliceBody)
            term = message.term
            highest = self._highest.get((manager, term), 0)
            for number in range(low, highest + NUMBER_SPAN + 1, NUMBER_SPAN):
                if self._key.command_tag(manager, kind, Place(term, number), payload) == tag:
                    waiting.remove(payload)
                    self._highest[manager, term] = max(highest, number)
                    return Proven(manager, Place(term, number), message)
        return None
