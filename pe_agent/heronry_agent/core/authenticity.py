"""Which commands a PE with a key accepts: fresh ones, tagged by a holder of the key (protocol rule 11).

This file stands before every handler of a command. A command is held until its TAG comes, for T_lease at most (on a
busy computer a manager's frames come far apart); then it is handed on, with the time at which the command itself
arrived, and where it is forwarded its TAG follows it. A command that was not proven is counted
(`command_tags.Refusal`), told in page 3 of the state, and changes nothing.

A *fresh start*. After its own start a PE accepts no command, since every command that it hears may be old. The PE sends
a nonce (page 2), and a WELCOME whose tag covers that nonce tells it which numbers of that manager's commands come next.
The PE asks when it hears a manager that has not welcomed it, once in a heartbeat period: after a restart of either
side, after a takeover by the standby manager, and when it has missed so many commands that no number fits any more and
T_lease has passed without an accepted command. The WELCOME names a term like any command, and only the active manager
sends one: from then on commands of the previous manager are refused.

A *session*. The same WELCOME gives the number under which the states of this PE are tagged from now on: the manager
chose the number, in this term, and chooses no number twice. A manager of a new term has no session here until it has
welcomed this PE. Pages 0 and 1 on the uplink carry the tag; on other ports, and without a session, the tag is 0.

An *EMCY* is proven by the next page 0: the tag of the page covers one pending EMCY, in turn where there are several.
Page 0 goes out immediately when that changes, so this costs no time.

A *lock*. NMT commands are refused, and SDO downloads as well, until UNLOCK names this PE, and for no longer than UNLOCK
says. The bus does not show which node sends an SDO request: the active manager opens the lock and closes it, and a
table has to be sealed besides (`opened`).

Lost: after a lost page 2, WELCOME or TAG the PE asks again with the next command. Late: a nonce serves for T_lease, a
WELCOME that comes later proves nothing. Doubled: a WELCOME is not above its own number. Forged: counted. After a
restart all of this begins anew, with nonces that come from another salt.

A WELCOME for another node cannot be verified here. A gateway passes it on toward that node, with the TAG that follows.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from heronry_agent.core.gateway import Gateway
from heronry_agent.core.mastership import Mastership
from heronry_agent.core.nonces import Nonces
from heronry_agent.core.passing_welcomes import PassingWelcomes
from heronry_agent.core.reporting import Facts
from heronry_agent.core.state_seal import StateSeal
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_wire.authentication import Key
from heronry_wire.command_tags import CommandVerifier, Held, Refusal
from heronry_wire.frame import Frame
from heronry_wire.identifiers import MANAGER_NODES, Command, classify, management_id, state_id
from heronry_wire.management import WELCOME_KIND, Control, Operation, control_node, is_welcome, tag_kind
from heronry_wire.protocol_times import STATE_PAGE_1_EVERY
from heronry_wire.sansio import Received, Send
from heronry_wire.state_frames import StatePage2, StatePage3

LONGEST_UNLOCK_S = 60
_NS_PER_S = 1_000_000_000

Handler = Callable[[Received], None]


@dataclass(frozen=True, slots=True)
class Secret:
    """What the driver gives a PE with a key: `salt` differs at every start, so that nonces cannot be predicted."""

    key: Key
    salt: bytes


class Authenticity:
    """Verifies the commands to one PE with its key, and tags the states of that PE."""

    def __init__(
        self,
        turn: Turn,
        index: TableIndex,
        mastership: Mastership,
        gateway: Gateway,
        *,
        facts: Callable[[], Facts],
        pending: Callable[[], Sequence[bytes]],
        secret: Secret,
    ) -> None:
        """`facts` gives what the state frames tell now, `pending` every EMCY that waits to be acknowledged."""
        self._turn, self._index, self._mastership, self._facts, self._key = turn, index, mastership, facts, secret.key
        self._period_ns = index.table.ports[index.uplink].heartbeat_ns
        self._verifier = CommandVerifier(secret.key, index.lease_ns)
        self._handlers: dict[tuple[int, Command], Handler] = {}
        self._states = StateSeal(index.node, secret.key, mastership, pending)
        self._nonces = Nonces(secret.salt, index.lease_ns, turn.now_ns)
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
        """Give handlers that verify each command before they call these."""
        for identifier, handler in handlers:
            _, manager, command = classify(identifier)
            assert manager is not None
            assert command is not None
            self._handlers[manager, command] = handler
            yield identifier, partial(self.hold, manager, command)
        for manager in MANAGER_NODES:
            yield management_id(manager, Command.TAG), partial(self._tagged, manager)

    def hold(self, manager: int, command: Command, event: Received) -> None:
        """Hold a command until its TAG comes; pass on a WELCOME for a node beyond."""
        data = event.frame.data
        if event.port != self._index.uplink:
            self._turn.count("command from beyond", event.frame.can_id)
        elif command is Command.CONTROL and is_welcome(data) and control_node(data) != self._index.node:
            self._passing.hand_on(control_node(data), event.frame)
        else:
            self._verifier.hold(manager, command, event, self._turn.arrived_ns)

    def opened(self, sealed: bytes) -> bytes | None:
        """Text of a table that was sealed with the key of the fleet; None where it was not."""
        return self._key.opened(sealed)

    def accept(self, order: Control) -> None:
        """Execute RENEW or UNLOCK of the active manager: end the session, or open or close the lock."""
        if order.operation is Operation.RENEW:
            self._states.end_session()
        else:
            seconds = min(order.a, LONGEST_UNLOCK_S)
            self._open_until_ns = self._turn.now_ns + seconds * _NS_PER_S
            self._turn.note("unlock", f"NMT and SDO may write for {seconds} s")

    def _tagged(self, manager: int, event: Received) -> None:
        turn, tag = self._turn, event.frame
        if event.port != self._index.uplink:
            turn.count("command from beyond", tag.can_id)
            return
        may_pass = self._passing.wait() and tag_kind(tag.data) == WELCOME_KIND
        nonce = self._nonces.good(turn.now_ns)
        found = self._verifier.tagged(manager, tag.data, turn.arrived_ns, nonce, is_counted=not may_pass)
        if isinstance(found, Held):
            self._believe(manager, found, tag)
        elif may_pass:
            self._passing.tagged(tag)
        else:
            turn.count(found.value, tag.can_id)
            is_lost = found is Refusal.UNPROVEN and turn.now_ns - self._believed_ns > self._index.lease_ns
            if is_lost or found is Refusal.UNKNOWN:
                self._request_welcome()

    def _believe(self, manager: int, found: Held, tag: Frame) -> None:
        """Hand a proven command to its handler; where it is forwarded, its TAG follows."""
        turn, event = self._turn, found.event
        self._believed_ns = turn.now_ns
        if found.command is Command.CONTROL and is_welcome(event.frame.data):
            self._states.welcomed(manager, *self._verifier.places[manager])
            self._tell()
        turn.arrived_ns = found.arrived_ns
        before = len(turn.out)
        self._handlers[manager, found.command](event)
        for action in turn.out[before:]:
            if isinstance(action, Send) and action.frame is event.frame:
                turn.out.append(Send(action.port, tag))
        if self._mastership.manager == manager and self._states.session is None:
            self._request_welcome()

    # State pages

    def _request_welcome(self) -> None:
        """Ask for a fresh start: send a nonce, unless one was sent within this period."""
        turn = self._turn
        if self._requested_ns is not None and turn.now_ns - self._requested_ns < self._period_ns:
            return
        self._requested_ns = turn.now_ns
        facts = self._facts()
        turn.out.append(self._say(StatePage2(facts.state, facts.flags, self._nonces.to_say(turn.now_ns))))

    def seal(self, beat: int | None, said: bytes, digest: int) -> int:
        """Tag of a page on the uplink; `beat` counts pages 0, and is None for a page 1."""
        return self._states.tag(beat, said, digest)

    def beat(self) -> None:
        """A heartbeat period is over: send the first nonce, and every STATE_PAGE_1_EVERY periods page 3."""
        self._beats += 1
        if self._requested_ns is None:
            self._request_welcome()
        if self._beats % STATE_PAGE_1_EVERY == 0:
            self._tell()

    def _tell(self) -> None:
        """Send page 3: the digest of what runs (a tagged page 0 has no room for it), and counts of refused commands."""
        facts, refused = self._facts(), self._verifier.refused
        unproven = refused[Refusal.UNPROVEN]
        other = refused.total() - unproven - refused[Refusal.UNKNOWN]  # every start has some of these
        page = StatePage3(facts.state, facts.flags, facts.digest, unproven % 0x10000, other % 0x10000)
        self._turn.out.append(self._say(page))

    def _say(self, page: StatePage2 | StatePage3) -> Send:
        return Send(self._index.uplink, Frame(state_id(self._index.node), page.encode()))
