"""Commands with their tags: how a manager numbers and tags them, and which of them a receiver accepts.

Every command is followed by one frame TAG: the kind of the command, the lowest 13 bits of its number, and 48 bits of
tag. A manager numbers its commands anew in each term, and never uses a term twice. So no two commands of a manager have
the same term and number. A command is accepted when its TAG comes, and only if its term and number are above those of
the last accepted command. `CommandVerifier` decides this, in PEs and in the standby manager. It has one of two states
for each manager:

    no place     no command of this manager is accepted: the receiver has just started, and frames may be old
    a place      (term, number) of the last accepted command; the next accepted command must be above it

A PE gains a place only by a WELCOME, whose tag covers the nonce that the PE has just drawn. A standby manager sends no
nonce, and gains a place by trying the upper bits of the number (`seek`).

None of these cases changes a place, and each one is counted in `refused`:

    lost TAG          the command is dropped when a later command of the same kind is accepted, or when a TAG of this
                      kind comes more than `patience_ns` after the command
    lost command      its TAG is refused
    late command      is refused if a newer one was accepted before
    doubled TAG       is refused, since its number is not above that of the last accepted command
    false command     a forged, changed or replayed command, or one from another fleet: its tag is not valid

A receiver that has missed 8 192 commands in a row can no longer compute the whole number from the 13 bits in the TAG.
It has to gain a place anew.

The verifier holds a limited number of commands, and checks a limited number of tags for every TAG. So a flood of frames
cannot exhaust the receiver.
"""

from collections import Counter, deque
from enum import Enum
from typing import NamedTuple

from heronry_wire.authentication import MAX_NUMBER, NO_NONCE, Key, Place, next_number
from heronry_wire.frame import Frame
from heronry_wire.identifiers import MANAGER_NODES, Command, management_id
from heronry_wire.management import CONTROL, NUMBER_SPAN, TAG, WELCOME_KIND, Control, Operation, decode_tag, is_welcome
from heronry_wire.sansio import Received, require

_HELD = 40  # most commands of one kind that wait for their TAG: the heads of all slices, and a few more
_SOUGHT = 1 << 11  # values of the upper bits of a number that `seek` tries: two days of commands
_RECOGNIZED = 1 << 4  # values of the upper bits that `recognized` tries: the first twenty minutes of a term
_SEEK_PAUSE_NS = 20_000_000
_NOT_YET_NS = -_SEEK_PAUSE_NS


class Refusal(Enum):
    """Why a frame was refused."""

    MALFORMED = "malformed tag"
    UNTAGGED = "command without its tag"
    STRAY = "tag without its command"
    UNKNOWN = "command before a fresh start"  # no command of this manager is accepted yet
    STALE = "command from before"  # of an older term, or an answer to an older nonce
    UNPROVEN = "tag that does not fit"


class Held(NamedTuple):
    """A command that waits for its TAG.

    event: the frame of the command as it was received. arrived_ns: time of its arrival, in ns of the core's clock.
    """

    command: Command
    event: Received
    arrived_ns: int


class CommandSigner:
    """Gives each command of one mastership its number and its tag."""

    def __init__(self, key: Key, manager: int, term: int) -> None:
        """Begin to number the commands of a new mastership.

        manager: node-ID of the manager. term: term of the mastership, which this manager has never used before.
        """
        self.term = term
        self._key, self._manager = key, manager
        self._tag_id = management_id(manager, Command.TAG)
        self._control_id = management_id(manager, Command.CONTROL)
        self._kinds = {management_id(manager, command): command for command in Command if command is not Command.TAG}
        self.number = -1  # of the last command

    def tag(self, frame: Frame) -> Frame | None:
        """Give a command the next number, and return the frame TAG to send after it.

        None, and no number is used, if `frame` is no command of this manager.
        """
        kind = self._kinds.get(frame.can_id)
        return None if kind is None else self._tag(kind, frame.data)

    def welcome(self, node: int, nonce: int) -> tuple[Frame, Frame]:
        """Return the WELCOME that answers a PE's nonce and opens its session, and the TAG of that WELCOME."""
        number = self.number + 1
        answer = Control(self.term, node, Operation.WELCOME, number >> 16, number & 0xFFFF).encode()
        return Frame(self._control_id, answer), self._tag(WELCOME_KIND, answer, nonce)

    def _tag(self, kind: int, payload: bytes, nonce: int = NO_NONCE) -> Frame:
        self.number += 1
        require(self.number <= MAX_NUMBER, "a term has no numbers left: start the manager anew")
        tag = self._key.command_tag(self._manager, kind, Place(self.term, self.number), payload, nonce)
        return Frame(self._tag_id, TAG.pack(kind, self.number % NUMBER_SPAN, tag))


