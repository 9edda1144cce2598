"""An attacker without the key that denies service. It sends one kind of forged frame again and again.

The forged frames take a given share of a bus.

    forged_welcome  WELCOME to every PE with a made-up TAG. If a PE requested a session after each WELCOME, it would
                    lose the session that it has
    forged_tag      TAGs of every kind that belong to no command
    forged_beat     page 0 in the name of a PE, with a wrong tag: the manager might doubt the PE
    forged_nonce    page 2 with a made-up nonce: the manager might answer it instead of the PE's nonce
    forged_epoch    page 0 of a PE in a newer epoch: other PEs might hold their outputs back
    forged_mastership    LEASE, ALIVE and ACTIVATE in the name of a manager, under a high term
    forged_restart  page 0 of a PE that seems to have restarted
    forged_refusal  page 1 of a PE that refuses the running configuration
    forged_report   EMCYs in the name of every PE, about PEs, devices and modules
    forged_order    PING, RENEW, UNLOCK and CLEAR to every PE, and NMT
    forged_session  against one PE: first ten wrong pages 0 in its name. Then, after each page 0 of the PE itself:
                    a WELCOME, so that the PE requests a session, and six nonces, so that the manager may answer
                    one of these
    forged_all      all of these in random order

`Forgery` makes the frames, `Denier` sends them on a simulated bus. The attacker sends only while the bus is free, so
that its frames do not collide with those of the node that it imitates (`forger` says why).
"""

from collections.abc import Callable, Collection, Mapping
from random import Random

from heronry_dg.model import Spec
from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.stranger import STRANGER
from heronry_wire.frame import Frame
from heronry_wire.identifiers import (
    FIRST_MANAGER,
    LAST_MANAGER,
    Command,
    emcy_id,
    management_id,
    state_id,
)
from heronry_wire.management import (
    MAX_TERM,
    NO_EPOCH,
    TAG,
    WELCOME_KIND,
    Activate,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    ManagementMessage,
    Operation,
    Ping,
    Step,
)
from heronry_wire.sansio import Received
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1, StatePage2, decode_state
from heronry_wire.timing import exact_bits

DENIALS: Mapping[str, str] = {
    "forged_welcome": "answers to nonces",
    "forged_tag": "tags",
    "forged_beat": "states",
    "forged_nonce": "requests for a session",
    "forged_epoch": "states of a newer epoch",
    "forged_mastership": "LEASE, ALIVE and ACTIVATE",
    "forged_restart": "states of PEs that seem to have started anew",
    "forged_refusal": "refusals of PEs",
    "forged_report": "reports of faults",
    "forged_order": "PING, RENEW, UNLOCK, CLEAR and NMT",
    "forged_session": "whatever may end the session of one PE",
    "forged_all": "frames of all these kinds",
}
"""The kinds of fault that may deny service to an aircraft without a key, and what each of them forges."""

_NS_PER_S = 1_000_000_000
_AGAIN_NS = 20_000  # from one attempt to send to the next, while the bus is busy
_NEWER = 100  # how far a forged epoch is above the running epoch, at most
_WRONG_FIRST = 10
_NONCES_AFTER_A_WELCOME = 6
_NMT_ID = 0


