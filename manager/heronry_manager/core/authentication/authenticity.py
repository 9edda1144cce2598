"""Authentication in a manager with a key: it tags every command, and accepts only proven states (protocol rule 11).

A PE sends a nonce in page 2, and the manager answers the nonce with WELCOME. The number of this answer names a
*session*. From then on the PE tags its pages 0 and 1 in this session. For the manager, a PE is in one of three states:

    no session    nothing from this PE counts. The manager answers a nonce that was made with the key (`nonce_answers`)
    offered       one or more answers have gone out, and each offers a session. No page 0 that is tagged in one of these
                  sessions has been believed yet
    open          a page 0 that is tagged in the session has been believed

A session is open until the PE tags a page 0 in a newer session. A PE begins a newer session only after its own restart,
in a new term, after RENEW, or when it has accepted no command for T_lease. Frames without proof end no session.

*Commands out.* Each command is followed by its TAG, and the TAGs of a term are numbered (`command_tags`). The driver
writes a term to disk before the manager sends anything in this term. So even after a restart no term is used twice, and
no number is used twice.

*States in.* The 24 bits of the tag are in the page where its digest would be. The tag covers the content of the page,
the session, and the digest of the running or staged configuration. A tag holds in one session only, so a state that was
recorded earlier proves nothing. Since the digest is not in the frame, the manager tries the digests that this PE may
mean: the digest of the epoch as this manager knows it, and for page 0 also the digests that the PE has named in page 3.
If the tag is right, the digest is put back where the tag was. A late or doubled page 0 is refused, since its number is
not above the last one. Page 1 needs no number, since what a PE reports on an epoch stays true as long as its session
lasts. A recorded page 1 may come again, so a page 1 does not show that the PE lives.

*Without a tag.* Page 3 and the reports of gateways on radios have no room for a proof; page 3 only names digests that
the manager tries. Page 2 names a nonce. The nonce itself contains a tag, which shows that a holder of the key has made
the nonce, now or earlier.

*EMCY.* The tag of a page 0 with the flag FAULT_PENDING also covers one EMCY. The manager holds each EMCY of a PE until
such a page proves it, and tries all EMCYs that it holds. After a lost EMCY, page 0 cannot be believed until the PE has
repeated the EMCY. When a page 0 reports no pending fault, the manager forgets the EMCYs of this PE. If an EMCY is
forgotten without proof, each frame that brought it counts as forged. EMCYs with some codes (`_SENT_ONCE`) are never
pending, so no page 0 proves them, and with a key they have no effect. An EMCY about a lost channel counts without
proof, and is not handed to this file.

*A PE that is not believed.* A restarted PE requests a session by itself: it sends its nonce until an answer comes. If a
PE is heard, but cannot be believed for T_lease, the manager sends RENEW, and the PE requests a new session. The reason
may be that the PE has missed the answer that opened its session, or that this manager has missed too many states of the
PE. If RENEW changes nothing, an event reports the PE: the PE has another key, or none, or its receiver has failed.

*Guessing.* A forger finds 24 bits by chance in 16 million tries. Once GUESSES tags of a PE were wrong, a page 0 of that
PE counts only if the tag of the page 0 before was right as well: a forger cannot guess two tags in a row. This rule
holds until no wrong tag has come for FORGIVEN_PERIODS. While it holds, a lost frame makes the manager miss the PE for
one more period; if no frame is lost, the rule has no effect.

*Standby.* A standby manager follows the sessions that the active manager opens. It hears the nonce and the answer, and
the TAG of the answer proves both. If the standby manager has missed an answer, or knows a newer session than that of
the answer, the answer opens no session.

*Other managers.* This manager believes another manager only if the commands of that manager carry right tags with
rising numbers; commands without such tags end no mastership. A TAG carries only the lower bits of the number. A PE
learns the upper bits from the answer to its nonce. A standby manager sends no nonce, and finds the upper bits by
trying. A command under this manager's own node-ID comes from a second manager only if its number is above this
manager's last one; any other command under this node-ID may be a replay of this manager's own commands.

*Counts.* A forged state is counted in `refused`, a forged EMCY in `unproven`, and the status shows both. `attack_rate`
counts all frames without proof. `command_tags` says what follows if a command or its TAG is lost. After a restart the
manager knows no session, and every PE that hears the new term requests one.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.authentication.attack_rate import AttackRate
from heronry_manager.core.authentication.nonce_answers import NonceAnswers
from heronry_manager.core.topology import uplink_bus
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import ManagerAction
from heronry_wire.authentication import BEAT_SPAN, NO_EMERGENCY, PAGE_1_BEAT, Key, Place, Session, next_number
from heronry_wire.command_tags import CommandSigner, CommandVerifier, Held
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import MANAGER_NODES, Command
from heronry_wire.management import (
    NO_EPOCH,
    WELCOME_KIND,
    Control,
    FaultCode,
    Operation,
    decode_command,
    decode_emergency,
    decode_tag,
)
from heronry_wire.protocol_times import t_lease_ns
from heronry_wire.sansio import Received, Send
from heronry_wire.state_frames import PeFlags, StatePage, StatePage0, StatePage1, StatePage2, StatePage3, split_state

GUESSES = 8  # wrong tags, after which a page 0 counts only if the page 0 before it was proven as well
FORGIVEN_PERIODS = 256  # heartbeat periods without a wrong tag, after which the wrong tags are forgotten
_OFFERS = 8  # answers to one PE that are remembered: as many as `NonceAnswers` allows in two periods
_NAMED = 3
_NONCES = 8  # nonces of one PE that are remembered: an overheard answer may belong to any of them
_ANSWERS = 40  # answers of one manager that wait for their TAG: it may answer all PEs together
_HELD = 64  # EMCYs of one PE that wait for their proof
_PROVEN = -1
_SENT_ONCE = (
    FaultCode.RESET,
    FaultCode.DISAGREEMENT,
    FaultCode.UNKNOWN_ELEMENT,
    FaultCode.UNKNOWN_OUTPUT,
    FaultCode.UNKNOWN_INPUT,
)
_TOLD_EVERY_NS = 1_000_000_000
_COMMAND_FRAMES = 2  # the command itself, and its TAG
_IN_VAIN = 2  # RENEWs without effect, then an event: even a PE that was just restarted answers one of two
_IN_A_ROW = 2  # two states are in a row if the second number is higher by at most this much


@dataclass(slots=True)
class _Opened:
    """A session that was opened or offered.

    beat: the number of the last page 0 that was believed in this session; -1: none.
    """

    session: Session
    beat: int = -1


@dataclass(slots=True)
class _Peer:
    """What one PE has proven with the key, and the data by which its next state may be proven."""

    node: int
    period_ns: int
    answers: NonceAnswers
    opened: _Opened | None = None
    offers: deque[_Opened] = field(default_factory=lambda: deque(maxlen=_OFFERS))
    named: deque[int] = field(default_factory=lambda: deque(maxlen=_NAMED))  # digests that its pages 3 have named
    nonces: deque[int] = field(default_factory=lambda: deque(maxlen=_NONCES))  # that it has sent
    doubted_ns: int | None = None  # since when it has been heard without being believed
    renewals: int = 0  # sent to it since it was last believed
    wrong: int = 0  # wrong tags, while they kept coming
    wrong_ns: int = 0
    fitted: tuple[Session, int] | None = None  # the last page 0 with a right tag, believed or not
    held: dict[bytes, int] = field(default_factory=dict)  # every EMCY since the PE last had none pending, oldest first,
    # and how often it was heard; `_PROVEN` once a page 0 has proven it
    proven: bytes = NO_EMERGENCY  # the EMCY that the last page 0 has proven
    refused: int = 0  # states that were not believed
    unproven: int = 0  # EMCYs that were forgotten without proof
    refuses: tuple[int, int] = (0, 0)  # commands that the PE has refused, as its page 3 counts them: unproven, other
    told: tuple[int, int] = (0, 0)  # `refuses` as an event last reported it, and the time of that event
    told_ns: int | None = None

    def sessions(self) -> list[_Opened]:
        """Return the sessions in which the PE may have tagged its next state: the open one, and those offered since."""
        return [*([] if self.opened is None else [self.opened]), *self.offers]


@dataclass(frozen=True, slots=True)
class _Overheard:
    """An answer of another manager to the nonce of a PE, kept until its TAG comes."""

    peer: _Peer
    session: Session
    said: bytes


class Authenticity:
    """Tags the commands of one manager with its key, and verifies the tags in the frames of PEs and other managers."""

    def __init__(
        self,
        spec: Spec,
        turn: Turn,
        key: Key,
        *,
        digest_of: Callable[[int], int | None],
        speaks: Callable[[], bool],
    ) -> None:
        """Begin without any session.

        digest_of: gives the digest of the epoch with a number, or None if this manager does not know the epoch.
            A standby manager knows the epochs of the manager that it follows.
        speaks: tells whether this manager sends LEASE; only a manager that sends LEASE sends RENEW.
        """
        self._spec, self._turn, self._key = spec, turn, key
        self._digest_of, self._speaks = digest_of, speaks
        self.forget()

    def forget(self) -> None:
        """Forget all sessions, and what waits for a proof."""
        spec, turn, key = self._spec, self._turn, self._key
        self._signer = CommandSigner(key, turn.node, turn.term)
        self._managers = CommandVerifier(key, t_lease_ns(spec.buses[spec.manager.bus].heartbeat_ns), seek=True)
        periods_ns = {pe: spec.buses[uplink_bus(spec, pe)].heartbeat_ns for pe in spec.pes}
        self._peers = {
            pe.name: _Peer(pe.node_id, periods_ns[pe.name], NonceAnswers(periods_ns[pe.name]))
            for pe in spec.pes.values()
        }
        self._attack = AttackRate(turn, spec.manager.bus, spec.buses[spec.manager.bus].bitrate)
        self._by_node = {peer.node: peer for peer in self._peers.values()}
        self._answers: list[tuple[_Peer, int]] = []  # nonces that the end of this turn answers
        self._overheard: dict[int, deque[_Overheard]] = {node: deque(maxlen=_ANSWERS) for node in MANAGER_NODES}
        turn.seal = self._seal

    def status(self, pe: str) -> dict[str, Any]:
        """Return what the status shows of a PE: whether this manager believes the states of the PE, and three counts.

        The counts: states in the name of the PE that were not believed, commands that the PE has refused, and EMCYs in
        the name of the PE that were never proven.
        """
        peer = self._peers[pe]
        return {
            "is_believed": peer.doubted_ns is None and peer.opened is not None,
            "refused_states": peer.refused,
            "refused_commands": sum(peer.refuses),
            "unproven_reports": peer.unproven,
        }

    # What goes out

    def _seal(self, actions: list[ManagerAction]) -> list[ManagerAction]:
        """Return these actions with a TAG behind each command, and then the answers to nonces.

        An answer is given to each nonce for which `answer` was called since the last event.
        """
        if self._signer.term != self._turn.term:  # this standby manager has taken over
            self._signer = CommandSigner(self._key, self._turn.node, self._turn.term)
        sealed: list[ManagerAction] = []
        for action in actions:
            sealed.append(action)
            tag = self._signer.tag(action.frame) if isinstance(action, Send) else None
            if tag is not None:
                sealed.append(Send(0, tag))
        for peer, nonce in self._answers:
            sealed += [Send(0, frame) for frame in self._signer.welcome(peer.node, nonce)]
            peer.offers.append(_Opened(Session(self._turn.node, self._turn.term, self._signer.number)))
        self._answers.clear()
        return sealed

    def answer(self, pe: str, page: StatePage2) -> None:
        """Answer the nonce in page 2 of a PE, to offer the PE a session; the answer goes out at the end of this turn.

        The same nonce is answered once in a heartbeat period at most.
        """
        peer = self._peers[pe]
        if peer.answers.is_due(page.nonce, self._turn.now_ns):
            self._answers.append((peer, page.nonce))

    # What comes in

    def believed(self, pe: str, page: StatePage, data: bytes) -> StatePage | None:
        """Check a page that a PE has sent; gives the page, or None if it is not believed.

        page 0, 1: believed if the tag is right; given with the digest in place of the tag.
        page 2: believed if its nonce was made with the key.
        page 3: has no proof, and is always given.
        """
        peer = self._peers[pe]
        match page:
            case StatePage0():
                return self._proven(pe, peer, page, split_state(data)[0])
            case StatePage1():
                return self._staged(peer, page, split_state(data)[0])
            case StatePage2(nonce=nonce):
                if not self._key.is_plausible(peer.node, nonce):
                    self._refuse(peer)
                    return None
                if nonce not in peer.nonces:
                    peer.nonces.append(nonce)
            case _:
                self._told(pe, peer, page)
        return page

    def _refuse(self, peer: _Peer) -> None:
        peer.refused += 1
        self._attack.forged()

    def _told(self, pe: str, peer: _Peer, page: StatePage3) -> None:
        """Note what page 3 of a PE says: a digest of what the PE runs, and how many commands it has refused."""
        if page.digest not in peer.named:
            peer.named.append(page.digest)
        peer.refuses, now_ns = (page.unproven, page.other), self._turn.now_ns
        is_new = peer.refuses > peer.told and (peer.told_ns is None or now_ns - peer.told_ns >= _TOLD_EVERY_NS)
        if is_new:
            self._turn.emit(events.CommandsRefused, pe=pe, unproven=page.unproven, other=page.other)
        if is_new or sum(peer.refuses) < sum(peer.told):  # the PE has been restarted
            peer.told, peer.told_ns = peer.refuses, now_ns

    def hold_emergency(self, pe: str, emergency: bytes) -> None:
        """Keep an EMCY of a PE until a page 0 of that PE proves it; if too many are kept, drop the oldest."""
        peer = self._peers[pe]
        if emergency not in peer.held and len(peer.held) == _HELD:
            self._forget(peer, next(iter(peer.held)))
        heard = peer.held.setdefault(emergency, 0)
        if heard != _PROVEN:
            peer.held[emergency] = heard + 1

    def _forget(self, peer: _Peer, emergency: bytes) -> None:
        """Forget an EMCY; if no page 0 has proven it, every frame that brought it counts as forged.

        These frames also count in `unproven`, which the status shows, unless the code of the EMCY is in
        `_SENT_ONCE`. No page 0 proves an EMCY with such a code, so this EMCY may be genuine.
        """
        heard = peer.held.pop(emergency)
        if heard == _PROVEN:
            return
        self._attack.forged(heard)
        said = decode_emergency(emergency)
        if isinstance(said, Malformed) or said.code not in _SENT_ONCE:
            peer.unproven += heard

    def take_emergency(self, pe: str) -> bytes | None:
        """Return the EMCY that the tag of the last page 0 of a PE covers, and forget it.

        None: the tag covers no EMCY, or the EMCY was given before.
        """
        peer = self._peers[pe]
        proven, peer.proven = peer.proven, NO_EMERGENCY
        return proven or None

    def overhear(self, manager: int, control: bytes) -> None:
        """Keep another manager's answer to a nonce until its TAG proves it and opens the session."""
        order = decode_command(Command.CONTROL, control)
        if isinstance(order, Control) and order.operation is Operation.WELCOME and order.node in self._by_node:
            session = Session(manager, order.term, order.a << 16 | order.b)
            self._overheard[manager].append(_Overheard(self._by_node[order.node], session, control))

    def _follow(self, manager: int, tag: bytes) -> bool:
        """Open the session that another manager offers with a WELCOME, if this TAG proves the WELCOME.

        Only the WELCOMEs of `manager` that were kept are tried. The session is with the PE to which the WELCOME
        was sent. It is not opened if the same or a newer session of this PE is known.

        Returns whether a session was opened.
        """
        kind, _, proof = decode_tag(tag) or (None, 0, 0)
        for answer in list(self._overheard[manager]) if kind == WELCOME_KIND else []:
            peer, place = answer.peer, Place(answer.session.term, answer.session.number)
            covers = (self._key.command_tag(manager, WELCOME_KIND, place, answer.said, one) for one in peer.nonces)
            if proof in covers:
                self._overheard[manager].remove(answer)
                if all(place > Place(known.session.term, known.session.number) for known in peer.sessions()):
                    peer.offers.append(_Opened(answer.session))
                    return True
        return False

    def hold(self, manager: int, command: Command, event: Received) -> None:
        """Keep a command of another manager, and the event that brought it, until the TAG of the command comes."""
        self._managers.hold(manager, command, event, self._turn.now_ns)

    def proven(self, manager: int, tag: bytes) -> Held | None:
        """Return the command of another manager that this TAG proves; None: it proves none, or a WELCOME to a PE.

        A command that may be a replay of one of this manager's own commands does not count as proven. A TAG that
        proves nothing counts as forged, and so does its command.
        """
        if self._follow(manager, tag):
            return None
        found = self._managers.tagged(manager, tag, self._turn.now_ns)
        if not isinstance(found, Held) or self._was_mine(manager):
            self._attack.forged(_COMMAND_FRAMES)
            return None
        return found

    def _was_mine(self, manager: int) -> bool:
        """Tell whether the command proven last may be a replay of one that this manager has tagged."""
        mine = Place(self._signer.term, self._signer.number)
        return manager == self._turn.node and self._managers.places[manager] <= mine

    def _proven(self, pe: str, peer: _Peer, page: StatePage0, said: bytes) -> StatePage0 | None:
        found = self._find(peer, page, said)
        if found is None:
            self._doubt(pe, peer, page)
            return None
        opened, beat, digest, emergency = found
        last, peer.fitted = peer.fitted, (opened.session, beat)
        if self._is_guessed_at(peer) and not _is_next(last, opened.session, beat):
            peer.refused += 1
            return None
        opened.beat = beat
        if opened is not peer.opened:
            peer.opened = opened
            peer.offers.remove(opened)
        peer.doubted_ns, peer.renewals = None, 0
        peer.proven = emergency
        if emergency:
            peer.held[emergency] = _PROVEN
        if PeFlags.FAULT_PENDING not in page.flags:
            for one in list(peer.held):
                self._forget(peer, one)
        return replace(page, digest=digest)

    def _find(self, peer: _Peer, page: StatePage0, said: bytes) -> tuple[_Opened, int, int, bytes] | None:
        """Find the values with which the tag of a page 0 is right; None: the tag is wrong.

        Returns the session, the number of the page in the session, the digest of the configuration that runs,
        and the EMCY that the tag covers (`NO_EMERGENCY` if the page reports no pending fault).

        said: the content of the page that the tag covers.
        """
        emergencies = [*peer.held] if PeFlags.FAULT_PENDING in page.flags else [NO_EMERGENCY]
        covered = [(digest, emergency) for digest in self._digests(peer, page.epoch) for emergency in emergencies]
        for one in peer.sessions():
            beat = next_number(one.beat, page.sequence, BEAT_SPAN)
            for digest, emergency in covered:
                if self._key.state_tag(peer.node, one.session, beat, said, digest, emergency=emergency) == page.digest:
                    return one, beat, digest, emergency
        return None

    def _staged(self, peer: _Peer, page: StatePage1, said: bytes) -> StatePage1 | None:
        """Check the tag of a page 1; gives the page with a digest in place of the tag.

        This digest is that of the page's epoch if the PE has staged the epoch, and 0 if not. Returns None if the tag is
        wrong, or if the digest of the epoch is not known here.
        """
        known = self._digest_of(page.staged_epoch)
        if known is None:
            return None
        for one in peer.sessions():
            for digest in (known, 0):
                if self._key.state_tag(peer.node, one.session, PAGE_1_BEAT, said, digest) == page.staged_digest:
                    return replace(page, staged_digest=digest)
        self._refuse(peer)
        return None

    def _digests(self, peer: _Peer, epoch: int) -> list[int]:
        if epoch == NO_EPOCH:
            return [0]
        known = self._digest_of(epoch)
        return [*peer.named] if known is None else [known, *(digest for digest in peer.named if digest != known)]

    def _doubt(self, pe: str, peer: _Peer, page: StatePage0) -> None:
        """Note that a page 0 of a PE was not believed; if none was believed for T_lease, send the PE RENEW.

        The tag of the page counts as wrong only if it is not 0, and a session was opened with or offered to the
        PE before. Only a manager that sends LEASE sends RENEW.
        """
        now_ns = self._turn.now_ns
        if page.digest and (peer.opened or peer.offers):
            self._refuse(peer)
            peer.wrong = peer.wrong + 1 if self._is_recent(peer) else 1
            peer.wrong_ns = now_ns
            if peer.wrong == GUESSES:
                self._turn.emit(events.StatesDoubted, pe=pe, refused=peer.refused)
        if peer.doubted_ns is None or not self._speaks():
            peer.doubted_ns = now_ns
        elif now_ns - peer.doubted_ns >= t_lease_ns(peer.period_ns):
            peer.doubted_ns = now_ns
            self._turn.send(Command.CONTROL, Control(self._turn.term, peer.node, Operation.RENEW))
            peer.renewals += 1
            if peer.renewals == _IN_VAIN:
                self._turn.emit(events.StatesUnproven, pe=pe)

    def _is_guessed_at(self, peer: _Peer) -> bool:
        return peer.wrong >= GUESSES and self._is_recent(peer)

    def _is_recent(self, peer: _Peer) -> bool:
        return self._turn.now_ns - peer.wrong_ns <= FORGIVEN_PERIODS * peer.period_ns


def _is_next(last: tuple[Session, int] | None, session: Session, beat: int) -> bool:
    return last is not None and last[0] == session and 0 < beat - last[1] <= _IN_A_ROW
