"""Saves, sends and keeps the states of modules, and gives a state to a module that starts (head of this room)."""

from collections.abc import Iterable

from heronry_agent.core.authority import OutputAuthorization
from heronry_agent.core.carried_over import CarriedOver
from heronry_agent.core.checkpoints.keeping import Keeping
from heronry_agent.core.checkpoints.reports import StateReports
from heronry_agent.core.checkpoints.sending import Sender
from heronry_agent.core.reports import Faults
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import (
    KeptState,
    SaveState,
    StateEvent,
    StateLacking,
    StateRestored,
    StateSaved,
    StateUnused,
)
from heronry_wire.checkpoint_frames import Lack, SentState
from heronry_wire.failure_text import plain_reason
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_PE, Command, checkpoint_id
from heronry_wire.management import Alive, FaultCode, decode_command, without_sequence
from heronry_wire.sansio import NEVER_NS, Received, Send

TRIAL_NS = 1_000_000_000
"""Time in ns after a start from a state in which a failure of the module is blamed on the state."""

_MOST_DETAIL = 0xFFFF
_NS_PER_MS = 1_000_000


class Checkpoints:
    """The checkpoints of one PE; without modules that have any, nothing is ever due."""

    def __init__(self, turn: Turn, index: TableIndex, authorization: OutputAuthorization, faults: Faults) -> None:
        """Begin without states; `faults` sends the reports of this PE."""
        self._turn, self._index, self._authorization, self._faults = turn, index, authorization, faults
        self._reports = StateReports(faults, index.table.ports[index.uplink].heartbeat_ns)
        self._entries = {entry.module: entry for entry in index.table.checkpoints}
        self._keeping = Keeping(index.table.checkpoints, index.modules)
        self._senders: dict[int, Sender] = {}
        self._rounds: dict[int, int] = {}  # last round of each module that was stopped
        self._trials: dict[int, int] = {}  # by module that started from a state: end of its trial
        self._alive: frozenset[int] = frozenset()
        self._named = b""  # the last ALIVE, without its sequence
        self.next_ns = NEVER_NS

    def carry_over(self, carried: CarriedOver) -> None:
        """Begin anew with another table: the states of its modules are saved, kept and sent from now on."""
        table = self._index.table
        running = carried.by_module(self._senders)
        self._reports = StateReports(self._faults, table.ports[self._index.uplink].heartbeat_ns)
        self._entries = {entry.module: entry for entry in table.checkpoints}
        self._keeping = Keeping(table.checkpoints, self._index.modules)
        self._rounds, self._trials, self._named = {}, {}, b""
        self._senders = {
            module: Sender(self._entries[module], self._turn.now_ns, sender.round)
            for module, sender in running.items()
            if module in self._entries
        }
        self._plan()

    @property
    def identifiers(self) -> Iterable[int]:
        """CAN identifiers of the states that this PE keeps or forwards."""
        nodes = {node for entry in self._entries.values() for way in entry.towards for node in way}
        return map(checkpoint_id, sorted(nodes))

    def named(self, alive: bytes) -> None:
        """Take the payload of an accepted ALIVE: the PEs on which the manager counts."""
        if self._entries and (meaning := without_sequence(alive)) != self._named:
            message = decode_command(Command.ALIVE, alive)
            if isinstance(message, Alive):  # pragma: no branch - it was accepted
                self._named, self._alive = meaning, message.nodes

    # A module

    def start(self, module: int) -> KeptState | Lack | None:
        """Begin to save the state of a module that starts; returns its state, or why it has none.

        None: the module has no checkpoint.
        """
        entry = self._entries.get(module)
        if entry is None:
            return None
        self._senders[module] = Sender(entry, self._turn.now_ns, self._rounds.get(module, -1))
        self._trials.pop(module, None)
        kept = self._keeping.of(module)
        if kept is None:
            return Lack.NO_STATE
        if self._turn.now_ns > kept.until_ns:
            return Lack.TOO_OLD
        self._trials[module] = self._turn.now_ns + TRIAL_NS
        return kept

    def failed(self, module: int, *, again: bool) -> None:
        """Discard all states of a module that has failed, unless its state cannot be the cause.

        It may be if the module has started from it shortly before, or (again) fails repeatedly, or is given up.
        """
        on_trial = self._turn.now_ns <= self._trials.pop(module, -1)
        sender = self._senders.get(module)
        if sender is None or not (on_trial or again):
            return
        self._keeping.discard(module)
        sender.cut_off()
        (empty,) = SentState.of(sender.entry.number, sender.next_round(), b"", b"").frames(self._index.node)
        self._send(sender, empty, self._turn.now_ns)
        name = self._index.modules[module].name
        words = f"the states of module {name} are discarded: one of them may make it fail"
        self._turn.note("checkpoint", words)

    def stopped(self, module: int) -> None:
        """Save and send no more states of a module."""
        sender = self._senders.pop(module, None)
        if sender is not None:
            self._rounds[module] = sender.round
            self._reports.over(module)
            self._plan()

    def ask(self, module: int) -> None:
        """Have the state of a module saved after the step that begins now, if it is due."""
        sender = self._senders.get(module)
        if sender is not None and self._turn.now_ns >= sender.due_ns:
            self._turn.do(SaveState(module, sender.ask(self._turn.now_ns), sender.entry.data_bytes))

    def take(self, event: StateEvent) -> None:
        """Take an answer of the driver about the state of a module."""
        match event:
            case StateSaved():
                self._saved(event)
            case StateRestored():
                self._restored(event)
            case StateLacking():
                self._lacking(event)
            case StateUnused(module):  # pragma: no branch - nothing else is left
                self._trials.pop(module, None)

    def _saved(self, event: StateSaved) -> None:
        """Keep and send a state that was saved; one that does not answer the last order is only counted."""
        sender = self._senders.get(event.module)
        if sender is None or sender.asked_ns is None or event.round != sender.round:
            self._turn.count("stale answer", event.module)
            return
        if len(event.data) > sender.entry.data_bytes:
            self._lacking(StateLacking(event.module, Lack.TOO_LONG))
            return
        asked_ns, sender.asked_ns, sender.is_failing = sender.asked_ns, None, False
        self._reports.over(event.module)
        if not event.data:
            self._plan()
            return
        state = SentState.of(sender.entry.number, event.round, event.data, event.code)
        self._keeping.keep(sender.entry, state, asked_ns)
        frames = [*state.frames(self._index.node)] if sender.ports(self._alive) else ()
        now_ns = self._turn.now_ns
        sender.send(frames, now_ns, min(max(event.saved_ns, asked_ns), now_ns))
        self._plan()

    def _restored(self, event: StateRestored) -> None:
        """Report that a module has started from its state, which it does not use again."""
        self._keeping.discard(event.module)
        age_ms = max(0, -(-event.age_ns // _NS_PER_MS))
        self._tell(event.module, FaultCode.STATE_RESTORED, min(age_ms, _MOST_DETAIL))
        name = self._index.modules[event.module].name
        self._turn.note("checkpoint", f"module {name} starts from its state, which is at most {age_ms} ms old")

    def _lacking(self, event: StateLacking) -> None:
        """Report that a module has started without its state, or that its state cannot be saved."""
        name = self._index.modules[event.module].name
        reason = f": {plain_reason(event.reason)}" if event.reason else ""
        if not event.lack.is_of_save:
            self._keeping.discard(event.module)
            self._trials.pop(event.module, None)
            self._tell(event.module, FaultCode.STATE_LACKING, event.lack)
            self._turn.note("checkpoint", f"module {name} starts without its state ({event.lack.name}){reason}")
            return
        sender = self._senders.get(event.module)
        if sender is None:
            return
        if not sender.is_failing:
            self._turn.note("checkpoint", f"the state of module {name} cannot be saved ({event.lack.name}){reason}")
        sender.failed(self._turn.now_ns)
        self._tell(event.module, FaultCode.STATE_LACKING, event.lack, lasts=True)

    # The bus

    def heard(self, event: Received) -> None:
        """Take a frame of another PE: keep the state that it completes, and forward the frame."""
        frame, turn = event.frame, self._turn
        node = frame.can_id - checkpoint_id(FIRST_PE) + FIRST_PE
        if not self._keeping.heard(node, event.port, frame.data, turn.arrived_ns, runs=self._senders.keys()):
            turn.count("foreign or malformed checkpoint", frame.can_id)
            return
        ways = self._keeping.ways_on(frame.data, event.port, self._alive)
        turn.do(*(Send(port, frame, turn.arrived_ns + wait_ns) for port, wait_ns in ways))

    def tick(self) -> None:
        """Hand over the frames that are due, and repeat the reports that are due."""
        now_ns = self._turn.now_ns
        for sender in self._senders.values():
            while sender.next_ns <= now_ns:
                self._send(sender, *sender.next_frame())
        while self._reports.next_ns <= now_ns:
            if report := self._reports.tick(now_ns):
                self._turn.do(Send(self._index.uplink, report))
        self._plan()

    def _send(self, sender: Sender, frame: Frame, ideal_ns: int) -> None:
        """Send a frame that may wait for its bus from `ideal_ns` on; if that cannot be, cut off the round."""
        now_ns, waits_ns = self._turn.now_ns, sender.entry.waits_ns
        authorized_ns = self._authorization.identifiers_until_ns(now_ns)
        if authorized_ns is None:
            sender.cut_off()
            self._turn.count("checkpoint held", sender.entry.module)
            return
        until_ns = {port: min(authorized_ns, ideal_ns + waits_ns[port]) for port in sender.ports(self._alive)}
        in_time = [Send(port, frame, limit_ns) for port, limit_ns in until_ns.items() if limit_ns >= now_ns]
        self._turn.do(*in_time)
        if not in_time:
            sender.cut_off()

    def _tell(self, module: int, code: FaultCode, detail: int, *, lasts: bool = False) -> None:
        self._reports.add(module, code, detail, self._turn.now_ns, lasts=lasts)
        self._plan()

    def _plan(self) -> None:
        """Find when `tick` is to be called next."""
        self.next_ns = min([sender.next_ns for sender in self._senders.values()], default=NEVER_NS)
        self.next_ns = min(self.next_ns, self._reports.next_ns)
