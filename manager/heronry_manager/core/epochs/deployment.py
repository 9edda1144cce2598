"""From a plan to a running configuration: the current epoch, the next one, and what PEs report on them.

    next       the epoch that is being prepared. When every awaited PE has staged it, it becomes the
               current epoch. If the situation changes before that, it is abandoned, and its number is not
               used again
    current    the last epoch whose ACTIVATE went out. LEASE repeats this epoch, and a PE that comes late
               still gets its slice

Only state frames show what a PE runs (`observation`); a command does not. Three reports show that a PE must be failed:

- The PE runs nothing, although it was configured.
- The PE runs what no manager commanded.
- The PE cannot stage its slice.

Then the caller gets the cause as a sentence, and fails the PE.

*Another table*: a PE refuses its slice for the digest, because its table is not the one for which this manager compiles
slices (`other_tables`).

*Admitting*: a PE that comes back, and has an empty slice in the current epoch (it runs no module and
forwards nothing), joins this epoch; no other PE is disturbed. Two kinds of PEs need a new epoch instead.
A PE with a slice that is not empty needs one, since other PEs may have to release exclusive things first.
A PE that may have staged a newer, abandoned epoch needs one, since no PE goes back to an older epoch.

*Overtaken*: a PE that hears of an epoch newer than its own is overtaken. It drives nothing exclusive until
it runs an epoch that is newer still (protocol rule 6). This happens, for example, when a broken bus is
repaired: beyond the break another manager may have opened a newer epoch, and the PEs there run that epoch.
So this manager opens a new epoch for the running configuration. The PEs from beyond the break are not
available yet, and have no part in the new epoch. The core looks for newer epochs in every state, so a lost
state does no harm.

*Adopting*: at its start the manager may take over the running configuration (`adoption`). A manager that
only advises reports what it would do, and adopts what the PEs run (`advice`).

    known_epochs     how an epoch is made and remembered
    activation       the steps of an epoch
    numbering        the number of an epoch
    reconfiguration  how an epoch proceeds; with `observation`: what follows from lost, late and doubled
                     frames
    exclusion        what a PE may still drive
"""

from collections.abc import Iterable, Iterator, Mapping

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.core.epochs.activation import Activation
from heronry_manager.core.epochs.adoption import Adoption
from heronry_manager.core.epochs.epoch import Cause, Epoch, Stage
from heronry_manager.core.epochs.known_epochs import Epochs
from heronry_manager.core.epochs.observation import Observations, Observed
from heronry_manager.core.epochs.other_tables import OtherTables
from heronry_manager.core.epochs.spec_switch import SpecSwitch
from heronry_manager.core.membership import Exclusion, Health
from heronry_manager.core.memory import Runs
from heronry_manager.core.tables import CompiledConfiguration, Compiler, ContingencyNumbers
from heronry_manager.core.turn import Turn
from heronry_wire.management import COMMAND_OF, Lease, Step, is_newer, newest_epoch
from heronry_wire.sansio import NEVER_NS, require
from heronry_wire.state_frames import PeState, Reason, StatePage0, StatePage1

# STALE_TERM, with an epoch of this term: the PE has refused a command of another manager, and none of this one.
_IN_ORDER = frozenset((Reason.NONE, Reason.STALE_TERM))
_NO_REFUSAL = _IN_ORDER | {Reason.INCOMPLETE, Reason.STALE_EPOCH, Reason.NOT_ON_BOARD}


