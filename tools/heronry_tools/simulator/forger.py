"""A station that would like to command, and does not have the key: it listens, and says what it heard, or the like.

    forged      a command of its own making, with 48 bits of its own making
    replayed    a command and its TAG that it has heard, as old as they may be
    reordered   the same, a few milliseconds after they were said
    truncated   a command that it has heard, cut short, and its TAG
    foreign     a command of a manager of a higher term, tagged with another key

Its name begins as a stranger's does, so nobody takes what it says for commanded: whoever judges a run holds every PE to
what the true managers have said. Where it sends under an identifier at the same time as its owner, both are destroyed,
as on a wire; that is the bus's affair, and no tag helps against it.
"""

from random import Random

from heronry_tools.simulator.bus import SimulatedBus
from heronry_tools.simulator.clock import Clock
from heronry_tools.simulator.stranger import STRANGER
from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.command_tags import CommandSigner
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER, PE_NODES, Command, management_id
from heronry_wire.management import MAX_TERM, Activate, Alive, Control, Lease, ManagementMessage, Operation, Step
from heronry_wire.sansio import Received

_TAG_IDS = {management_id(manager, Command.TAG) for manager in (FIRST_MANAGER, LAST_MANAGER)}
_COMMAND_IDS = {management_id(m, command) for m in (FIRST_MANAGER, LAST_MANAGER) for command in Command} - _TAG_IDS
_REMEMBERED = 512
_EVERY_NS = (500_000, 4_000_000)


class Forger:
    """Attacks from now on until it leaves; `attacks` counts them."""

    def __init__(self, clock: Clock, bus: SimulatedBus, random: Random) -> None:
        self.attacks = 0
        self._clock, self._bus, self._random = clock, bus, random
        self._command: Frame | None = None  # heard last
        self._heard: list[tuple[Frame, Frame]] = []
        key = Key(random.randbytes(KEY_BYTES))
        self._signers = [CommandSigner(key, manager, MAX_TERM) for manager in (FIRST_MANAGER, LAST_MANAGER)]
        self._station = bus.join(f"{STRANGER}forger", 0, self._hear, _COMMAND_IDS | _TAG_IDS)
        self._attack()

    def leave(self) -> None:
        """Leave the bus."""
        if self._station.present:
            self._bus.leave(self._station)

    def _hear(self, event: Received) -> None:
        frame = event.frame
        if frame.can_id in _COMMAND_IDS:
            self._command = frame
        elif self._command is not None:
            self._heard = [*self._heard[-_REMEMBERED:], (self._command, frame)]

    def _attack(self) -> None:
        if not self._station.present:
            return
        attacks = [self._forged, self._foreign, *([self._replayed, self._reordered, self._cut] if self._heard else [])]
        for frame in self._random.choice(attacks)():
            self._bus.offer(self._station, frame)
        self.attacks += 1
        self._clock.at(self._clock.now_ns + self._random.randint(*_EVERY_NS), self._attack)

    def _made_up(self, manager: int, term: int) -> Frame:
        """A command that would hurt."""
        draw = self._random.randrange
        step, node, epoch = Step.GO_ALL, self._random.choice(PE_NODES), 1 + draw(0xFFFF)
        said: list[tuple[Command, ManagementMessage]] = [
            (Command.LEASE, Lease(term, epoch, step, draw(1 << 24))),
            (Command.ALIVE, Alive(term, draw(256), frozenset(PE_NODES))),
            (Command.ALIVE, Alive(term, draw(256), frozenset())),
            (Command.ACTIVATE, Activate(term, epoch, step, draw(1 << 24))),
            (Command.CONTROL, Control(term, node, Operation.UNLOCK, 60)),
            (Command.CONTROL, Control(term, node, Operation.RENEW)),
            (Command.CONTROL, Control(term, node, Operation.WELCOME, draw(1 << 16), draw(1 << 16))),
        ]
        command, message = self._random.choice(said)
        return Frame(management_id(manager, command), message.encode())

    def _forged(self) -> tuple[Frame, ...]:
        manager = self._random.choice((FIRST_MANAGER, LAST_MANAGER))
        tag = Frame(management_id(manager, Command.TAG), self._random.randbytes(8))
        return self._made_up(manager, 1 + self._random.randrange(MAX_TERM)), tag

    def _foreign(self) -> tuple[Frame, ...]:
        signer = self._random.randrange(2)
        frame = self._made_up(FIRST_MANAGER + signer, MAX_TERM)
        return frame, self._signers[signer].tag(frame) or frame

    def _replayed(self) -> tuple[Frame, ...]:
        return self._random.choice(self._heard)

    def _reordered(self) -> tuple[Frame, ...]:
        return self._random.choice(self._heard[-8:])

    def _cut(self) -> tuple[Frame, ...]:
        frame, tag = self._random.choice(self._heard[-8:])
        return frame._replace(data=frame.data[: self._random.randrange(1 + len(frame.data))]), tag
