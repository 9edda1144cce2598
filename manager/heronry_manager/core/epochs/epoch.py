"""One epoch, from PREPARE to the last ACTIVE: the manager's half of the two phases (protocol rule 4).

    PREPARING   PREPARE and the slices are out; every awaited PE must report that it has staged this epoch's digest
    BREAKING    ACTIVATE(BREAK) is out; PEs that give up something exclusive must report BROKEN. If an unavailable
                PE may still run a module that this epoch places elsewhere, this PE must have stopped sending under
                the identifiers of the module
    HOLDING     ACTIVATE(GO) is out: new DEMUX branches wait until a silent PE has certainly stopped
    GOING       ACTIVATE(GO_ALL) is out; every awaited PE must report ACTIVE
    DONE        every awaited PE is ACTIVE (a PE that is admitted to the epoch later still gets its slice)
    ABANDONED   given up before ACTIVATE: the number is never used again

BREAKING and HOLDING are left out when there is nothing to wait for. After the first ACTIVATE the epoch cannot be
given up: only a newer epoch can follow.

*Awaited* are the available PEs that are reached by wire alone. A PE beyond a radio gets its slice, too, and takes
its steps when LEASE repeats them. The epoch waits for such a PE in one case: if the PE must give up something
exclusive. So the aircraft depends on the ground as little as possible.

*On board.* If a PE holds the configuration (protocol rule 5), it needs no slice: PREPARE gives the number of the
configuration in the table. A PE that reports NOT_ON_BOARD, or is known not to hold the configuration, gets its
slice as usual.

*Repetition.* Every message is repeated until it is acknowledged. The waits before the repetitions are 1, 2, 4, and
then always 8 heartbeat periods. So a lost frame delays little, and a slow PE is not flooded. The first wait is
long enough: without losses no answer takes so long (`reconfiguration_bound` checks that). If the manager has waited
for one answer of a PE for PATIENCE_PERIODS, the PE is overdue; the core fails it and plans without it. After a
pause of the manager, the driver hands over all waiting frames before any PE counts as overdue (`driver`).

*Load on the bus.* PREPARE and ACTIVATE are for all PEs, and all PEs answer them. So these commands are repeated
once in half a heartbeat period at most, however many PEs are late. Slices are paced to half the bus, because their
identifier outranks all data; the head of a slice goes just before its body.

*Faults.* An answer names its epoch and how far the PE is, so a late or doubled answer counts once. A doubled command
has no effect. A manager that restarts does not know an epoch that was under way. A PE that has taken a step of that
epoch reports the epoch. The next mastership then adopts the epoch if all PEs run it, and opens another epoch if not.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum, auto

from heronry_dg.configuration import Configuration
from heronry_dg.plan import Plan
from heronry_manager.core.tables import CompiledConfiguration
from heronry_manager.core.transitions import TransitionTable
from heronry_wire.management import SLICE_BYTES_PER_FRAME, Activate, Prepare, SliceBody, SliceHead, Step
from heronry_wire.protocol_times import PATIENCE_PERIODS
from heronry_wire.state_frames import PeState

_SLOWEST_RETRY = 8  # longest wait before a repetition, as a multiple of the first wait
_FRAME_BITS = 135
_LONGEST_BURST = 8  # frames of slices sent together by a driver whose timer was late


class Stage(Enum):
    """How far an epoch is on its way from PREPARE to the last ACTIVE."""

    PREPARING = "preparing"
    BREAKING = "breaking"
    GOING = "going"
    HOLDING = "holding"
    DONE = "done"
    ABANDONED = "abandoned"


class StageEvent(Enum):
    """Events that change the stage of an epoch."""

    BREAKS = auto()
    HOLDS = auto()
    GOES = auto()
    FINISHES = auto()
    IS_GIVEN_UP = auto()


STAGE_TRANSITIONS = TransitionTable(
    {Stage.PREPARING: "PREPARE", Stage.DONE: "adopted, since it runs already"},
    (
        (Stage.PREPARING, StageEvent.IS_GIVEN_UP, Stage.ABANDONED, "the situation has changed"),
        (Stage.PREPARING, StageEvent.BREAKS, Stage.BREAKING, "all have staged, and some must break or fall silent"),
        (Stage.PREPARING, StageEvent.HOLDS, Stage.HOLDING, "all have staged, a DEMUX must wait"),
        (Stage.PREPARING, StageEvent.GOES, Stage.GOING, "all have staged"),
        (Stage.BREAKING, StageEvent.HOLDS, Stage.HOLDING, "all that is exclusive is free except a DEMUX"),
        (Stage.BREAKING, StageEvent.GOES, Stage.GOING, "all that is exclusive is free"),
        (Stage.HOLDING, StageEvent.GOES, Stage.GOING, "T_lease is over"),
        (Stage.GOING, StageEvent.FINISHES, Stage.DONE, "all are ACTIVE"),
    ),
)
_STEP_OF = {
    Stage.PREPARING: Step.PREPARED,
    Stage.BREAKING: Step.BREAK,
    Stage.HOLDING: Step.GO,
    Stage.GOING: Step.GO_ALL,
    Stage.DONE: Step.GO_ALL,
    Stage.ABANDONED: Step.PREPARED,
}
_REACHED = {PeState.BROKEN: Step.BREAK, PeState.PARTIAL: Step.GO, PeState.ACTIVE: Step.GO_ALL}


@dataclass(frozen=True, slots=True)
class Participant:
    """A PE that takes part in an epoch: available when the epoch was opened, or admitted later."""

    pe: str
    node: int
    period_ns: int  # of its heartbeat
    awaited: bool
    runs_digest: int | None  # of the slice that it is known to run: if that differs, the body is sent unrequested
    on_board: bool = False  # its table holds this configuration under its number


@dataclass(frozen=True, slots=True)
class Cause:
    """Why the system is being reconfigured.

    what: the cause, in words.
    known_ns: when the manager knew of it, on its clock.
    """

    what: str
    known_ns: int
    since_ns: int  # the last sign of the old state: detect = known - since


@dataclass(slots=True)
class _Progress:
    participant: Participant
    staged: bool = False
    step: Step = Step.PREPARED  # the last one that its state frames have shown
    wants_body: bool = False
    needs_slice: bool = True  # PREPARE alone is not enough
    since_ns: int = 0  # when the manager first asked for the answer that it now waits for
    asked_ns: int = 0
    asked_times: int = 0

    def again_ns(self) -> int:
        """Return the time (ns) at which to repeat the command.

        The waits between the repetitions are 1, 2, 4, and then always 8 heartbeat periods.
        """
        return self.asked_ns + self.participant.period_ns * min(1 << max(0, self.asked_times - 1), _SLOWEST_RETRY)

    def owes(self, now_ns: int) -> None:
        """Note that the manager waits for an answer of this PE from now on.

        The times until the command is repeated, and until the PE is overdue, begin anew.
        """
        self.since_ns, self.asked_ns, self.asked_times = now_ns, now_ns, 0

    def is_overdue(self, now_ns: int) -> bool:
        """Tell whether the manager has waited for one answer of this PE for PATIENCE_PERIODS."""
        return now_ns >= self.since_ns + PATIENCE_PERIODS * self.participant.period_ns


@dataclass(slots=True)
class Times:
    """When PREPARE went out, and when all awaited PEs had staged, in nanoseconds on the manager's clock."""

    prepared_ns: int
    staged_ns: int | None = None


