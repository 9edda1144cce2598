"""Finds the commands on a bus that come from a holder of the key, by computing every tag again.

A command and the TAG after it are a pair. A pair is *proven* if its tag is correct for some command number. TAG
carries only the lowest 13 bits of this number. So all numbers with these bits are tried, from the lowest one on.
The last one tried is at most one `NUMBER_SPAN` above the highest number that was proven before, of the same
manager in the same term.

The result does not depend on what the nodes have accepted. A replayed pair is proven each time it is sent, with
its original number.

SLICE is left out, because it names no term; the digest of its configuration proves it. WELCOME is left out,
because its tag also covers a nonce.
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

_REMEMBERED = 64  # commands of one kind that are kept until their TAG comes: more than a PE keeps


class Proven(NamedTuple):
    """A command whose tag is correct.

    manager: node-ID of its sender
    place: its term and its number
    message: the command
    """

    manager: int
    place: Place
    message: ManagementMessage


class ProvenCommands:
    """Finds the proven commands on one bus."""

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
        self._highest: dict[tuple[int, int], int] = {}  # highest proven number by manager and term

    def take(self, sent: Sent) -> Proven | None:
        """Read a frame of any sender; if it is the correct TAG of a command before it, return that command."""
        command = self._commands.get(sent.frame.can_id)
        if command is not None:
            if not is_welcome(sent.frame.data) or command[1] is not Command.CONTROL:
                self._waiting[command].append(sent.frame.data)
            return None
        manager = self._tags.get(sent.frame.can_id)
        return None if manager is None else self._proven(manager, decode_tag(sent.frame.data))

    def newest(self, manager: int) -> Place:
        """Return the highest (term, number) among a manager's proven commands; (0, 0): none is proven."""
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
