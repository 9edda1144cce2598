"""What a PE with a key believes: commands that were tagged by who holds it, and fresh (rule 11).

It stands before everything that obeys. A command is held until its TAG comes, for T_lease at most (on a busy computer
a manager's frames come far apart); then it is handed on, with the time at
which the command itself arrived, and where it is forwarded its TAG follows it. What was not proven is counted
(`command_tags.Refusal`), told in page 3 of the state, and changes nothing.

A *fresh start*. After its own start a PE believes nothing, since all that it hears may be old. It says a nonce (page
2), and a WELCOME whose tag covers that nonce gives it its place in the counting of that manager. It asks when a
manager speaks that has not welcomed it, once in a heartbeat period; so after a restart of either side, when a standby
takes over, and when it was left so far behind that nothing fits any more and T_lease has passed without a command. The
answer names a term like any command, and only who reigns gives one: who reigned before is not obeyed any more.

A *session*. The same WELCOME says under which number the states of this PE are tagged from now on: the manager chose
it, in this term, and chooses no number twice. A manager of a new term has no session here until it has welcomed this
PE. Pages 0 and 1 on the uplink carry the tag; other ports, and a PE without a session, say 0.

An *EMCY* is proven by the next page 0: its tag covers one that is pending, in turn where there are several. Page 0
goes out at once when that changes, so this costs no time.

A *lock*. NMT can do nothing here, and SDO write nothing, until UNLOCK names this PE, and not for longer than it says.
Who sends SDO requests cannot be told on the bus: the manager that reigns opens the lock and closes it, and a table has
to be sealed besides (`opened`).

Lost: a page 2, a WELCOME or its TAG is asked for again with the next command. Late: a nonce serves for T_lease, a
WELCOME that comes later answers nobody. Doubled: a WELCOME is not above its own number. Forged: counted. After a
restart all of this begins anew, with nonces that come from another salt.

A WELCOME of another node cannot be judged here. A gateway hands it on to where that node is, with the TAG that follows.
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
    """What the driver gives a keyed PE: `salt` is another one at every start, for nonces that nobody can tell."""

    key: Key
    salt: bytes


class Authenticity:
    """The key of one PE, and what has been proven with it."""

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
        self._asked_ns: int | None = None
        self._believed_ns = turn.now_ns  # when a command was last believed
        self._beats = 0
        self._open_until_ns = turn.now_ns

    @property
    def refused(self) -> Counter[Refusal]:
        """What has been refused so far."""
        return self._verifier.refused

    @property
    def is_open(self) -> bool:
        """Tell whether NMT and SDO may do something."""
        return self._turn.now_ns < self._open_until_ns

    # Commands

    def guarded(self, handlers: Iterable[tuple[int, Handler]]) -> Iterator[tuple[int, Handler]]:
        """Stand before the handlers of all commands."""
        for identifier, handler in handlers:
            _, manager, command = classify(identifier)
            assert manager is not None
            assert command is not None
            self._handlers[manager, command] = handler
            yield identifier, partial(self.hold, manager, command)
        for manager in MANAGER_NODES:
            yield management_id(manager, Command.TAG), partial(self._tagged, manager)

    def hold(self, manager: int, command: Command, event: Received) -> None:
        """A command has come: without its TAG it is nothing yet."""
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
        """The reigning manager has said something about this PE's session or lock."""
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
                self._ask()

    def _believe(self, manager: int, found: Held, tag: Frame) -> None:
        """Let a command be obeyed; where it is forwarded, its TAG is too."""
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
            self._ask()

    # What is said of it

    def _ask(self) -> None:
        """Say a nonce, unless one was said within this period."""
        turn = self._turn
        if self._asked_ns is not None and turn.now_ns - self._asked_ns < self._period_ns:
            return
        self._asked_ns = turn.now_ns
        facts = self._facts()
        turn.out.append(self._say(StatePage2(facts.state, facts.flags, self._nonces.to_say(turn.now_ns))))

    def seal(self, beat: int | None, said: bytes, digest: int) -> int:
        """Tag of a page on the uplink: `beat` counts pages 0, of a page 1 it is None."""
        return self._states.tag(beat, said, digest)

    def beat(self) -> None:
        """A period is over: say the first nonce, and now and then what runs and what was refused."""
        self._beats += 1
        if self._asked_ns is None:
            self._ask()
        if self._beats % STATE_PAGE_1_EVERY == 0:
            self._tell()

    def _tell(self) -> None:
        """Say what runs, for the tag leaves no room to, and what has been refused."""
        facts, refused = self._facts(), self._verifier.refused
        unproven = refused[Refusal.UNPROVEN]
        other = refused.total() - unproven - refused[Refusal.UNKNOWN]  # every start has some of these
        page = StatePage3(facts.state, facts.flags, facts.digest, unproven % 0x10000, other % 0x10000)
        self._turn.out.append(self._say(page))

    def _say(self, page: StatePage2 | StatePage3) -> Send:
        return Send(self._index.uplink, Frame(state_id(self._index.node), page.encode()))
