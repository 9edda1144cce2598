"""The reports of a manager that only advises: it commands no PE, and tells the operator what it would deploy.

    advised    a plan was made that differs from the running configuration; the event `advice` lists the changes
    adopted    the PEs run the advised configuration, or one that another manager was heard to activate (`following`):
               what runs is known
    unknown    the PEs run any other configuration: what runs is not known, and nothing is advised

If a state of a PE is late or lost, the next state of this PE replaces it. A state that reports the known configuration
changes nothing, so a doubled state has no effect.
"""

from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.core.epochs.deployment import Deployment
from heronry_manager.core.epochs.known_epochs import module_changes
from heronry_manager.core.membership import Health
from heronry_manager.core.memory import Runs
from heronry_manager.core.turn import Turn


class Advice:
    """Reports, as events, what a manager that only advises would deploy; this manager commands nothing."""

    def __init__(self, turn: Turn, health: Health, deployment: Deployment) -> None:
        self._turn, self._health, self._deployment = turn, health, deployment
        self.forget()

    def forget(self) -> None:
        """Forget what was advised."""
        self._advised: tuple[Plan, int] | None = None  # the last advised plan, and its digest

    def advise(self, plan: Plan, unknown: int | None, overheard: Runs | None) -> None:
        """Report the changes that deploying this plan would make.

        unknown: the epoch that the PEs run, whose configuration this manager does not know. Then the event
            reports this epoch, and no changes. None: what runs is known, or nothing runs.
        overheard: the configuration that another manager was heard to activate. If `unknown` is the epoch of this
            configuration, nothing is reported, since `follow` will adopt the epoch.
        """
        self._advised = plan, self._deployment.compiled_digest(plan.configuration)
        if unknown is None:
            change = module_changes(self._deployment.configuration, plan.configuration)
            self._turn.emit(
                events.Advice,
                plan=plan.told(),
                moved=change.moved,
                started=change.started,
                stopped=change.stopped,
            )
        elif overheard is None or overheard.epoch != unknown:
            self._turn.emit(events.UnknownEpoch, epoch=unknown)

    def follow(self, now: Situation, overheard: Runs | None) -> bool:
        """Find out whether the running configuration is known; True if it has just become known.

        An advised configuration becomes known when every available PE runs it. An overheard one becomes known
        when the available PEs that run anything run it. When no available PE runs the known configuration any
        more, what runs is no longer known.
        """
        deployment = self._deployment
        observed = (deployment.observed.of[pe] for pe in self._health.available())
        seen = {(one.epoch, one.digest) for one in observed}
        current = deployment.current
        if current is not None:
            if (current.epoch, current.compiled.digest) in seen:
                return False
            deployment.forget_current()
        if self._advised is not None and {digest for _, digest in seen} == {self._advised[1]}:
            plan, _ = self._advised
            if deployment.adopts(plan):
                self._advised = None
                return True
        is_seen = overheard is not None and (overheard.epoch, overheard.digest) in seen
        return is_seen and deployment.adopts_remembered(now, overheard)
