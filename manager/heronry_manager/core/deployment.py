"""From a plan to what runs: epochs are opened, activated and finished here, and what each PE runs is followed.

Two epochs are at work at most: `next` is being prepared, `current` is the last one whose ACTIVATE went out (how each of
them goes is `reconfiguration`'s to say). The next one takes the current one's place when everybody has staged it; a
change of the situation before that abandons its number. The current one is repeated by LEASE until then, and whoever
comes late is still served.

Observed stays apart: a PE is known to run an epoch by its state frames alone (`Observed`). What they say that cannot be
is given back as a sentence, and the core fails that PE: it runs nothing although it was configured; it runs what nobody
commanded; it cannot stage its slice.

*Admitting*: who comes back, and has nothing to do in the plan that runs already, is given the current epoch; nobody
else is troubled. With something to do there it needs a new one, since what is exclusive must be asked about first; and
so it does where it may have staged a newer one that was given up since: nobody goes back to an older.

*Overtaken*: a PE that was cut off, and is not counted on yet, may run a newer epoch, of a manager that reigned on its
side of a broken bus. Whoever hears that drives nothing exclusive until it runs one that is newer still (rule 6), so
what runs is given a new number, without that PE. It is asked with every state, so nothing is lost with one.

*Adopting*: a new reign takes over what runs as it is, without a new epoch, where it knows what that is: all PEs that
are counted on and run anything are ACTIVE in one epoch, whose digest is that of the configuration which is remembered,
or of the very plan that would be deployed, and nobody was seen on a newer one. What is not that clean gets a new epoch.
A PE that is missing, or runs nothing, is then a fault like any other.

A state that is lost is followed by the next one, and one that comes twice tells nothing new; one that comes late tells
nothing at all. After a pause states are taken in the order in which they came, and the last one counts.

The numbers of epochs are `numbering`'s to give. What is activated or adopted is remembered over a restart.
"""

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass

from heronry_dg.configuration import Configuration, Running
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement, score
from heronry_dg.plan import Plan, make_plan
from heronry_dg.situation import Situation, survivors
from heronry_dg.transition import Transitions
from heronry_manager.contingency.configuration_code import ConfigurationCode
from heronry_manager.contingency.on_board import ContingencyNumbers
from heronry_manager.core.compilation import CompiledConfiguration, Compiler
from heronry_manager.core.exclusion import Exclusion
from heronry_manager.core.health import Health
from heronry_manager.core.memory import Runs
from heronry_manager.core.numbering import EpochNumbers
from heronry_manager.core.reconfiguration import Cause, Participant, Reconfiguration, Stage
from heronry_manager.core.topology import reached_by_wire
from heronry_manager.core.turn import Turn
from heronry_wire.management import COMMAND_OF, NO_EPOCH, Lease, Step, is_newer, newest_epoch
from heronry_wire.sansio import require
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1

_EPOCHS_REMEMBERED = 8
_MOST_LATE = 8  # pages 0: one that is further behind is new, after a silence
# STALE_TERM: a PE that names an epoch of this reign refuses the commands of another manager.
_IN_ORDER = frozenset((Reason.NONE, Reason.STALE_TERM))
_NO_REFUSAL = _IN_ORDER | {Reason.INCOMPLETE, Reason.STALE_EPOCH, Reason.NOT_ON_BOARD}


@dataclass(slots=True)
class Observed:
    """What one PE says that it runs."""

    epoch: int = 0
    digest: int = 0
    state: PeState = PeState.UNCONFIGURED
    configured: bool = False  # has been seen to run something of ours in this incarnation
    hears: bool = False  # has said since this reign began that it hears a LEASE
    said: tuple[int, int] | None = None  # incarnation and sequence of its last page 0

    def is_late(self, page: StatePage0) -> bool:
        """Tell whether a page was said before the last one: a gateway may hand it on late."""
        if self.said is None or self.said[0] != page.incarnation:
            return False
        return 1 <= (self.said[1] - page.sequence) % 256 <= _MOST_LATE


