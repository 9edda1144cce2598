"""Which commands a PE with a key accepts: new ones that a holder of the key has tagged (protocol rule 11).

*Commands.* A TAG is a frame that follows a command, and proves that a holder of the key has sent the command. Every
command passes this file before its handler is called:

- The PE holds a command until its TAG comes, for at most T_lease. (The TAG may be late if the manager's computer is
  busy.)
- If the TAG is valid, the handler gets the command, with the time at which the command itself arrived. If the handler
  forwards the command, the TAG is forwarded after it.
- A command without a valid TAG changes nothing. It is counted (`command_tags.Refusal`), and page 3 of the state reports
  the count.

*Welcome.* After its start a PE accepts no command, since every command that it hears may be old. So the PE sends a
nonce (page 2). The active manager answers with the command WELCOME, whose tag covers this nonce. Each manager numbers
its commands. From the WELCOME on, the PE accepts a command of this manager if the number of the command is above that
of the last accepted command. Like any command, a WELCOME names a term, so the PE then refuses commands of the previous
manager.

After the first nonce, the PE sends a nonce in three cases, at most once in a heartbeat period:

- It has no session, and hears a manager. The PE or the manager has restarted, or the standby manager has taken over.
- It has accepted no command for T_lease, and hears commands that it cannot verify. It may have missed so many commands
  that it cannot derive their numbers any more, since a TAG carries only the lowest 13 bits of a number.
- A manager that has not welcomed it sends a LEASE or ACTIVATE with a higher term, and with a tag made with the key.

In any other case the PE does not react to commands that it cannot verify, since any node can send such commands.

*Session.* The number of the WELCOME also identifies the session under which the PE tags its states from then on: a
manager uses no number twice in a term. A manager that begins a new term has no session with this PE until it has
welcomed the PE. Pages 0 and 1 on the uplink carry the tag; on other ports, and without a session, the tag is 0.

*EMCY.* An EMCY is authenticated by the next page 0, whose tag covers one pending EMCY. If several are pending,
successive pages cover them in turn. A new EMCY causes an immediate page 0, so that its authentication is not delayed.

*Overtaken.* The PE executes no command of a manager that has not welcomed it. But a LEASE or ACTIVATE with a tag made
with the key proves that its epoch was activated at some time. If this epoch is newer than that of the PE, the PE is
overtaken (`output_authorization`); an older epoch proves nothing. A PE whose transmitter has failed depends on this
proof: it cannot send a nonce, so a new manager cannot welcome it.

*Lock.* The PE refuses NMT commands and SDO downloads until the active manager sends it UNLOCK, and again after the time
that UNLOCK gives. While the lock is open, any node can send SDO requests, since an SDO request does not name its
sender. So a table must also be sealed with the key for the challenge of this start (`opened`).

*Lost, late, doubled and forged frames.* If a page 2, a WELCOME or a TAG is lost, the PE sends its nonce again at the
manager's next command. A WELCOME that comes more than T_lease after the nonce was drawn is refused. A doubled WELCOME
is refused, too, since its number is not above the last one. Forged commands are refused and counted. After a restart
the PE has no session and no open lock, and its nonces come from another salt.

A gateway cannot verify a WELCOME for another node. It forwards the WELCOME toward that node, with the TAG that follows.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from heronry_agent.core.authority.followed_manager import FollowedManager
from heronry_agent.core.authority.nonces import Nonces, drawn_challenge
from heronry_agent.core.authority.passing_welcomes import PassingWelcomes
from heronry_agent.core.authority.state_seal import StateSeal
from heronry_agent.core.forwarding import Gateway
from heronry_agent.core.reports import Facts
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_wire.authentication import Key
from heronry_wire.command_tags import CommandVerifier, Held, Refusal
from heronry_wire.frame import Frame
from heronry_wire.identifiers import MANAGER_NODES, Command, classify, management_id, state_id
from heronry_wire.management import (
    NO_EPOCH,
    WELCOME_KIND,
    Activate,
    Control,
    Lease,
    Operation,
    Step,
    control_node,
    decode_command,
    is_welcome,
    tag_kind,
)
from heronry_wire.protocol_times import STATE_PAGE_1_EVERY
from heronry_wire.sansio import Received, Send
from heronry_wire.state_frames import StatePage2, StatePage3

LONGEST_UNLOCK_S = 60
_NS_PER_S = 1_000_000_000

Handler = Callable[[Received], None]


@dataclass(frozen=True, slots=True)
class Secret:
    """The key of a PE, and a random salt, new at every start, which makes the nonces unpredictable."""

    key: Key
    salt: bytes


class Authenticity:
    """Verifies with a key the commands to one PE, and computes the tags of the PE's state pages."""

    def __init__(
        self,
        turn: Turn,
        index: TableIndex,
        followed_manager: FollowedManager,
        gateway: Gateway,
        *,
        facts: Callable[[], Facts],
        pending: Callable[[], Sequence[bytes]],
        secret: Secret,
        saw_epoch: Callable[[int], None] = lambda _: None,
    ) -> None:
        """Begin without a session; the lock is closed, so NMT commands and SDO downloads are refused.

        facts: returns the values that the next state frame of this PE reports.
        pending: returns every EMCY that the manager has not acknowledged yet.
        saw_epoch: called with the number of an epoch if a command with a right tag shows that a manager has activated
            this epoch, now or earlier.
        """
        self._turn, self._index, self._followed_manager, self._facts, self._key = (
            turn,
            index,
            followed_manager,
            facts,
            secret.key,
        )
        self._period_ns = index.table.ports[index.uplink].heartbeat_ns
        self._verifier = CommandVerifier(secret.key, index.lease_ns)
        self._handlers: dict[tuple[int, Command], Handler] = {}
        self._states = StateSeal(index.node, secret.key, followed_manager, pending)
        self.challenge = drawn_challenge(secret.salt)
        self._nonces = Nonces(secret.key, index.node, secret.salt, serves_ns=index.lease_ns, now_ns=turn.now_ns)
        self._saw_epoch = saw_epoch
        self._passing = PassingWelcomes(turn, gateway, index.lease_ns)
        self._requested_ns: int | None = None
        self._believed_ns = turn.now_ns  # when a command was last accepted
        self._beats = 0
        self._open_until_ns = turn.now_ns

    @property
    def refused(self) -> Counter[Refusal]:
        """Number of refused commands so far, by reason."""
        return self._verifier.refused

    @property
    def is_open(self) -> bool:
        """Tell whether the lock is open for NMT commands and SDO downloads."""
        return self._turn.now_ns < self._open_until_ns

    # Commands

    def guarded(self, handlers: Iterable[tuple[int, Handler]]) -> Iterator[tuple[int, Handler]]:
        """Yield each identifier of a command with a handler that holds the command until its TAG comes.

        Once the command is verified, it goes to the handler that was given for its identifier. Also yields the
        identifiers of the TAGs, each with the handler that verifies the held commands.
        """
        for identifier, handler in handlers:
            _, manager, command = classify(identifier)
            assert manager is not None
            assert command is not None
            self._handlers[manager, command] = handler
            yield identifier, partial(self.hold, manager, command)
        for manager in MANAGER_NODES:
            yield management_id(manager, Command.TAG), partial(self._tagged, manager)

    def hold(self, manager: int, command: Command, event: Received) -> None:
        """Keep a command until its TAG comes.

        A WELCOME for another node is forwarded instead. A command that came from another bus than the uplink is only
        counted.
        """
        data = event.frame.data
        if event.port != self._index.uplink:
            self._turn.count("command from beyond", event.frame.can_id)
        elif command is Command.CONTROL and is_welcome(data) and control_node(data) != self._index.node:
            self._passing.hand_on(control_node(data), event.frame)
        else:
            self._verifier.hold(manager, command, event, self._turn.arrived_ns)

    def opened(self, sealed: bytes) -> bytes | None:
        """Return a sealed table without the seal; None if it was not sealed with this PE's key, for this start."""
        return self._key.opened(sealed, self.challenge)

    def accept(self, order: Control) -> None:
        """Execute a verified RENEW or UNLOCK.

        RENEW ends the session. UNLOCK opens the lock for the number of seconds in it, at most LONGEST_UNLOCK_S;
        0 closes the lock.
        """
        if order.operation is Operation.RENEW:
            self._states.end_session()
        else:
            seconds = min(order.a, LONGEST_UNLOCK_S)
            self._open_until_ns = self._turn.now_ns + seconds * _NS_PER_S
            self._turn.note("unlock", f"NMT and SDO writes are allowed for {seconds} s")

    def _tagged(self, manager: int, event: Received) -> None:
        turn, tag = self._turn, event.frame
        if event.port != self._index.uplink:
            turn.count("command from beyond", tag.can_id)
            return
        succeeds = manager not in self._verifier.places and self._succeeds(manager, tag.data)
        may_pass = self._passing.wait() and tag_kind(tag.data) == WELCOME_KIND
        nonce = self._nonces.good(turn.now_ns)
        found = self._verifier.tagged(manager, tag.data, turn.arrived_ns, nonce, is_counted=not may_pass)
        if isinstance(found, Held):
            self._believe(manager, found, tag)
        elif may_pass:
            self._passing.tagged(tag)
        else:
            turn.count(found.value, tag.can_id)
            if found in (Refusal.UNPROVEN, Refusal.UNKNOWN) and (succeeds or not self._is_led()):
                self._request_welcome()

    def _is_led(self) -> bool:
        """Tell whether the active manager has a session with this PE, and sent a valid command in the last T_lease."""
        is_recent = self._turn.now_ns - self._believed_ns <= self._index.lease_ns
        return is_recent and self._states.session is not None

    def _succeeds(self, manager: int, tag: bytes) -> bool:
        """Tell whether the command that `tag` proves gives `manager` a higher term than that of the active manager.

        Only a LEASE or ACTIVATE can do so. If this command says that an epoch was activated, `saw_epoch` is called with
        the epoch.
        """
        seen = self._verifier.recognized(manager, tag)
        order = None if seen is None else decode_command(seen.command, seen.event.frame.data)
        if not isinstance(order, Lease | Activate):
            return False
        if order.step is not Step.PREPARED and order.epoch != NO_EPOCH:
            self._saw_epoch(order.epoch)
        return order.term > self._followed_manager.term

    def _believe(self, manager: int, found: Held, tag: Frame) -> None:
        """Execute a verified command; if its handler forwards the command, forward its TAG too."""
        turn, event = self._turn, found.event
        self._believed_ns = turn.now_ns
        if found.command is Command.CONTROL and is_welcome(event.frame.data):
            self._states.welcomed(manager, *self._verifier.places[manager])
            self._tell()
        turn.arrived_ns = found.arrived_ns
        before = len(turn.actions)
        self._handlers[manager, found.command](event)
        for action in turn.actions[before:]:
            if isinstance(action, Send) and action.frame is event.frame:
                turn.do(Send(action.port, tag))
        if self._followed_manager.manager == manager and self._states.session is None:
            self._request_welcome()

    # State pages

    def _request_welcome(self) -> None:
        """Send a nonce, unless one was sent within the last heartbeat period."""
        turn = self._turn
        if self._requested_ns is not None and turn.now_ns - self._requested_ns < self._period_ns:
            return
        self._requested_ns = turn.now_ns
        facts = self._facts()
        turn.do(self._say(StatePage2(facts.state, facts.flags, self._nonces.to_say(turn.now_ns))))

    def seal(self, beat: int | None, said: bytes, digest: int) -> int:
        """Return the tag of a page 0 or page 1 for the uplink; 0 without a session.

        beat: number of the page 0; None for a page 1. said: those bytes of the page that come before the digest.
        """
        return self._states.tag(beat, said, digest)

    def beat(self) -> None:
        """Send the first nonce after the start, and page 3 in every tenth period; call this once in a period."""
        self._beats += 1
        if self._requested_ns is None:
            self._request_welcome()
        if self._beats % STATE_PAGE_1_EVERY == 0:
            self._tell()

    def _tell(self) -> None:
        """Send page 3: the digest of the running configuration, and how many commands were refused."""
        facts, refused = self._facts(), self._verifier.refused
        unproven = refused[Refusal.UNPROVEN]
        other = refused.total() - unproven - refused[Refusal.UNKNOWN]  # UNKNOWN: every start causes some
        page = StatePage3(facts.state, facts.flags, facts.digest, unproven % 0x10000, other % 0x10000)
        self._turn.do(self._say(page))

    def _say(self, page: StatePage2 | StatePage3) -> Send:
        return Send(self._index.uplink, Frame(state_id(self._index.node), page.encode()))
