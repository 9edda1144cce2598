"""What a manager that only advises reports: what it would do, and what it has seen another manager do.

    advised    a plan was made that is not what runs: `advice` has told what deploying it would change
    adopted    the PEs are seen to run what was advised, or was overheard (`following`): that runs now
    unknown    the PEs run anything else: then nothing is known to run, and nothing is advised

A PE that reports what is known to run changes nothing; a state that is late or lost is made up for by the next one.
"""

from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager.core.deployment import Deployment
from heronry_manager.core.epochs import module_changes
from heronry_manager.core.health import Health
from heronry_manager.core.memory import Runs
from heronry_manager.core.turn import Turn


class Advice:
    """Emits events, and commands nothing."""

    def __init__(self, turn: Turn, health: Health, deployment: Deployment) -> None:
        self._turn, self._health, self._deployment = turn, health, deployment
        self._advised: tuple[Plan, int] | None = None  # what was advised last, and its digest

    def advise(self, plan: Plan, unknown: int | None, overheard: Runs | None) -> None:
        """Emit what deploying this plan would change, and deploy nothing; report an `unknown` epoch where one runs.

        An overheard epoch that does not run everywhere yet is not reported: `follow` will see it.
        """
        self._advised = plan, self._deployment.epochs.compiled(plan.configuration).digest
        if unknown is None:
            current = self._deployment.current
            before = None if current is None else current.configuration
            change = module_changes(before, plan.configuration)
            self._turn.emit(
                "advice",
                plan=plan.document(),
                moved=change.moved,
                started=change.started,
                stopped=change.stopped,
            )
        elif overheard is None or overheard.epoch != unknown:
            self._turn.emit("unknown_epoch", epoch=unknown)

    def follow(self, now: Situation, overheard: Runs | None) -> bool:
        """Compare what the PEs run with what is known; tells whether it has just become known what runs.

        What was advised or overheard can become known; as long as the PEs run anything else, nothing is known to run.
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
