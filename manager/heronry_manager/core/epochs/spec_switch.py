"""The epoch by which all PEs change to another spec: the stages of `epoch`, and what differs from other epochs.

    PREPARING   each available PE stages a slice of the table that is beside its own. If a PE cannot, or if anything
                else is to be commanded first, the epoch is given up: the old spec flies on
    BREAKING    every PE has to report BROKEN, not only those that give up something exclusive: from then on no PE
                takes an identifier for what it was in the old spec. If a PE is lost meanwhile, GO waits until it has
                certainly stopped driving what is exclusive
    GOING       every PE has to report ACTIVE
    DONE        all PEs fly by the other spec. This manager, which does not know it, commands nothing any more: the
                driver begins a core of the other spec, which adopts what runs

Once it is activated, nothing of the old spec is commanded (`Deployment.is_switching`), and no fault that a PE reports
is taken in: its indices may be those of the other spec. The PE repeats it until the next manager acknowledges it.

A restart of the manager in the midst of it begins with the spec of its command line: the PEs have both tables, so it
can take all of them to the one or to the other, and they run what they ran until then.
"""

from heronry_manager import events
from heronry_manager.core.epochs.epoch import Epoch, Stage
from heronry_manager.core.turn import Turn
from heronry_wire.management import Lease
from heronry_wire.protocol_times import LEASE_PERIODS
from heronry_wire.state_frames import Reason, StatePage0, StatePage1

_GOES_ON = frozenset((Reason.NONE, Reason.STALE_TERM, Reason.INCOMPLETE, Reason.STALE_EPOCH))


class SpecSwitch:
    """One epoch of another spec on its way."""

    def __init__(self, turn: Turn, epoch: Epoch) -> None:
        """Begin with an epoch that is being prepared."""
        self._turn, self.epoch = turn, epoch
        self.refusal: str | None = None  # why it was given up, or is to be
        self.lacks_table: str | None = None  # a PE that cannot stage since the table beside is not there yet
        self._nodes = {one.pe: one for one in epoch.participants}
        self._free_ns = 0  # when a PE that was lost has certainly stopped driving what is exclusive
        turn.emit(
            events.EpochPrepared,
            epoch=epoch.epoch,
            digest=f"{epoch.compiled.digest:06X}",
            contingency=0,
            pes=tuple(self._nodes),
            bytes=sum(len(epoch.compiled.slices[one.node]) for one in epoch.participants),
        )

    @property
    def is_activated(self) -> bool:
        """Tell whether a PE may have taken a step of it, so that there is no way back."""
        return self.epoch.stage not in (Stage.PREPARING, Stage.ABANDONED)

    @property
    def is_done(self) -> bool:
        """Tell whether all PEs fly by the other spec."""
        return self.epoch.stage is Stage.DONE

    def lease(self) -> Lease:
        """Return the LEASE that repeats its step."""
        return Lease(self._turn.term, self.epoch.epoch, self.epoch.step, self.epoch.compiled.digest)

    def runs(self, pe: str, page: StatePage0) -> bool:
        """Note which step a PE has taken; tells whether the page 0 of the PE is of this epoch."""
        if not self.is_activated or (page.epoch, page.digest) != (self.epoch.epoch, self.epoch.compiled.digest):
            return False
        self.epoch.reported(pe, page.state, self._turn.now_ns)
        return True

    def staging(self, pe: str, page: StatePage1) -> bool:
        """Note how far a PE has staged it; tells whether the page 1 of the PE is of this epoch."""
        if page.staged_epoch != self.epoch.epoch:
            return False
        has_staged = page.staged_digest == self.epoch.compiled.digest and page.reason in _GOES_ON
        wants_body = page.reason is Reason.INCOMPLETE
        self.epoch.staged(pe, has_staged=has_staged, wants_body=wants_body, now_ns=self._turn.now_ns)
        if page.reason not in _GOES_ON and not self.is_activated and self.refusal is None:
            self._turn.emit(events.PeRefused, pe=pe, epoch=self.epoch.epoch, reason=page.reason.name)
            self.lacks_table = pe if page.reason is Reason.DIGEST else None
            self.refusal = f"pe:{pe} cannot stage its slice of it: {page.reason.name}"
        return True

    def lost(self, pe: str) -> None:
        """Wait for a PE no longer; GO waits until the PE has certainly stopped."""
        self.epoch.drop(pe)
        one = self._nodes.get(pe)
        if one is not None and self.is_activated:
            self._free_ns = max(self._free_ns, self._turn.now_ns + 2 * LEASE_PERIODS * one.period_ns)

    def give_up(self, reason: str) -> None:
        """End it before its first step; the old spec flies on."""
        self.refusal = reason
        self.epoch.abandon()
        self._turn.emit(events.EpochAbandoned, epoch=self.epoch.epoch, reason=reason)

    def advance(self) -> None:
        """Command its next step, if nothing is left to wait for."""
        epoch, now_ns, before = self.epoch, self._turn.now_ns, self.epoch.stage
        if before is Stage.PREPARING and self.refusal is None and all(epoch.has_staged(pe) for pe in self._nodes):
            epoch.activate(set(self._nodes), now_ns)
        elif before is Stage.BREAKING and epoch.all_broken() and now_ns >= self._free_ns:
            epoch.go(now_ns)
        elif before is Stage.GOING and epoch.all_active():
            epoch.finish()
        if epoch.stage is not before and not self.is_done:
            waiting = tuple(sorted(epoch.must_break)) if epoch.stage is Stage.BREAKING else ()
            self._turn.emit(events.EpochStep, epoch=epoch.epoch, step=epoch.step.name, waiting_for=waiting)