@dataclass
class Epoch:
    """One epoch on its way to running; `outbox` collects the messages that the manager must send."""

    term: int
    epoch: int
    plan: Plan
    compiled: CompiledConfiguration
    placed: dict[str, set[str]]  # exclusive tokens by PE
    participants: list[Participant]
    bitrate: int
    started_ns: int
    causes: tuple[Cause, ...] = ()
    stage: Stage = Stage.PREPARING
    contingency: int = 0  # its number, if it has one
    outbox: list[Prepare | SliceHead | SliceBody | Activate] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Put PREPARE into the outbox, and the slices that PEs need; an adopted epoch (DONE) needs neither."""
        self.step = _STEP_OF[self.stage]  # the step that LEASE repeats
        self.times = Times(self.started_ns)
        self.must_break: set[str] = set()
        self.identifiers_free_ns: int | None = None  # BREAKING waits until then
        self.demux_free_ns: int | None = None  # HOLDING waits until then
        self._progress = {
            p.pe: _Progress(p, wants_body=self._differs(p), needs_slice=not p.on_board) for p in self.participants
        }
        self._by_node = {progress.participant.node: progress for progress in self._progress.values()}
        self._paced: deque[SliceHead | SliceBody] = deque()
        self._next_paced_ns = self.started_ns
        self._gap_ns = 2 * _FRAME_BITS * 1_000_000_000 // self.bitrate
        self._repeat_ns = min((p.period_ns for p in self.participants), default=0) // 2
        self._broadcast_ns = self.started_ns
        for progress in self._progress.values():
            progress.owes(self.started_ns)
        if self.stage is Stage.PREPARING:
            self._send_prepare()
            for progress in self._progress.values():
                self._send_slice(progress, self.started_ns)

    @property
    def configuration(self) -> Configuration:
        """The configuration of this epoch; it never changes, even if a plan with a better proof replaces `plan`."""
        return self.plan.configuration

    def staged(self, pe: str, *, has_staged: bool, wants_body: bool, now_ns: int) -> None:
        """Note from page 1 that a PE has staged this epoch, or that it needs the body of its slice."""
        progress = self._progress.get(pe)
        if progress is None:
            return
        if has_staged and not progress.staged:
            progress.staged = True
            progress.owes(now_ns)
        elif wants_body and not progress.staged:
            progress.wants_body = progress.needs_slice = True
            self._send_slice(progress, now_ns)

    def not_on_board(self, pe: str, now_ns: int) -> None:
        """Note that by its page 1 a PE does not hold the contingency that PREPARE names; send this PE its slice.

        This has no effect if the PE has staged the slice, or if the slice is being sent to the PE already.
        """
        progress = self._progress.get(pe)
        if progress is not None and not progress.staged and not progress.needs_slice:
            progress.needs_slice = True
            self._send_slice(progress, now_ns)

    def reported(self, pe: str, state: PeState, now_ns: int) -> None:
        """Note which activation step a PE has taken: its page 0 has reported `state` for this epoch."""
        progress = self._progress.get(pe)
        if progress is None or state is PeState.UNCONFIGURED:
            return
        progress.staged = True
        reached = _REACHED[state]
        if reached > progress.step:
            progress.step = reached
            progress.owes(now_ns)

    def admit(self, participant: Participant, now_ns: int) -> None:
        """Let a PE that has become available late take part in this epoch.

        The PE gets PREPARE and its slice, and then takes the activation step that every LEASE names. No effect
        if the PE takes part already and has not taken the last step.
        """
        before = self._progress.get(participant.pe)
        if before is not None and before.step is not Step.GO_ALL:
            return  # it is a participant already
        progress = _Progress(participant, wants_body=self._differs(participant), needs_slice=not participant.on_board)
        self._progress[participant.pe] = self._by_node[participant.node] = progress
        self._send_prepare()
        progress.owes(now_ns)
        self._send_slice(progress, now_ns)

    def drop(self, pe: str) -> None:
        """Stop waiting for a PE that is no longer available."""
        self._progress.pop(pe, None)
        self.must_break.discard(pe)

    def has_staged(self, pe: str) -> bool:
        """Tell whether a PE has staged its slice, or is no longer waited for."""
        progress = self._progress.get(pe)
        return progress is None or progress.staged

    def all_staged(self) -> bool:
        """Tell whether every awaited PE has staged its slice."""
        return all(p.staged for p in self._progress.values() if p.participant.awaited)

    def all_broken(self) -> bool:
        """Tell whether every PE that must take the step BREAK has reported BROKEN, PARTIAL or ACTIVE."""
        return all(self._progress[pe].step >= Step.BREAK for pe in self.must_break)

    def all_active(self) -> bool:
        """Tell whether every awaited PE has reported ACTIVE."""
        return all(p.step is Step.GO_ALL for p in self._progress.values() if p.participant.awaited)

    def activate(self, must_break: set[str], now_ns: int) -> None:
        """Command the first step, since every awaited PE has staged; from now on the epoch cannot be abandoned.

        must_break: the PEs that must report BROKEN before GO.
        """
        self.times.staged_ns = now_ns
        self.must_break = must_break & self._progress.keys()
        if self.must_break or self.identifiers_free_ns is not None:
            self._enter(StageEvent.BREAKS, now_ns)
        else:
            self.go(now_ns)

    def go(self, now_ns: int) -> None:
        """Command GO_ALL, or GO while a silent PE may still drive a DEMUX that this epoch gives to another PE.

        The caller has made sure that everything else that is exclusive is free.
        """
        self._enter(StageEvent.GOES if self.demux_free_ns is None else StageEvent.HOLDS, now_ns)

    def finish(self) -> None:
        """End the epoch, since every awaited PE is ACTIVE."""
        self._move(StageEvent.FINISHES)

    def abandon(self) -> None:
        """Give up the epoch before its first ACTIVATE; the manager sends no more messages of it."""
        self._move(StageEvent.IS_GIVEN_UP)
        self._paced.clear()
        self._progress.clear()

    def tick(self, now_ns: int) -> list[str]:
        """Repeat the commands that PEs have not answered in time; the caller calls this at `next_deadline_ns`.

        Returns the PEs that have not answered within the patience. For these PEs no command is repeated any more.
        """
        self._pace(now_ns)
        waiting = self._waiting_for()
        overdue = [pe for pe, progress in waiting.items() if progress.is_overdue(now_ns)]
        again = [p for pe, p in waiting.items() if pe not in overdue and now_ns >= p.again_ns()]
        if again and self._may_repeat(now_ns):
            if any(not progress.staged for progress in again):
                self._send_prepare()
            if any(progress.staged for progress in again):
                self._send_step()
        for progress in again:
            if progress.staged:
                progress.asked_ns, progress.asked_times = now_ns, progress.asked_times + 1
            else:
                self._send_slice(progress, now_ns)
        return overdue

    def next_deadline_ns(self) -> int | None:
        """Return the time (ns) at which to call `tick`.

        None: nothing is to be sent or repeated, and no time is awaited at which unavailable PEs have stopped.
        """
        wanted = self.step
        deadlines = [p.again_ns() for p in self._progress.values() if not p.staged or p.step < wanted]
        if self._paced:
            deadlines.append(self._next_paced_ns)
        if self.stage is Stage.BREAKING and self.identifiers_free_ns is not None:
            deadlines.append(self.identifiers_free_ns)
        if self.stage is Stage.HOLDING and self.demux_free_ns is not None:
            deadlines.append(self.demux_free_ns)
        return min(deadlines, default=None)

    def _enter(self, event: StageEvent, now_ns: int) -> None:
        """Enter the stage to which `event` leads, and command the step of this stage.

        Each PE owes a report of this step from now on.
        """
        self._move(event)
        self._broadcast_ns = now_ns
        for progress in self._progress.values():
            progress.owes(now_ns)
            progress.asked_times = 1
        self._send_step()

    def _move(self, event: StageEvent) -> None:
        self.stage = STAGE_TRANSITIONS.after(self.stage, event)
        self.step = _STEP_OF[self.stage]

    def _waiting_for(self) -> dict[str, _Progress]:
        wanted = self.step
        return {pe: p for pe, p in self._progress.items() if not p.staged or p.step < wanted}

    def _differs(self, participant: Participant) -> bool:
        return (
            bool(self.compiled.slices[participant.node])
            and participant.runs_digest != self.compiled.slice_digests[participant.node]
        )

    def _send_slice(self, progress: _Progress, now_ns: int) -> None:
        """Send a PE the head of its slice, and also the body if the PE wants the body.

        If the PE needs no slice, since PREPARE names a contingency on board, nothing is sent here.
        """
        participant = progress.participant
        if not progress.needs_slice:
            progress.asked_ns = now_ns
        elif progress.wants_body:
            if all(frame.node != participant.node for frame in self._paced):
                self._paced += [self._head(participant), *self._body(participant)]
            progress.asked_ns = now_ns + len(self._paced) * self._gap_ns
        else:
            self.outbox.append(self._head(participant))
            progress.asked_ns = now_ns
        progress.asked_times += 1

    def _head(self, participant: Participant) -> SliceHead:
        length, digest = len(self.compiled.slices[participant.node]), self.compiled.slice_digests[participant.node]
        return SliceHead(participant.node, self.epoch & 0xFF, length, digest)

    def _body(self, participant: Participant) -> Iterator[SliceBody]:
        body = self.compiled.slices[participant.node]
        for index, start in enumerate(range(0, len(body), SLICE_BYTES_PER_FRAME), start=1):
            yield SliceBody(participant.node, self.epoch & 0xFF, index, body[start : start + SLICE_BYTES_PER_FRAME])

    def _pace(self, now_ns: int) -> None:
        self._next_paced_ns = max(self._next_paced_ns, now_ns - _LONGEST_BURST * self._gap_ns)
        while self._paced and now_ns >= self._next_paced_ns:
            frame = self._paced.popleft()
            self.outbox.append(frame)
            self._next_paced_ns += self._gap_ns
            self._by_node[frame.node].asked_ns = now_ns  # its answer is due from its last frame on

    def _may_repeat(self, now_ns: int) -> bool:
        """Tell whether PREPARE or ACTIVATE may be sent to all PEs again now; if so, count it as sent now."""
        may = now_ns >= self._broadcast_ns + self._repeat_ns
        if may:
            self._broadcast_ns = now_ns
        return may

    def _send_prepare(self) -> None:
        self.outbox.append(Prepare(self.term, self.epoch, self.compiled.digest, self.contingency))

    def _send_step(self) -> None:
        self.outbox.append(Activate(self.term, self.epoch, self.step, self.compiled.digest))
