"""Adopting: the manager takes over a running configuration that it knows, without a new epoch.

For this, three conditions must be met; if one is not, the manager opens a new epoch:

- All available PEs that run anything are ACTIVE in one epoch.
- No PE was seen on a newer epoch.
- The manager knows the configuration with the digest of that epoch. There are three ways to know it: the
  manager remembers it (`memory`), has overheard it, or would deploy it now as its plan.

A plan is adopted only if every available PE runs it. A remembered or overheard configuration is adopted
even if a PE is missing or runs nothing; the manager then treats this PE as a fault.

At first the manager does not know which exclusive outputs a PE drives (`exclusion`):

    a silent PE         counts as holding the tokens that the adopted epoch places on it
    an available PE     may still start the configuration of another manager until it hears the new term. So
                        until then it counts as holding every token that could be placed on it
"""

from dataclasses import replace

from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.plan import Plan, make_plan
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.core.epochs.epoch import Epoch
from heronry_manager.core.epochs.known_epochs import Epochs
from heronry_manager.core.epochs.observation import Observations
from heronry_manager.core.membership import Exclusion, Health
from heronry_manager.core.memory import Runs
from heronry_manager.core.tables import CompiledConfiguration
from heronry_manager.core.turn import Turn
from heronry_wire.management import is_newer
from heronry_wire.state_frames import PeState


class Adoption:
    """Decides whether the running configuration may be adopted, and makes an epoch of it."""

    def __init__(
        self, turn: Turn, spec: Spec, health: Health, exclusion: Exclusion, observed: Observations, *, epochs: Epochs
    ) -> None:
        self._turn, self._spec, self._health, self._exclusion = turn, spec, health, exclusion
        self._observed, self._epochs = observed, epochs

    def of_plan(self, plan: Plan) -> Epoch | None:
        """Return the epoch that the PEs run, if every available PE runs exactly this plan.

        None if not, or if a silent PE may run a later epoch.
        """
        compiled = self._epochs.compiled(plan.configuration)
        seen = [self._observed.of[pe] for pe in self._health.available()]
        clean = all(one.digest == compiled.digest and one.state is PeState.ACTIVE for one in seen)
        runs, newest = self._turn.memory.runs, self._observed.newest_epoch()
        if runs is not None and is_newer(runs.epoch, newest):
            return None  # a silent PE was given a later epoch, and may run it
        if not clean or {one.epoch for one in seen} != {newest}:
            return None
        return self._adopted(newest, plan, compiled)

    def of_remembered(self, runs: Runs | None, now: Situation) -> Epoch | None:
        """Return the remembered or overheard epoch `runs` as one to adopt, if the PEs run this epoch; None if not.

        A PE that runs nothing, or is missing, does not prevent the adoption; such a PE is treated as a fault. The
        memory does not say which limits the radios had when the plan was made. So the plan counts as made for the
        limits in `now`.
        """
        if runs is None:
            return None
        configuration = self._epochs.decoded(runs)
        compiled = self._epochs.compiled(configuration)
        seen = [self._observed.of[pe] for pe in self._health.available()]
        inside = [one for one in seen if one.state is PeState.ACTIVE and one.epoch == runs.epoch]
        clean = all(one.digest == compiled.digest == runs.digest for one in inside)
        if not inside or not clean or any(one.state is not PeState.UNCONFIGURED and one not in inside for one in seen):
            return None
        if is_newer(self._observed.newest_epoch(), runs.epoch):
            return None
        intended = replace(now, down=frozenset())
        worth = score(self._spec, intended, configuration, None)
        plan = make_plan(self._spec, intended, configuration, worth, optimal=False)
        return self._adopted(runs.epoch, plan, compiled)

    def _adopted(self, epoch: int, plan: Plan, compiled: CompiledConfiguration) -> Epoch:
        adopted = self._epochs.running(epoch, plan, compiled)
        self._epochs.remember(adopted)
        self._exclusion.activated(adopted.placed)  # a missing PE may still hold its tokens
        for pe in self._health.available():
            self._exclusion.unknown(pe)  # before it hears this term it may start another manager's configuration
            if self._observed.of[pe].state is PeState.UNCONFIGURED:
                continue
            self._observed.of[pe].configured = True
            adopted.reported(pe, PeState.ACTIVE, self._turn.now_ns)
        self._turn.emit(events.Adopted, epoch=adopted.epoch, digest=f"{compiled.digest:06X}")
        return adopted
