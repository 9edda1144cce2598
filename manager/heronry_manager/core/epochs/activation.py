"""The activation of an epoch that every awaited PE has staged, in up to three steps: BREAK, GO, GO_ALL.

    BREAK    a PE stops what it has to give up
    GO       a PE starts everything but new DEMUX branches
    GO_ALL   a PE also starts new DEMUX branches

BREAK is skipped if nothing has to stop before GO. GO is skipped if no unavailable PE may still drive a DEMUX that the
epoch gives to another PE. `epoch` says how long each step is repeated, and which PEs must answer.

Before the manager commands GO, it waits for the report BROKEN of

- each PE that gives up something exclusive (`exclusion`);
- each PE that has to make room on a bus (`heronry_dg.transition`);
- each PE that is reached by wire and runs an unknown configuration: it reports an epoch that the manager
  has forgotten, or an unexpected digest. Without this wait two PEs could send under one identifier.

An unavailable PE does not answer, so the manager waits for the time after which that PE has certainly
stopped. Before GO, the PE must no longer send under the identifiers of a module that moves. Before GO_ALL,
it must no longer drive a DEMUX that moves.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.transition import Transitions
from heronry_manager import events
from heronry_manager.core.epochs.epoch import Epoch, Stage
from heronry_manager.core.epochs.known_epochs import Epochs, module_changes
from heronry_manager.core.epochs.observation import Observations
from heronry_manager.core.membership import Exclusion, Health
from heronry_manager.core.turn import Turn
from heronry_wire.state_frames import PeState


class Activation:
    """Commands the steps of an epoch, from its first ACTIVATE until all awaited PEs are ACTIVE."""

    def __init__(
        self, turn: Turn, spec: Spec, health: Health, exclusion: Exclusion, observed: Observations, *, epochs: Epochs
    ) -> None:
        self._turn, self._health, self._exclusion = turn, health, exclusion
        self._observed, self._epochs = observed, epochs
        self._transitions = Transitions(spec)
        self._before: Configuration | None = None  # what ran before the current epoch

    def begin(self, epoch: Epoch, current: Epoch | None) -> None:
        """Send the first ACTIVATE of `epoch`, which from now on replaces `current`, the epoch before it."""
        must_break = self._must_break(epoch, current)
        self._free(epoch)
        self._exclusion.activated(epoch.placed)
        self._before = None if current is None else current.configuration
        self._epochs.remember(epoch)
        epoch.activate(must_break, self._turn.now_ns)
        self._emit_step(epoch)

    def move_on(self, epoch: Epoch) -> bool:
        """Command the next step of an epoch if nothing is left to wait for; tells whether the epoch is completed."""
        self._free(epoch)
        broken = epoch.stage is Stage.BREAKING and epoch.all_broken() and epoch.identifiers_free_ns is None
        if broken or (epoch.stage is Stage.HOLDING and epoch.demux_free_ns is None):
            epoch.go(self._turn.now_ns)
            self._emit_step(epoch)
        if epoch.stage is not Stage.GOING or not epoch.all_active():
            return False
        epoch.finish()
        self._emit_reconfigured(epoch)
        return True

    def _must_break(self, epoch: Epoch, current: Epoch | None) -> set[str]:
        """Return the PEs that must report BROKEN before the manager commands the next step, GO or GO_ALL."""
        available = self._health.available()
        may_run = {pe: self._may_run(pe, current) for pe in available}
        strangers = {pe for pe, known in may_run.items() if known is None and pe in self._epochs.wired}
        exclusive = self._exclusion.must_break(epoch.placed, available) | strangers
        known = {pe: configurations or () for pe, configurations in may_run.items()}
        return set(self._transitions.must_break(known, epoch.configuration, epoch.plan.now, exclusive))

    def _may_run(self, pe: str, current: Epoch | None) -> list[Configuration] | None:
        """Return the configurations that a PE may be running: the one in its last state, and that of `current`.

        The list is empty if the last state of the PE says that it runs nothing. None: the configuration in the last
        state is not known.

        current: the current epoch, to which the PE may have changed since its last state; None: there is none.
        """
        seen = self._observed.of[pe]
        if seen.state is PeState.UNCONFIGURED:
            return []
        known = self._epochs.known(seen.epoch)
        if known is None or known.compiled.digest != seen.digest:
            return None
        late = [current.configuration] if current is not None and current is not known else []
        return [known.configuration, *late]

    def _free(self, epoch: Epoch) -> None:
        """Note in the epoch until when unavailable PEs may still drive outputs that this epoch gives to other PEs."""
        if epoch.stage in (Stage.DONE, Stage.GOING):
            return
        available, now_ns = self._health.available(), self._turn.now_ns
        epoch.identifiers_free_ns = self._exclusion.identifiers_free_ns(epoch.placed, available, now_ns)
        epoch.demux_free_ns = self._exclusion.demux_free_ns(epoch.placed, available, now_ns)

    def _emit_step(self, epoch: Epoch) -> None:
        waiting = tuple(sorted(epoch.must_break)) if epoch.stage is Stage.BREAKING else ()
        self._turn.emit(events.EpochStep, epoch=epoch.epoch, step=epoch.step.name, waiting_for=waiting)

    def _emit_reconfigured(self, epoch: Epoch) -> None:
        times, now_ns = epoch.times, self._turn.now_ns
        change = module_changes(self._before, epoch.configuration)
        staged_ns = times.staged_ns or now_ns
        first = min(epoch.causes, key=lambda cause: cause.known_ns)
        self._turn.emit(
            events.Reconfigured,
            epoch=epoch.epoch,
            causes=tuple(cause.what for cause in epoch.causes),
            times_ns=events.Times(
                detect=first.known_ns - first.since_ns,
                decide=times.prepared_ns - first.known_ns,
                distribute=staged_ns - times.prepared_ns,
                activate=now_ns - staged_ns,
            ),
            moved=change.moved,
            started=change.started,
            stopped=change.stopped,
        )