class CommandVerifier:
    """Decides which commands of the managers this node accepts."""

    def __init__(self, key: Key, patience_ns: int, *, seek: bool = False) -> None:
        """Begin with no accepted command of any manager.

        patience_ns: how long a command waits for its TAG.
        seek: whether the number of the first command is found by trying possible numbers. A standby manager needs
            this, since it sends no nonce.
        """
        self._key, self._patience_ns, self._seek = key, patience_ns, seek
        self._held: dict[tuple[int, int], deque[Held]] = {
            (manager, kind): deque() for manager in MANAGER_NODES for kind in range(WELCOME_KIND + 1)
        }
        self._sought_ns = _NOT_YET_NS
        self.places: dict[int, Place] = {}  # by manager
        self.refused: Counter[Refusal] = Counter()

    def hold(self, manager: int, command: Command, event: Received, arrived_ns: int) -> None:
        """Hold a command until its TAG comes; `event` is its frame as received."""
        is_answer = command is Command.CONTROL and is_welcome(event.frame.data)
        held = self._held[manager, WELCOME_KIND if is_answer else command]
        if len(held) == _HELD:
            held.popleft()
            self.refused[Refusal.UNTAGGED] += 1
        held.append(Held(command, event, arrived_ns))

    def tagged(
        self, manager: int, data: bytes, arrived_ns: int, nonce: int = NO_NONCE, *, is_counted: bool = True
    ) -> Held | Refusal:
        """Take a TAG; give the held command that it makes valid, or the reason why the TAG is refused.

        nonce: the nonce that this PE sent last, if the answer to it may still come.
        is_counted: whether a refusal is counted in `refused`; False if the TAG may belong to an answer to another node.
        """
        found = self._find(manager, data, arrived_ns, nonce)
        if isinstance(found, Refusal) and is_counted:
            self.refused[found] += 1
        return found

    def recognized(self, manager: int, data: bytes) -> Held | None:
        """Return the newest held command if the TAG `data` proves that `manager` sent it at some time; else None.

        This method is for a manager of which no command has been accepted yet. The command that it gives does not count
        as accepted, since it may be a replay.
        """
        fields = decode_tag(data)
        if fields is None or not self._held[manager, fields[0]]:
            return None
        kind, low, tag = fields
        newest = self._held[manager, kind][-1]
        payload = newest.event.frame.data
        term = _term(kind, payload, 0)
        numbers = range(low, _RECOGNIZED * NUMBER_SPAN, NUMBER_SPAN)
        places = (Place(term, number) for number in numbers)
        is_true = any(self._key.command_tag(manager, kind, place, payload) == tag for place in places)
        return newest if is_true else None

    def _find(self, manager: int, data: bytes, arrived_ns: int, nonce: int) -> Held | Refusal:
        fields = decode_tag(data)
        if fields is None:
            return Refusal.MALFORMED
        kind, low, tag = fields
        held = self._held[manager, kind]
        while held and arrived_ns - held[0].arrived_ns > self._patience_ns:
            held.popleft()
            self.refused[Refusal.UNTAGGED] += 1
        if not held:
            return Refusal.STRAY
        if kind == WELCOME_KIND and nonce == NO_NONCE:
            return Refusal.UNKNOWN
        refusal = Refusal.UNPROVEN
        covered = nonce if kind == WELCOME_KIND else NO_NONCE
        for waiting in range(len(held)):
            payload = held[waiting].event.frame.data
            place = self._place(manager, kind, payload, low)
            if isinstance(place, Refusal):
                refusal = place
            elif self._key.command_tag(manager, kind, place, payload, covered) == tag:
                return self._believe(manager, place, held, waiting)
        if refusal is Refusal.UNKNOWN:
            may_seek = kind != Command.SLICE and self._may_seek(arrived_ns)  # a SLICE does not name its term
            found = self._sought(manager, fields, held) if may_seek else refusal
            held.clear()
            return found
        return refusal

    def _believe(self, manager: int, place: Place, held: deque[Held], waiting: int) -> Held:
        """Accept a held command, and drop the commands held before it, whose TAGs were lost.

        If a command was received twice, the time of the second copy counts, and both copies leave the queue. A copy
        left there would pair with the TAG of the next equal command, which would then get the wrong time of arrival.
        """
        self.places[manager] = place
        for _ in range(waiting):
            held.popleft()
            self.refused[Refusal.UNTAGGED] += 1
        found = held.popleft()
        same = [one for one in held if one.event.frame.data == found.event.frame.data]
        for one in same:
            held.remove(one)
        return found._replace(arrived_ns=same[-1].arrived_ns) if same else found

    def _place(self, manager: int, kind: int, payload: bytes, low: int) -> Place | Refusal:
        """Return the term and number that a command must have for its TAG to be valid, or why the TAG is refused.

        payload: bytes of the command. low: the lowest 13 bits of its number, from the TAG; a WELCOME has its whole
        number in the payload.
        """
        last = self.places.get(manager)
        if kind == WELCOME_KIND:
            term, _, _, upper, lower = CONTROL.fields_of(payload)
            place = Place(term, upper << 16 | lower)
            return place if last is None or place > last else Refusal.STALE
        if last is None:
            return Refusal.UNKNOWN
        term = _term(kind, payload, last.term)
        if term < last.term:
            return Refusal.STALE
        number = next_number(last.number if term == last.term else -1, low, NUMBER_SPAN)
        return Place(term, number) if number <= MAX_NUMBER else Refusal.STALE

    def _may_seek(self, arrived_ns: int) -> bool:
        may = self._seek and arrived_ns - self._sought_ns >= _SEEK_PAUSE_NS
        if may:
            self._sought_ns = arrived_ns
        return may

    def _sought(self, manager: int, fields: tuple[int, ...], held: deque[Held]) -> Held | Refusal:
        """Try possible numbers for the newest held command of a manager.

        Returns the command if its TAG is valid for one of these numbers, and UNPROVEN if for none.

        fields: the fields of the TAG: kind, the lowest bits of the number, tag.
        """
        kind, low, tag = fields
        payload = held[-1].event.frame.data
        term = _term(kind, payload, 0)
        for number in range(low, _SOUGHT * NUMBER_SPAN, NUMBER_SPAN):
            place = Place(term, number)
            if self._key.command_tag(manager, kind, place, payload) == tag:
                return self._believe(manager, place, held, len(held) - 1)
        return Refusal.UNPROVEN


def _term(kind: int, payload: bytes, otherwise: int) -> int:
    """Return the term that a command names; `otherwise` for SLICE, which has no field for a term."""
    if kind == Command.SLICE:
        return otherwise
    first = int.from_bytes(payload[:2], "big")
    return first >> 4 if kind == Command.PREPARE else first