class Deployment:
    """The epochs of one reign."""

    def __init__(
        self,
        turn: Turn,
        spec: Spec,
        health: Health,
        exclusion: Exclusion,
        on_board: ContingencyNumbers | None = None,
        *,
        frames_per_command: int = 1,
    ) -> None:
        """Begin with nothing.

        on_board: the configurations that can be called by a number, if there are any.
        frames_per_command: 2 where each has its TAG: slices take half of the bus with all that they need.
        """
        self._turn, self._spec = turn, spec
        self._health, self._exclusion = health, exclusion
        self._on_board = on_board
        self._bitrate = spec.buses[spec.manager.bus].bitrate // frames_per_command
        self._compiler = Compiler(spec)
        self._wired = reached_by_wire(spec)
        self._transitions = Transitions(spec)
        self._observed = {pe: Observed() for pe in spec.pes}
        self._newest_lost = NO_EPOCH  # newest epoch that some PE ran when it was lost
        self._before = Configuration()  # what ran before the current epoch
        self.numbers = EpochNumbers(turn)
        self._code = ConfigurationCode(spec)
        self._epochs: dict[int, Reconfiguration] = {}
        self._plans: dict[int, Plan] = {}  # of the epochs that are remembered
        self.current: Reconfiguration | None = None  # the last epoch whose ACTIVATE went out
        self.next: Reconfiguration | None = None  # being prepared
        self._next_plan: Plan | None = None
        self._has_given_up = False  # an epoch, since the current one was activated
        self._advised: tuple[Plan, int] | None = None  # what was advised last, and its digest
        self._stopped: set[str] = set()  # modules that some PE has stopped, and that are wanted again

    def begin(self, term: int) -> None:
        """Begin to speak in this term: nobody has heard it yet."""
        self.numbers.begin(term)
        for seen in self._observed.values():
            seen.hears = False

    @property
    def running(self) -> Placement | None:
        """What runs, as far as this reign has brought it about: module -> (mode, PE)."""
        return placement(self.current.configuration) if self.current is not None else None

    @property
    def plan(self) -> Plan | None:
        """Plan of the current epoch."""
        return self._plans[self.current.epoch] if self.current is not None else None

    def unknown_epoch(self, leased: int) -> int | None:
        """Newest epoch that PEs are seen to run, or that another manager has `leased`, where none is known to run."""
        if self.current is not None:
            return None
        return newest_epoch((leased, self._newest_seen())) or None

    def _newest_seen(self) -> int:
        """Newest epoch that a PE has said it runs, whether it is counted on or not."""
        return newest_epoch((self._newest_lost, *(seen.epoch for seen in self._observed.values())))

    def seen(self, pe: str) -> Observed:
        """What a PE said last that it runs."""
        return self._observed[pe]

    def digest_of(self, epoch: int) -> int | None:
        """Digest of an epoch of this reign, also of one that is being prepared; None of one that is not known."""
        is_next = self.next is not None and self.next.epoch == epoch
        known = self.next if is_next else self._epochs.get(epoch)
        return None if known is None else known.compiled.digest

    def lease(self) -> Lease:
        """What LEASE repeats."""
        current = self.current
        if current is None:
            return Lease(self._turn.term, 0, Step.PREPARED, 0)
        return Lease(self._turn.term, current.epoch, current.step, current.compiled.digest)

    def next_deadlines_ns(self) -> list[int]:
        """When `tick` has something to do."""
        if self._turn.silent:
            return []
        deadlines = [epoch.next_deadline_ns() for epoch in (self.current, self.next) if epoch is not None]
        return [deadline for deadline in deadlines if deadline is not None]

    def validate(self) -> None:
        """Check what must hold between two steps; raises InvariantError with the recent events."""
        recent = self._turn.recent
        if self.next is not None:
            require(self.next.stage is Stage.PREPARING, "an epoch being prepared has left PREPARING: {}", recent)
            require(self.next.epoch == self.numbers.last, "an epoch number was used twice: {}", recent)
        if self.current is not None:
            require(self.current.stage is not Stage.PREPARING, "the current epoch was never activated: {}", recent)

    # What the PEs say

    def observe(self, pe: str, page: StatePage0) -> str | None:
        """Page 0 of a PE that is counted on or not; gives why it must be failed, if it must.

        A late one tells nothing: what the PE has begun to drive since, it still drives.
        """
        seen = self._observed[pe]
        if seen.is_late(page):
            return None
        seen.said = page.incarnation, page.sequence
        seen.epoch, seen.digest, seen.state = page.epoch, page.digest, page.state
        seen.hears = seen.hears or PeFlags.HEARS_LEASE in page.flags
        if not self._health.is_counted_on(pe):
            return None
        known = self._epochs.get(page.epoch)
        if page.state is PeState.UNCONFIGURED:
            if seen.configured or self.current is None:
                self._exclusion.rebooted(pe)
            if not seen.configured:
                return None
            return "it runs nothing although it was configured"
        if known is not None and known.compiled.digest == page.digest:
            seen.configured = True
            self._exclusion.reported(pe, known.placed, *self._placed_since(known))
            if not seen.hears:
                self._exclusion.unknown(pe)  # it may obey another reign yet, and take up what that one gives it
            known.reported(pe, page.state, self._turn.now_ns)
        elif seen.configured:
            self._exclusion.unknown(pe)
            return f"it runs epoch {page.epoch} with digest {page.digest:06X}, which nobody commanded"
        else:
            self._exclusion.unknown(pe)  # it joined with what another manager, or an older reign, gave it
        return None

    def _placed_since(self, known: Reconfiguration) -> Iterable[Mapping[str, set[str]]]:
        """Tokens of the epochs that are newer than this one."""
        if known is self.current:
            return ()
        return (one.placed for one in self._epochs.values() if is_newer(one.epoch, known.epoch))

    def staging(self, pe: str, page: StatePage1) -> str | None:
        """Page 1 of a PE; gives why it must be failed, if it must."""
        for epoch in (self.next, self.current):
            if epoch is None or page.staged_epoch != epoch.epoch:
                continue
            has_staged = page.staged_digest == epoch.compiled.digest and page.reason in _IN_ORDER
            wants_body = page.reason is Reason.INCOMPLETE
            epoch.staged(pe, has_staged=has_staged, wants_body=wants_body, now_ns=self._turn.now_ns)
            if page.reason is Reason.NOT_ON_BOARD:
                epoch.not_on_board(pe, self._turn.now_ns)
            if page.reason not in _NO_REFUSAL:
                self._turn.emit("pe_refused", pe=pe, epoch=epoch.epoch, reason=page.reason.name)
                return f"it cannot stage its slice: {page.reason.name}"
        return None

    def is_active(self, pe: str) -> bool:
        """Tell whether a PE runs something, as it has said last."""
        return self._observed[pe].state is PeState.ACTIVE

    def joined(self, pe: str) -> None:
        """A PE is counted on again: it has been given nothing yet."""
        self._observed[pe].configured = False

    def lost(self, pe: str) -> None:
        """A PE is no longer counted on. What it has said last that it runs, it may run still."""
        self._newest_lost = newest_epoch((self._newest_lost, self._observed[pe].epoch))
        self._observed[pe] = Observed()
        if self.current is not None:
            self.current.drop(pe)

    # From one epoch to the next

    def stopped(self, module: str) -> None:
        """A module that its PE had stopped counts as well again: only another epoch makes that PE start it."""
        self._stopped.add(module)

    def is_overtaken_by(self, pe: str) -> bool:
        """Tell whether a PE runs a newer epoch than the last one that was opened here."""
        last = self.next or self.current
        return last is not None and is_newer(self._observed[pe].epoch, last.epoch)

    def everybody_runs_it(self) -> bool:
        """Tell whether everybody counted on runs the current epoch, and all of it."""
        current = self.current
        if current is None or self._stopped & current.configuration.modules.keys():
            return False
        return all(self._observed[pe].epoch == current.epoch for pe in self._health.counted_on())

    def runs(self, plan: Plan) -> bool:
        """Tell whether what runs is this already, and take the plan for that of the current epoch.

        Who is counted on and does not run it is admitted to the epoch, if it has nothing to do there.
        """
        current = self.current
        if current is None or current.stage is not Stage.DONE or current.configuration != plan.configuration:
            return False
        if self._stopped & current.configuration.modules.keys() or is_newer(self._newest_seen(), current.epoch):
            return False
        late = [pe for pe in self._health.counted_on() if self._observed[pe].epoch != current.epoch]
        if any(self._needs_new(pe, current) for pe in late):
            return False
        for pe in late:
            current.admit(self._participant(pe, current.contingency, self._reached(plan)), self._turn.now_ns)
        self._plans[current.epoch] = plan
        return True

    def _needs_new(self, pe: str, current: Reconfiguration) -> bool:
        """Tell whether the current epoch does not do for who comes late: it has work there, or is not the newest."""
        return bool(current.compiled.slices[self._spec.pes[pe].node_id]) or self._has_given_up

    def adopts(self, plan: Plan) -> bool:
        """Take over what runs if it is exactly this plan, everywhere; tells whether it is."""
        compiled = self._compiler.configuration(plan.configuration)
        seen = [self._observed[pe] for pe in self._health.counted_on()]
        clean = all(one.digest == compiled.digest and one.state is PeState.ACTIVE for one in seen)
        runs = self._turn.memory.runs
        if runs is not None and is_newer(runs.epoch, self._newest_seen()):
            return False  # who was given what came after that is silent, and may run it
        if not clean or {one.epoch for one in seen} != {self._newest_seen()}:
            return False
        self._adopt(seen[0].epoch, plan, compiled)
        return True

    def adopts_remembered(self, now: Situation, runs: Runs | None) -> bool:
        """Take over what is remembered to run, or was overheard, where it does; tells whether it does.

        PEs counted on that run nothing, and those that are missing, do not matter: they are dealt with as faults. What
        radios could carry when it was planned is not remembered: it passes for a plan for what they carry `now`.
        """
        if runs is None:
            return False
        configuration = self._code.decode(bytes.fromhex(runs.row))
        compiled = self._compiler.configuration(configuration)
        seen = [self._observed[pe] for pe in self._health.counted_on()]
        inside = [one for one in seen if one.state is PeState.ACTIVE and one.epoch == runs.epoch]
        clean = all(one.digest == compiled.digest == runs.digest for one in inside)
        if not inside or not clean or any(one.state is not PeState.UNCONFIGURED and one not in inside for one in seen):
            return False
        if is_newer(self._newest_seen(), runs.epoch):
            return False
        intended = Situation(frozenset(), now.limits, now.phase)
        worth = score(self._spec, intended, configuration, None)
        plan = make_plan(self._spec, intended, configuration, worth, optimal=False)
        self._adopt(runs.epoch, plan, compiled)
        return True

    def _adopt(self, epoch: int, plan: Plan, compiled: CompiledConfiguration) -> None:
        adopted = self._reconfiguration(epoch, plan, compiled, (), Stage.DONE)
        self.current = adopted
        self._remember(adopted, plan)
        self._exclusion.activated(adopted.placed)  # whoever is missing may still hold what it was given
        for pe in self._health.counted_on():
            self._exclusion.unknown(pe)  # before it hears this reign it may take up what another one gave it
            if self._observed[pe].state is PeState.UNCONFIGURED:
                continue
            self._observed[pe].configured = True
            adopted.reported(pe, PeState.ACTIVE, self._turn.now_ns)
        self._turn.emit("adopted", epoch=adopted.epoch, digest=f"{compiled.digest:06X}")

    def prepare(self, plan: Plan, causes: Iterable[Cause]) -> None:
        """Open the next epoch."""
        compiled = self._compiler.configuration(plan.configuration)
        epoch = self.numbers.next(self._newest_seen())
        self.next = self._reconfiguration(epoch, plan, compiled, tuple(causes), Stage.PREPARING)
        self._next_plan = plan
        self._turn.emit(
            "epoch_prepared",
            epoch=epoch,
            digest=f"{compiled.digest:06X}",
            contingency=self.next.contingency,
            pes=self._health.counted_on(),
            bytes=sum(len(body) for body in compiled.slices.values()),
        )

    def advise(self, plan: Plan, unknown: int | None, overheard: Runs | None) -> None:
        """Tell what deploying this plan would change, and do nothing; say so where an `unknown` epoch runs.

        Of one that was overheard, and that does not run everywhere yet, nothing is said: `follow` will see it.
        """
        self._advised = plan, self._compiler.configuration(plan.configuration).digest
        if unknown is not None:
            if overheard is None or overheard.epoch != unknown:
                self._turn.emit("unknown_epoch", epoch=unknown)
            return
        before = self.current.configuration.modules if self.current is not None else {}
        after = plan.configuration.modules
        self._turn.emit(
            "advice",
            plan=plan.document(),
            moved=_moved(before, after),
            started=sorted(after.keys() - before.keys()),
            stopped=sorted(before.keys() - after.keys()),
        )

    def follow(self, now: Situation, overheard: Runs | None) -> bool:
        """See what another manager does, when advising; tells whether it has just become known what runs.

        That is what was advised or overheard; as long as it is anything else, nothing is known to run.
        """
        seen = {(self._observed[pe].epoch, self._observed[pe].digest) for pe in self._health.counted_on()}
        if self.current is not None and (self.current.epoch, self.current.compiled.digest) not in seen:
            self.current = None
            self._stopped.clear()
        if self.current is not None:
            return False
        if self._advised is not None and {digest for _, digest in seen} == {self._advised[1]}:
            plan, _ = self._advised
            if self.adopts(plan):
                self._advised = None
                return True
        is_seen = overheard is not None and (overheard.epoch, overheard.digest) in seen
        return is_seen and self.adopts_remembered(now, overheard)

    def abandon(self, reason: str) -> None:
        """Give up what is being prepared, if anything is: the situation is another now."""
        if self.next is not None:
            self.next.abandon()
            self._has_given_up = True
            self._turn.emit("epoch_abandoned", epoch=self.next.epoch, reason=reason)
            self.next = None

    def tick(self) -> list[str]:
        """Repeat what was not acknowledged; gives the PEs that have not answered for too long, where any were asked."""
        if self._turn.silent:
            return []
        return [pe for epoch in (self.current, self.next) if epoch is not None for pe in epoch.tick(self._turn.now_ns)]

    def advance(self) -> Reconfiguration | None:
        """Move the epochs as far as they will go, and send what they have to say; gives one that is done by that."""
        if self.next is not None and self.next.all_staged():
            self._activate(self.next)
        done = self._advance_current(self.current) if self.current is not None else None
        for epoch in (self.current, self.next):
            self._flush(epoch)
        return done

    def _advance_current(self, current: Reconfiguration) -> Reconfiguration | None:
        self._free(current)
        broken = current.stage is Stage.BREAKING and current.all_broken() and current.identifiers_free_ns is None
        if broken or (current.stage is Stage.HOLDING and current.demux_free_ns is None):
            current.go(self._turn.now_ns)
            self._emit_step(current)
        if current.stage is not Stage.GOING or not current.all_active():
            return None
        current.finish()
        self._emit_reconfigured(current)
        return current

    def _reconfiguration(
        self, epoch: int, plan: Plan, compiled: CompiledConfiguration, causes: tuple[Cause, ...], stage: Stage
    ) -> Reconfiguration:
        number = 0 if self._on_board is None else self._on_board.number(plan.configuration)
        reached = self._reached(plan)
        return Reconfiguration(
            term=self._turn.term,
            epoch=epoch,
            configuration=plan.configuration,
            compiled=compiled,
            placed=self._exclusion.tokens(plan.configuration),
            participants=[self._participant(pe, number, reached) for pe in self._health.counted_on()],
            bitrate=self._bitrate,
            started_ns=self._turn.now_ns,
            causes=causes,
            stage=stage,
            contingency=number,
        )

    def _reached(self, plan: Plan) -> Container[str]:
        """PEs that a plan can command; where it can command none there is no haste, and all are waited for."""
        reached = survivors(self._spec, plan.now).pe_cpu_millis.keys()
        counted_on = self._health.counted_on()
        return reached if any(pe in reached for pe in counted_on) else counted_on

    def _participant(self, pe: str, contingency: int, reached: Container[str]) -> Participant:
        """One who takes part. Nobody waits for who is not `reached`: beyond a dead gateway a slow beat may go on."""
        seen = self._observed[pe]
        known = self._epochs.get(seen.epoch)
        node = self._spec.pes[pe].node_id
        runs = known.compiled.slice_digests[node] if known is not None and seen.configured else None
        return Participant(
            pe=pe,
            node=node,
            period_ns=self._health.period_ns(pe),
            awaited=pe in self._wired and pe in reached,
            runs_digest=runs,
            on_board=self._on_board is not None and self._on_board.holds(pe, contingency),
        )

    def _activate(self, epoch: Reconfiguration) -> None:
        assert self._next_plan is not None
        must_break = self._must_break(epoch, self._next_plan.now)
        self._free(epoch)
        self._exclusion.activated(epoch.placed)
        self._before = self.current.configuration if self.current is not None else Configuration()
        self.current, self.next, self._has_given_up = epoch, None, False
        self._stopped.clear()
        self._remember(epoch, self._next_plan)
        epoch.activate(must_break, self._turn.now_ns)
        self._emit_step(epoch)

    def _must_break(self, epoch: Reconfiguration, now: Situation) -> set[str]:
        """PEs that must be BROKEN before anybody goes: they give up something exclusive, or make room on a bus.

        Who runs what this reign has not given it is waited for too, unless it is beyond a radio.
        """
        counted_on = self._health.counted_on()
        may_run = {pe: self._may_run(pe) for pe in counted_on}
        strangers = {pe for pe, known in may_run.items() if known is None and pe in self._wired}
        exclusive = self._exclusion.must_break(epoch.placed, counted_on) | strangers
        known = {pe: configurations or () for pe, configurations in may_run.items()}
        return set(self._transitions.must_break(known, epoch.configuration, now, exclusive))

    def _may_run(self, pe: str) -> list[Configuration] | None:
        """What a PE may be running, as far as it has been seen; None: nobody knows."""
        seen, current = self._observed[pe], self.current
        if seen.state is PeState.UNCONFIGURED:
            return []
        known = self._epochs.get(seen.epoch)
        if known is None or known.compiled.digest != seen.digest:
            return None
        late = [current.configuration] if current is not None and current is not known else []
        return [known.configuration, *late]

    def _remember(self, epoch: Reconfiguration, plan: Plan) -> None:
        row = self._code.encode(epoch.configuration).hex()
        self._turn.keep(Runs(epoch.epoch, epoch.compiled.digest, row))
        self._epochs[epoch.epoch], self._plans[epoch.epoch] = epoch, plan
        shown = {self._observed[pe].epoch for pe in self._health.counted_on()}  # somebody late may still be at one
        for forgotten in [number for number in self._epochs if number not in shown][:-_EPOCHS_REMEMBERED]:
            del self._epochs[forgotten], self._plans[forgotten]

    def _free(self, epoch: Reconfiguration) -> None:
        """Work out how long what this epoch needs may still be held by PEs that are not counted on."""
        if epoch.stage in (Stage.DONE, Stage.GOING):
            return
        counted_on, now_ns = self._health.counted_on(), self._turn.now_ns
        epoch.identifiers_free_ns = self._exclusion.identifiers_free_ns(epoch.placed, counted_on, now_ns)
        epoch.demux_free_ns = self._exclusion.demux_free_ns(epoch.placed, counted_on, now_ns)

    def _flush(self, epoch: Reconfiguration | None) -> None:
        if epoch is None:
            return
        for message in epoch.outbox:
            self._turn.send(COMMAND_OF[type(message)], message)
        epoch.outbox.clear()

    def _emit_step(self, epoch: Reconfiguration) -> None:
        waiting = sorted(epoch.must_break) if epoch.stage is Stage.BREAKING else []
        self._turn.emit("epoch_step", epoch=epoch.epoch, step=epoch.step.name, waiting_for=waiting)

    def _emit_reconfigured(self, epoch: Reconfiguration) -> None:
        before, after = self._before.modules, epoch.configuration.modules
        times, now_ns = epoch.times, self._turn.now_ns
        staged_ns = times.staged_ns or now_ns
        first = min(epoch.causes, key=lambda cause: cause.known_ns)
        self._turn.emit(
            "reconfigured",
            epoch=epoch.epoch,
            causes=[cause.what for cause in epoch.causes],
            times_ns={
                "detect": first.known_ns - first.since_ns,
                "decide": times.prepared_ns - first.known_ns,
                "distribute": staged_ns - times.prepared_ns,
                "activate": now_ns - staged_ns,
            },
            moved=_moved(before, after),
            started=sorted(after.keys() - before.keys()),
            stopped=sorted(before.keys() - after.keys()),
        )


def _moved(before: Mapping[str, Running], after: Mapping[str, Running]) -> list[str]:
    return sorted(module for module in before.keys() & after.keys() if before[module].pe != after[module].pe)