class Deployment:
    """Deploys plans as epochs, in one term at a time, and keeps what the PEs report of these epochs."""

    def __init__(
        self,
        turn: Turn,
        spec: Spec,
        health: Health,
        exclusion: Exclusion,
        *,
        compiler: Compiler,
        on_board: ContingencyNumbers | None = None,
        frames_per_command: int = 1,
    ) -> None:
        """Begin without epochs; `Epochs` explains `compiler`, `on_board` and `frames_per_command`."""
        self._turn, self._spec, self._health, self._exclusion = turn, spec, health, exclusion
        self._compiler, self._on_board, self._frames_per_command = compiler, on_board, frames_per_command
        self.forget()

    def forget(self) -> None:
        """Forget all epochs, and what the PEs have reported; only what is remembered over a restart is known."""
        turn, spec, health, exclusion = self._turn, self._spec, self._health, self._exclusion
        self.observed = Observations(spec.pes)
        self.epochs = Epochs(
            turn,
            spec,
            health,
            exclusion,
            self.observed,
            compiler=self._compiler,
            on_board=self._on_board,
            frames_per_command=self._frames_per_command,
        )
        self._adoption = Adoption(turn, spec, health, exclusion, self.observed, epochs=self.epochs)
        self._activation = Activation(turn, spec, health, exclusion, self.observed, epochs=self.epochs)
        self.current: Epoch | None = None  # the last epoch whose ACTIVATE went out
        self.next: Epoch | None = None  # being prepared
        self.switch: SpecSwitch | None = None  # to another spec, on its way
        self.other_tables = OtherTables(self.observed)
        self._has_given_up = False  # abandoned an epoch since the current one was activated
        self._stopped: set[str] = set()  # modules that some PE has stopped, and that are wanted again

    def begin(self, term: int) -> None:
        """Begin a new term, of which no PE has heard yet."""
        self.epochs.numbers.begin(term)
        self.observed.begin_term()
        self.other_tables.forget()

    @property
    def running(self) -> Placement | None:
        """The placement that the current epoch commands: module -> (mode, PE); None: there is no current epoch."""
        return placement(self.current.configuration) if self.current is not None else None

    @property
    def plan(self) -> Plan | None:
        """The plan of the current epoch; None: there is no current epoch."""
        return self.current.plan if self.current is not None else None

    @property
    def configuration(self) -> Configuration | None:
        """The configuration of the current epoch; None: there is no current epoch."""
        return self.current.configuration if self.current is not None else None

    def is_at_rest(self) -> bool:
        """Tell whether the current epoch runs everywhere, and no other is being prepared."""
        return self.current is not None and self.current.stage is Stage.DONE and self.next is None

    def compiled_digest(self, configuration: Configuration) -> int:
        """Return the digest that an epoch with this configuration has."""
        return self.epochs.compiled(configuration).digest

    def unknown_epoch(self, leased: int) -> int | None:
        """Return the newest epoch that PEs run or another manager's LEASE names, if this manager has no current epoch.

        None: there is no such epoch, or this manager has a current epoch, whose configuration it knows.

        leased: the epoch that the LEASE of another manager names.
        """
        if self.current is not None:
            return None
        return newest_epoch((leased, self.observed.newest_epoch())) or None

    def digest_of(self, epoch: int) -> int | None:
        """Return the digest of the epoch that is being prepared, or of a remembered epoch; None: it is neither."""
        is_next = self.next is not None and self.next.epoch == epoch
        if self.switch is not None and self.switch.epoch.epoch == epoch:
            return self.switch.epoch.compiled.digest
        known = self.next if is_next else self.epochs.known(epoch)
        return None if known is None else known.compiled.digest

    def lease(self) -> Lease:
        """Return the LEASE to send now, with the current epoch and its step."""
        current = self.current
        if self.switch is not None and self.switch.is_activated:
            return self.switch.lease()
        if current is None:
            return Lease(self._turn.term, 0, Step.PREPARED, 0)
        return Lease(self._turn.term, current.epoch, current.step, current.compiled.digest)

    def next_deadline_ns(self) -> int:
        """Return the time (ns) at which to call `tick`; NEVER_NS: there is nothing to repeat."""
        due_ns = NEVER_NS
        if not self._turn.silent:
            for epoch in self._on_their_way():
                epoch_ns = epoch.next_deadline_ns()
                if epoch_ns is not None and epoch_ns < due_ns:
                    due_ns = epoch_ns
        return due_ns

    def validate(self) -> None:
        """Check the invariants of the epochs; raises InvariantError, which lists the recent events."""
        recent = self._turn.recent
        if self.next is not None:
            require(self.next.stage is Stage.PREPARING, "an epoch being prepared has left PREPARING: {}", recent)
            require(self.next.epoch == self.epochs.numbers.last, "an epoch number was used twice: {}", recent)
        if self.current is not None:
            require(self.current.stage is not Stage.PREPARING, "the current epoch was never activated: {}", recent)

    # What the PEs report

    def observe(self, pe: str, page: StatePage0) -> str | None:
        """Note from page 0 of a PE what it runs; gives the cause for which the PE must be failed, or None.

        A late page has no effect: it does not show what the PE has begun to drive since.
        """
        seen = self.observed.take(pe, page)
        if seen is None or not self._health.is_available(pe):
            return None
        if page.state is PeState.UNCONFIGURED:
            return self._runs_nothing(pe, seen)
        if self.switch is not None and self.switch.runs(pe, page):
            return None
        known = self.epochs.known(page.epoch)
        if known is not None and known.compiled.digest == page.digest:
            seen.configured = True
            self._exclusion.reported(pe, known.placed, *self._placed_since(known))
            if not seen.hears:
                self._exclusion.unknown(pe)  # it may still execute commands of another term
            known.reported(pe, page.state, self._turn.now_ns)
            return None
        self._exclusion.unknown(pe)
        if not seen.configured:
            return None  # another manager, or an older term, gave it what it runs
        return f"it runs epoch {page.epoch} with digest {page.digest:06X}, which no manager commanded"

    def _runs_nothing(self, pe: str, seen: Observed) -> str | None:
        if seen.configured or self.current is None:
            self._exclusion.rebooted(pe)
        return "it runs nothing although it was configured" if seen.configured else None

    def _placed_since(self, known: Epoch) -> Iterable[Mapping[str, set[str]]]:
        """Yield one mapping for each epoch newer than `known`: by PE, the tokens that this epoch places there."""
        return () if known is self.current else self.epochs.placed_since(known)

    def staging(self, pe: str, page: StatePage1) -> str | None:
        """Note from page 1 of a PE how far it has staged an epoch.

        Gives the cause for which the PE must be failed (with the reason DIGEST: left alone, `leave_alone`), or None.
        """
        if self.switch is not None and self.switch.staging(pe, page):
            return None
        for epoch in (self.next, self.current):
            if epoch is None or page.staged_epoch != epoch.epoch:
                continue
            has_staged = page.staged_digest == epoch.compiled.digest and page.reason in _IN_ORDER
            wants_body = page.reason is Reason.INCOMPLETE
            epoch.staged(pe, has_staged=has_staged, wants_body=wants_body, now_ns=self._turn.now_ns)
            if page.reason is Reason.NOT_ON_BOARD:
                epoch.not_on_board(pe, self._turn.now_ns)
            if page.reason not in _NO_REFUSAL:
                self._turn.emit(events.PeRefused, pe=pe, epoch=epoch.epoch, reason=page.reason.name)
                if page.reason is Reason.IMAGE:
                    return None  # the PE also reports the module, and repeats that until it is heard
                return f"it cannot stage its slice: {page.reason.name}"
        return None

    def leave_alone(self, pe: str) -> bool:
        """Take a PE that refuses its slice for the digest out of the epoch that is being prepared, if it flies.

        Tells whether it flies: it runs what this manager does not know, and this manager has no current epoch. Then
        no epoch is activated while it does (`other_tables`).
        """
        if self.current is not None or not self.observed.runs_unknown(pe):
            return False
        self.other_tables.flies(pe)
        if self.next is not None:  # pragma: no branch - a refusal is of this epoch or of the current one (`staging`)
            self.next.drop(pe)
        return True

    def is_held(self) -> bool:
        """Tell whether no epoch may be opened, because PEs fly with another table."""
        return self.current is None and bool(self.other_tables.flying())

    def why_held(self) -> str:
        """Say why no epoch is opened, while `is_held`."""
        return self.other_tables.why()

    def is_under_way(self) -> bool:
        """Tell whether an epoch is on its way: it is being prepared, or was activated and does not run everywhere."""
        return (
            self.next is not None
            or self.switch is not None
            or (self.current is not None and self.current.stage is not Stage.DONE)
        )

    def is_active(self, pe: str) -> bool:
        """Tell whether the last state of a PE reports ACTIVE: it runs all of its slice."""
        return self.observed.of[pe].state is PeState.ACTIVE

    def joined(self, pe: str) -> None:
        """Note that a PE is available again, and must be configured anew by this manager."""
        self.observed.joined(pe)

    def lost(self, pe: str) -> None:
        """Forget the reports of a PE that is no longer available; the current epoch waits for it no longer."""
        self.observed.lost(pe)
        self.other_tables.lost(pe)
        if self.current is not None:
            self.current.drop(pe)
        if self.switch is not None:
            self.switch.lost(pe)

    # From one epoch to the next

    def stopped(self, module: str, pe: str | None = None) -> None:
        """Note that the operator has cleared a module that a PE had stopped, so a new epoch must start it again.

        pe: the PE that had stopped the module. If the current epoch does not place the module on this PE, the call has
            no effect. None: the call always has an effect.
        """
        runs_on = (self.running or {}).get(module)
        if pe is None or (runs_on is not None and runs_on[1] == pe):
            self._stopped.add(module)

    def is_overtaken_by(self, pe: str) -> bool:
        """Tell whether a PE runs a newer epoch than the last one that this manager opened."""
        last = self.next or self.current
        return last is not None and not self.is_switching() and is_newer(self.observed.of[pe].epoch, last.epoch)

    def all_available_run_it(self) -> bool:
        """Tell whether every available PE runs the current epoch, and no module of it must be started again.

        A module must be started again if a PE had stopped it, and the operator has cleared this (`stopped`).
        """
        current = self.current
        if current is None or self._stopped & current.configuration.modules.keys():
            return False
        return all(self.observed.of[pe].epoch == current.epoch for pe in self._health.available())

    def runs(self, plan: Plan) -> bool:
        """Tell whether the PEs run the configuration of this plan already, as the current epoch.

        If so, `plan` becomes the plan of the current epoch, and each available PE that does not run this epoch
        yet is admitted to it. The answer is no if one of these PEs cannot be admitted, because its slice in
        this epoch is not empty, or because it may have staged a newer epoch.
        """
        current = self.current
        if current is None or current.stage is not Stage.DONE or current.configuration != plan.configuration:
            return False
        if self._stopped & current.configuration.modules.keys():
            return False
        if is_newer(self.observed.newest_epoch(), current.epoch):
            return False
        late = [pe for pe in self._health.available() if self.observed.of[pe].epoch != current.epoch]
        if any(self._needs_new(pe, current) for pe in late):
            return False
        for participant in self.epochs.participants(late, plan, current.contingency):
            current.admit(participant, self._turn.now_ns)
        current.plan = plan
        return True

    def _needs_new(self, pe: str, current: Epoch) -> bool:
        """Tell whether a PE that joins late needs a new epoch."""
        # it runs or forwards something in the current epoch, or may have staged a newer one
        return bool(current.compiled.slices[self._spec.pes[pe].node_id]) or self._has_given_up

    def adopts(self, plan: Plan) -> bool:
        """Adopt the running configuration if every available PE runs exactly this plan.

        Tells whether it was adopted.
        """
        return self._stands_on(self._adoption.of_plan(plan))

    def adopts_remembered(self, now: Situation, runs: Runs | None) -> bool:
        """Adopt a remembered or overheard configuration if the PEs run it; tells whether it was adopted.

        now: the plan counts as made for the limits in this situation.
        """
        return self._stands_on(self._adoption.of_remembered(runs, now))

    def _stands_on(self, adopted: Epoch | None) -> bool:
        if adopted is None:
            return False
        self.current = adopted
        return True

    def forget_current(self) -> None:
        """Forget the current epoch, because the configuration that runs is no longer known."""
        self.current = None
        self._stopped.clear()

    def prepare(self, plan: Plan, causes: Iterable[Cause]) -> None:
        """Open an epoch for this plan, and send PREPARE and the slices; `causes` are why the plan was made."""
        self._give_up_switch("another configuration goes first")
        self.next = self.epochs.open(plan, causes)
        self._turn.emit(
            events.EpochPrepared,
            epoch=self.next.epoch,
            digest=f"{self.next.compiled.digest:06X}",
            contingency=self.next.contingency,
            pes=tuple(self._health.available()),
            bytes=sum(len(body) for body in self.next.compiled.slices.values()),
        )

    def abandon(self, reason: str) -> None:
        """Abandon the epoch that is being prepared, if there is one; the event gives `reason`."""
        self._give_up_switch(reason)
        if self.next is not None:
            self.next.abandon()
            self._has_given_up = True
            self._turn.emit(events.EpochAbandoned, epoch=self.next.epoch, reason=reason)
            self.next = None

    def tick(self) -> list[str]:
        """Send again what the PEs have not acknowledged in time.

        Returns the PEs that must be failed because they have not answered within the patience.
        """
        if self._turn.silent:
            return []
        return [pe for epoch in self._on_their_way() for pe in epoch.tick(self._turn.now_ns)]

    def _on_their_way(self) -> Iterator[Epoch]:
        """Yield the epochs whose commands are repeated; while the spec changes, only the epoch that does it."""
        if self.is_switching():
            assert self.switch is not None
            yield self.switch.epoch
            return
        yield from (one for one in (self.current, self.next) if one is not None)
        if self.switch is not None:
            yield self.switch.epoch

    # To another spec

    def is_switching(self) -> bool:
        """Tell whether PEs may fly by another spec already: nothing else is commanded until all do."""
        return self.switch is not None and self.switch.is_activated

    def open_switch(self, plan: Plan, compiled: CompiledConfiguration) -> SpecSwitch:
        """Open the epoch by which all available PEs change to another spec."""
        current = self.current
        require(current is not None and self.next is None, "a switch beside another epoch: {}", self._turn.recent)
        assert current is not None
        pes = [pe for pe in self._health.available() if self._spec.pes[pe].node_id in compiled.slices]
        self.switch = SpecSwitch(
            self._turn,
            Epoch(
                term=self._turn.term,
                epoch=self.epochs.numbers.next(self.observed.newest_epoch()),
                plan=plan,
                compiled=compiled,
                placed={},
                participants=self.epochs.participants(pes, current.plan, 0),
                bitrate=self.epochs.bitrate,
                started_ns=self._turn.now_ns,
            ),
        )
        return self.switch

    def _give_up_switch(self, reason: str) -> None:
        if self.switch is not None and not self.switch.is_activated:
            self.switch.give_up(reason)
            self.switch, self._has_given_up = None, True

    def advance(self) -> Epoch | None:
        """Send the next step of each epoch for which nothing is left to wait.

        A staged epoch gets its first ACTIVATE and becomes the current one; the current epoch gets its next step.
        Returns the current epoch if it is completed now; None if not.
        """
        if self.next is not None and self.next.all_staged():
            if self.is_held():
                self.abandon(self.other_tables.why())
            else:
                self._activate(self.next)
        if self.switch is not None:
            self.switch.advance()
            if self.switch.refusal is not None:
                self._give_up_switch(self.switch.refusal)
        current = self.current
        is_done = current is not None and not self.is_switching() and self._activation.move_on(current)
        for epoch in self._on_their_way():
            self._flush(epoch)
        return current if is_done else None

    def _activate(self, epoch: Epoch) -> None:
        self._activation.begin(epoch, self.current)
        self.current, self.next, self._has_given_up = epoch, None, False
        self._stopped.clear()

    def _flush(self, epoch: Epoch) -> None:
        for message in epoch.outbox:
            self._turn.send(COMMAND_OF[type(message)], message)
        epoch.outbox.clear()
