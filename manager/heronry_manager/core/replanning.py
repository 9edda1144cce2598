"""From another situation to what runs: a plan is asked for, becomes an epoch, and the epoch becomes what runs.

    a change      what is being prepared is void (its number is abandoned), and a plan is asked for: at once, or, where
                  this manager listens or PEs may still be starting, once that is over. A standby manager asks nothing
    a plan        that is what runs already changes nothing; any other opens an epoch (`deployment`)
    an epoch      that is done has taken its causes into account. Then, with nothing under way, the best plan is asked
                  for in the background, or it is said that all has settled (`Settled`)

Desired, commanded and observed stay apart: a plan is desired; `Deployment.current` is the last epoch whose ACTIVATE
went out; only state frames write what a PE is seen to run.

A fault while an epoch is being prepared abandons its number. A fault after the first ACTIVATE leaves the epoch standing
(LEASE goes on repeating its step) until the next one is ready to take its place.

*What runs already.* After a restart, or a take-over, PEs go on with what they run. Where that is known it is adopted;
and where it can stay as it is, the best plan is asked for in the background, and anything else is a fault that has just
been found. Where it is not known, a plan is asked for, which may turn out to be what runs.

*Advising.* It plans as if it were active, tells what it would do (`advice`), and takes it for done where the PEs are
seen to do just that. Beside an active manager it takes in what that one holds and activates, as a standby does
(`following`). Where PEs run what it has not overheard, and would not plan either, it says so, and advises nothing.

Answers that are late or doubled are `planning`'s to drop; a planner that fails is asked again by it.
"""

from heronry_dg.objective import CRITICAL_CLASSES
from heronry_dg.plan import Plan
from heronry_dg.verify import verify
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.known_situation import LimitChanged, PlanNeeded
from heronry_manager.core.mastership import Claim, Mastership
from heronry_manager.core.planning import Planning
from heronry_manager.core.reconfiguration import Cause
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, Settled


class Replanning:
    """What becomes of a changed situation."""

    def __init__(
        self, settings: ManagerSettings, turn: Turn, claim: Claim, known: Knowledge, planning: Planning
    ) -> None:
        self._settings, self._turn = settings, turn
        self._claim, self._known, self.planning = claim, known, planning

    # The situation has changed

    def need(self, change: PlanNeeded) -> None:
        """What is being prepared is void, and a new plan is needed."""
        if self._claim.state is Mastership.STANDBY:
            return
        now_ns = self._turn.now_ns
        since_ns = now_ns if change.since_ns is None else change.since_ns
        self.planning.causes.append(Cause(change.cause, now_ns, since_ns))
        self._known.deployment.abandon(change.cause)
        if self._claim.state is not Mastership.LISTENING and not self._known.health.starting():
            self.ask()

    def limit(self, change: LimitChanged) -> None:
        """A radio has another limit: if what runs is as good as any under it, nothing is to be done."""
        plan = self._known.deployment.plan
        if plan is not None and self.planning.idle and self._known.situation.spares(plan):
            self._settle()
        else:
            self.need(PlanNeeded(change.cause))

    def need_higher_epoch(self, pe: str) -> None:
        """A PE that hears of a newer epoch than its own drives nothing exclusive (rule 6): it needs one above that."""
        is_reigning = self._claim.state is Mastership.ACTIVE
        if is_reigning and not self.planning.is_owed and self._known.deployment.is_overtaken_by(pe):
            self.need(PlanNeeded(f"pe:{pe}: it runs a newer epoch"))

    def take_over(self, cause: Cause) -> None:
        """A term begins where another manager has ended."""
        self.planning.causes.append(cause)
        if not self._known.health.starting():
            self.ask()

    # Plans

    def ask(self) -> None:
        """Ask for a plan; the first one of a term is not needed where what runs is known."""
        is_first = self._claim.commands()
        runs = self._known.following.runs if self._settings.advise else self._turn.memory.runs
        if is_first and self._known.deployment.adopts_remembered(self._known.situation.now(), runs):
            self._weigh()
        else:
            self._ask()

    def _ask(self) -> None:
        self.planning.ask(self._known.situation.now(), self._known.deployment.running)

    def tick(self) -> None:
        """Ask where the start-up window has just closed, or the planner has failed a while ago."""
        is_first = self._claim.state is Mastership.STARTING and not self._known.health.starting()
        if is_first or self.planning.is_due_again():
            self.ask()

    def ready(self, answer: PlanReady) -> None:
        """The planner has answered."""
        deployment = self._known.deployment
        if not self.planning.awaits(answer):
            return
        if self.planning.keeps_to(deployment.plan, answer):
            self._settle()
            return
        self.planning.takes(answer)
        if self._settings.advise:
            self._known.following.planned(answer.plan)
        if self._runs_already(answer.plan):
            self.planning.causes.clear()
            self._turn.emit("plan_unchanged", request=answer.request)
            self._settle()
        elif self._settings.advise:
            self._known.advice.advise(answer.plan, self._known.unknown_epoch(), self._known.following.runs)
            self.planning.causes.clear()
        else:
            deployment.prepare(answer.plan, self.planning.causes)

    def failed(self, answer: PlanFailed) -> None:
        """The planner could not answer."""
        if self.planning.failed(answer) and self.planning.in_background:
            self.planning.causes.clear()
            self._settle()

    def _runs_already(self, plan: Plan) -> bool:
        """Tell whether nothing has to be done for a plan; what another term has brought about may be just that."""
        deployment = self._known.deployment
        may_adopt = deployment.current is None or self._settings.advise
        return deployment.runs(plan) or (may_adopt and deployment.adopts(plan))

    # What runs

    def advance(self) -> None:
        """Move the epochs on; one that is done has taken its causes into account."""
        done = self._known.deployment.advance()
        if done is not None:
            self.planning.done(done.causes)
            self._settle()

    def look_at_what_runs(self) -> None:
        """When advising: see what another manager has brought about, and what is to be said of it."""
        known = self._known
        is_reigning = self._claim.state is Mastership.ACTIVE
        if is_reigning and known.advice.follow(known.situation.now(), known.following.runs):
            self.planning.causes.append(Cause("another epoch runs", self._turn.now_ns, self._turn.now_ns))
            self._weigh()

    def _weigh(self) -> None:
        """It has become known what runs: where that may stay, a better plan is asked for in the background."""
        if self._may_stay() and not self.planning.waiting:
            self.planning.causes.clear()
            self._settle()
        else:
            self._ask()

    def _may_stay(self) -> bool:
        """Tell whether what runs can go on as it is: legal, with all that is critical, and no PE waits outside."""
        spec, situation, deployment = self._settings.spec, self._known.situation, self._known.deployment
        plan, phase = deployment.plan, situation.phase
        if plan is None or not deployment.everybody_runs_it():
            return False
        functions = spec.functions.values()
        wanted = sum(f.priority_in(phase) for f in functions if f.criticality_in(phase) in CRITICAL_CLASSES)
        if sum(plan.objective.critical) < wanted:
            return False
        return not verify(spec, situation.now(), plan.configuration)

    def _settle(self) -> None:
        """Say that nothing is under way, if nothing is."""
        deployment = self._known.deployment
        running, plan = deployment.running, deployment.plan
        if running is None or deployment.next is not None or self.planning.waiting:
            return
        now = self._known.situation.now()
        if plan is not None and not plan.optimal and not self.planning.in_background:
            self.planning.ask_in_background(now, running)
        else:
            self._turn.ask(Settled(now, running))