class Forgery:
    """Makes forged frames of one kind; some of them repeat what PEs have reported on the bus (`hear`)."""

    def __init__(self, random: Random, *, spec: Spec, kind: str) -> None:
        """Begin with nothing heard; `kind` is one of `DENIALS`."""
        self._random = random
        self._nodes = [pe.node_id for pe in spec.pes.values()]
        self._pages: dict[int, StatePage0] = {}  # by node: the last page 0 that it has sent
        self._forged: dict[str, Callable[[], list[Frame]]] = {
            "forged_welcome": self._welcome,
            "forged_tag": self._tag,
            "forged_beat": self._beat,
            "forged_nonce": self._nonce,
            "forged_epoch": self._epoch,
            "forged_mastership": self._mastership,
            "forged_restart": self._restart,
            "forged_refusal": self._refusal,
            "forged_report": self._report,
            "forged_order": self._order,
            "forged_session": self._session,
        }
        self._kind = kind
        self._next: list[Frame] = []
        self._victim, self._wrong, self._has_beaten = random.choice(self._nodes), 0, False
        self._due_nonces = 0  # before the next WELCOME
        self._nodes_of = {state_id(node): node for node in self._nodes}

    @property
    def listens_to(self) -> Collection[int]:
        """Return the identifiers of the frames that `hear` must be given."""
        return self._nodes_of.keys()

    def hear(self, frame: Frame) -> None:
        """Note what a PE reports in its page 0; ignore all other frames."""
        node = self._nodes_of.get(frame.can_id)
        page = None if node is None else decode_state(frame.data)
        if node is not None and isinstance(page, StatePage0):
            self._pages[node] = page
            self._has_beaten |= node == self._victim

    def next_frame(self) -> Frame:
        """Make the next frame."""
        self._next = self._next or self._forged.get(self._kind, self._any)()
        return self._next.pop(0)

    def pause_ns(self, frame: Frame, bitrate: int, share_percent: int) -> int:
        """Draw the time from this frame to the next one, so that the forged frames take this share of the bus."""
        even_ns = round(exact_bits(frame) * _NS_PER_S / (bitrate * (share_percent / 100)))
        return self._random.randint(even_ns // 2, even_ns * 3 // 2)

    # The frames of each kind

    def _node(self) -> int:
        return self._victim if self._kind == "forged_session" else self._random.choice(self._nodes)

    def _page(self, node: int) -> StatePage0:
        heard = self._pages.get(node)
        return heard or StatePage0(PeState.ACTIVE, PeFlags.HEARS_LEASE, 1, 1, 0, 0)

    def _tagged(self, command: Command, message: ManagementMessage, manager: int, kind: int) -> list[Frame]:
        draw = self._random.randrange
        tag = TAG.pack(kind, draw(1 << 13), draw(1 << 48))
        return [
            Frame(management_id(manager, command), message.encode()),
            Frame(management_id(manager, Command.TAG), tag),
        ]

    def _manager(self) -> int:
        return self._random.choice((FIRST_MANAGER, LAST_MANAGER))

    def _welcome(self) -> list[Frame]:
        draw = self._random.randrange
        message = Control(1 + draw(8), self._node(), Operation.WELCOME, draw(1 << 16), draw(1 << 16))
        return self._tagged(Command.CONTROL, message, self._manager(), WELCOME_KIND)

    def _tag(self) -> list[Frame]:
        draw = self._random.randrange
        data = TAG.pack(draw(8), draw(1 << 13), draw(1 << 48))
        return [Frame(management_id(self._manager(), Command.TAG), data)]

    def _beat(self, **changes: int) -> list[Frame]:
        node = self._node()
        page = self._page(node)
        fields = {"incarnation": page.incarnation, "epoch": page.epoch, "sequence": page.sequence + 1, **changes}
        said = StatePage0(
            PeState(fields.get("state", page.state)),
            page.flags,
            fields["incarnation"] % 256,
            fields["epoch"] % (1 << 16),
            fields["sequence"] % 256,
            self._random.randrange(1 << 24),
        )
        return [Frame(state_id(node), said.encode())]

    def _nonce(self) -> list[Frame]:
        page = StatePage2(PeState.ACTIVE, PeFlags.HEARS_LEASE, 1 + self._random.randrange((1 << 56) - 1))
        return [Frame(state_id(self._node()), page.encode())]

    def _epoch(self) -> list[Frame]:
        newest = max((page.epoch for page in self._pages.values()), default=1)
        return self._beat(epoch=newest + 1 + self._random.randrange(_NEWER))

    def _restart(self) -> list[Frame]:
        return self._beat(epoch=NO_EPOCH, state=PeState.UNCONFIGURED, incarnation=self._random.randrange(256))

    def _refusal(self) -> list[Frame]:
        node = self._node()
        digest = self._random.randrange(1 << 24)
        page = StatePage1(PeState.ACTIVE, PeFlags.HEARS_LEASE, self._page(node).epoch, digest, Reason.IMAGE, load=0)
        return [Frame(state_id(node), page.encode())]

    def _report(self) -> list[Frame]:
        draw = self._random.randrange
        kind = self._random.choice((ElementKind.PE, ElementKind.DEVICE, ElementKind.MODULE))
        said = Emergency(FaultCode.REPORTED, 0x81, kind, draw(8), draw(1 << 8))
        return [Frame(emcy_id(self._node()), said.encode())]

    def _mastership(self) -> list[Frame]:
        draw, term = self._random.randrange, self._random.choice((2, 3, MAX_TERM))
        epoch = 1 + draw(0xFFFF)
        said: list[tuple[Command, ManagementMessage]] = [
            (Command.LEASE, Lease(term, epoch, Step.GO_ALL, draw(1 << 24))),
            (Command.ALIVE, Alive(term, draw(256), frozenset())),
            (Command.ACTIVATE, Activate(term, epoch, Step.GO_ALL, draw(1 << 24))),
        ]
        command, message = self._random.choice(said)
        return self._tagged(command, message, self._manager(), command)

    def _order(self) -> list[Frame]:
        draw, node, term = self._random.randrange, self._node(), self._random.choice((1, 2, 3))
        if not draw(4):
            return [Frame(_NMT_ID, bytes((self._random.choice((2, 128, 129, 130)), node)))]
        said: list[tuple[Command, ManagementMessage]] = [
            (Command.PING, Ping(term, node, draw(256))),
            (Command.CONTROL, Control(term, node, Operation.RENEW)),
            (Command.CONTROL, Control(term, node, Operation.UNLOCK, 60)),
            (Command.CONTROL, Control(term, node, Operation.CLEAR, draw(4), draw(8))),
        ]
        command, message = self._random.choice(said)
        return self._tagged(command, message, self._manager(), command)

    def _session(self) -> list[Frame]:
        self._wrong += 1
        if self._wrong <= _WRONG_FIRST:
            return self._beat()
        if self._has_beaten and not self._due_nonces:
            self._has_beaten, self._due_nonces = False, _NONCES_AFTER_A_WELCOME
            return self._welcome()
        self._due_nonces = max(0, self._due_nonces - 1)
        return self._nonce()

    def _any(self) -> list[Frame]:
        return self._random.choice([*self._forged.values()])()


class Denier:
    """An attacker that sends forged frames of one kind from its creation until it leaves the bus."""

    def __init__(
        self, clock: Clock, bus: SimulatedBus, random: Random, *, spec: Spec, kind: str, share_percent: int
    ) -> None:
        """Begin to send forged frames of this kind, which take `share_percent` of the bus."""
        self._clock, self._bus, self._share_percent = clock, bus, share_percent
        self._forgery = Forgery(random, spec=spec, kind=kind)
        self._station = bus.join(f"{STRANGER}{kind}", 0, self._hear, self._forgery.listens_to)
        self._attack()

    def leave(self) -> None:
        """Leave the bus."""
        if self._station.present:
            self._bus.leave(self._station)

    def _hear(self, event: Received) -> None:
        self._forgery.hear(event.frame)

    def _attack(self) -> None:
        if not self._station.present:
            return
        wait_ns = _AGAIN_NS
        if self._bus.is_free and self._station.mailbox is None:
            frame = self._forgery.next_frame()
            self._bus.offer(self._station, frame)
            wait_ns = self._forgery.pause_ns(frame, self._bus.bitrate, self._share_percent)
        self._clock.at(self._clock.now_ns + wait_ns, self._attack)
