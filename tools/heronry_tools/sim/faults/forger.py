"""An attacker without the key: it listens to a bus, and sends commands and reports that it has heard or made up.

    forged      a made-up command with a made-up tag of 48 bits
    replayed    a command and its TAG that the attacker has heard, of any age
    reordered   one of the last eight commands that the attacker has heard, and its TAG; so it comes out of order
    truncated   a command that the attacker has heard, cut short, and its TAG
    foreign     a made-up command under the highest term, tagged with another key
    slander     an EMCY in the name of a PE about any element, or a page 1 in which a PE refuses the running epoch

The attacker's station has the name of a foreign node, so the oracles take none of its frames for a command. The oracles
verify that the PEs accept only what the true managers have sent.

The attacker avoids sending at the same moment as the node that it imitates. Two nodes that send under one identifier at
one time destroy each other's frames, until they are bus-off. No tag prevents that; the fault `rogue` covers this case.
"""

from random import Random

from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.stranger import STRANGER
from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.command_tags import CommandSigner
from heronry_wire.frame import Frame
from heronry_wire.identifiers import (
    FIRST_MANAGER,
    LAST_MANAGER,
    PE_NODES,
    Command,
    emcy_id,
    management_id,
    state_id,
)
from heronry_wire.management import (
    MAX_TERM,
    NO_EPOCH,
    Activate,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    ManagementMessage,
    Operation,
    Step,
)
from heronry_wire.sansio import Received
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1, StatePage2, decode_state

_TAG_IDS = {management_id(manager, Command.TAG) for manager in (FIRST_MANAGER, LAST_MANAGER)}
_COMMAND_IDS = {management_id(m, command) for m in (FIRST_MANAGER, LAST_MANAGER) for command in Command} - _TAG_IDS
_STATE_IDS = {state_id(node) for node in PE_NODES}
_ACCUSERS = PE_NODES[:4]  # node-IDs that most specs have
_REMEMBERED = 512
_LEASE_IDS = {management_id(manager, Command.LEASE) for manager in (FIRST_MANAGER, LAST_MANAGER)}
_EVERY_NS = (500_000, 4_000_000)
_TAG_AFTER_NS = 200_000  # from a command to its TAG: by then the command is on the bus
_PAUSE_NS = 2_000_000  # of silence, after which a manager is assumed to have sent all its frames
_DUE_NS = (14_000_000, 40_000_000)  # when the next LEASE is due after one, with a heartbeat period of 20 ms


class Forger:
    """An attacker that sends forged frames from its creation until it leaves the bus.

    attacks: number of forgeries so far; a forged command and its TAG count as one
    """

    def __init__(self, clock: Clock, bus: SimulatedBus, random: Random) -> None:
        self.attacks = 0
        self._clock, self._bus, self._random = clock, bus, random
        self._command: Frame | None = None  # the last command heard
        self._heard: list[tuple[Frame, Frame]] = []
        self._epochs: dict[int, int] = {}  # epochs that PEs report, by the identifier of their states
        self._spoke, self._spoke_ns = 0, clock.now_ns  # which PE has sent its state last, and when
        self._leased_ns = self._heard_ns = clock.now_ns  # when a manager sent LEASE, and any frame
        key = Key(random.randbytes(KEY_BYTES))
        self._signers = [CommandSigner(key, manager, MAX_TERM) for manager in (FIRST_MANAGER, LAST_MANAGER)]
        self._station = bus.join(f"{STRANGER}forger", 0, self._hear, _COMMAND_IDS | _TAG_IDS | _STATE_IDS)
        self._attack()

    def leave(self) -> None:
        """Leave the bus."""
        if self._station.present:
            self._bus.leave(self._station)

    def _hear(self, event: Received) -> None:
        frame = event.frame
        if frame.can_id in _STATE_IDS:
            page = decode_state(frame.data)
            if isinstance(page, StatePage0) and page.epoch != NO_EPOCH:
                self._epochs[frame.can_id] = page.epoch
                self._spoke, self._spoke_ns = frame.can_id, self._clock.now_ns
            elif isinstance(page, StatePage2):
                self._heard_ns = self._clock.now_ns  # a manager is about to answer this
            return
        self._heard_ns = self._clock.now_ns
        if frame.can_id in _COMMAND_IDS:
            self._command = frame
            if frame.can_id in _LEASE_IDS:
                self._leased_ns = self._clock.now_ns
        elif self._command is not None:
            self._heard = [*self._heard[-_REMEMBERED:], (self._command, frame)]

    def _attack(self) -> None:
        if not self._station.present:
            return
        if not self._is_quiet():
            self._clock.at(self._clock.now_ns + _EVERY_NS[0], self._attack)
            return
        attacks = [self._forged, self._foreign, *([self._replayed, self._reordered, self._cut] if self._heard else [])]
        is_silent = self._clock.now_ns - self._spoke_ns < _DUE_NS[0]
        attacks += [self._emergency, *([self._refusal] if self._epochs and is_silent else [])]
        first, *tag = self._random.choice(attacks)()
        self._bus.offer(self._station, first)
        for frame in tag:
            self._clock.at(self._clock.now_ns + _TAG_AFTER_NS, lambda frame=frame: self._say_tag(frame))  # type: ignore[misc]
        self.attacks += 1
        self._clock.at(self._clock.now_ns + self._random.randint(*_EVERY_NS), self._attack)

    def _say_tag(self, frame: Frame) -> None:
        """Send the forged TAG that follows a forged command, except if a manager has begun to send meanwhile."""
        if self._station.present and self._is_quiet():
            self._bus.offer(self._station, frame)

    def _is_quiet(self) -> bool:
        """Tell whether a manager is unlikely to send now."""
        now_ns = self._clock.now_ns
        # neither a manager's frame nor a page 2, which a manager would answer
        has_ended = now_ns - self._heard_ns >= _PAUSE_NS
        # nor is the next LEASE due: it is to come later, or is long overdue
        return has_ended and not _DUE_NS[0] < now_ns - self._leased_ns < _DUE_NS[1]

    def _made_up(self, manager: int, term: int) -> Frame:
        """Return a made-up command that would do harm if a PE accepted it."""
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

    def _emergency(self) -> tuple[Frame, ...]:
        draw, node = self._random.randrange, self._random.choice(_ACCUSERS)
        kind = self._random.choice((ElementKind.PE, ElementKind.DEVICE, ElementKind.MODULE))
        return (Frame(emcy_id(node), Emergency(FaultCode.REPORTED, 0x81, kind, draw(4), draw(8)).encode()),)

    def _refusal(self) -> tuple[Frame, ...]:
        epoch, digest = self._epochs[self._spoke], self._random.randrange(1 << 24)
        page = StatePage1(PeState.ACTIVE, PeFlags.HEARS_LEASE, epoch, digest, Reason.IMAGE, 0)
        return (Frame(self._spoke, page.encode()),)
