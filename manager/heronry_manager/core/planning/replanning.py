"""From a changed situation to a running configuration: a plan is requested, becomes an epoch, and is deployed.

    a change      an epoch that is being prepared is abandoned, and a plan is requested: immediately, or once this
                  manager has listened and the start-up window has closed. A standby manager requests nothing
    a plan        that runs already changes nothing; any other plan opens an epoch (`deployment`)
    a script      of the operator names a configuration, its target (`held_script`). The target is deployed in
                  place of the plan unless it is worse than the plan at level 1
    an epoch      that is completed drops its causes. If nothing else is under way, the optimal plan is requested
                  in the background, or the core reports that the configuration has settled (`Settled`)
    a storm       of changes: they are gathered, and what is under way is finished first where possible (`storms`)

Three things stay apart: the plan is desired; `Deployment.current`, the last epoch whose ACTIVATE was sent, is
commanded; only state frames show what a PE runs.

A fault while an epoch is being prepared ends that epoch. A fault after the first ACTIVATE does not end the epoch:
LEASE goes on repeating its step until the next epoch is ready to replace it.

*What runs already.* After a restart or a take-over, PEs go on with the configuration that they run:

- The manager knows this configuration: it adopts it. If the configuration may stay as it is, the manager requests
  the optimal plan in the background; if not, it requests an immediate plan.
- The manager does not know this configuration: it requests a plan. The result may be the configuration that runs.

*Advising.* An advising manager, one that only advises, plans as if it were active, and reports what it would do
(`advice`). When the PEs run an advised plan, the advising manager adopts this plan. While another manager is active,
the advising manager follows what the active manager announces and activates, as a standby manager does (`following`).
If the PEs run a configuration that the advising manager has neither overheard nor advised, it reports the unknown
epoch, and advises nothing.

`requests` drops answers that are late or doubled, and repeats a request after the planner has failed.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.objective import CRITICAL_CLASSES
from heronry_dg.plan import Plan
from heronry_dg.verify import verify
from heronry_manager import events
from heronry_manager.core.epochs import Cause
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.mastership import Claim, Mastership
from heronry_manager.core.planning.requests import PlanRequests
from heronry_manager.core.planning.storms import Storms
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.situation import LimitChanged, PlanInTime, PlanNeeded
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, Settled


class Replanning:
    """Requests a plan when the situation has changed, and deploys it."""

    def __init__(
        self, settings: ManagerSettings, turn: Turn, claim: Claim, known: Knowledge, requests: PlanRequests
    ) -> None:
        self._settings, self._turn = settings, turn
        self._claim, self._known, self._requests = claim, known, requests
        self._health, self._situation, self._deployment = known.health, known.situation, known.deployment
        self._following, self._advice, self._script = known.following, known.advice, known.script
        self._storms = Storms(settings.spec, turn)
        self._is_held = False  # a plan is needed once no PE flies with another table

    # The situation has changed

    def need(self, change: PlanNeeded) -> None:
        """Abandon the epoch that is being prepared, and request a new plan as soon as possible.

        In a storm of changes, the request or epoch that is under way may be finished first; the change is then
        kept for the next request. No effect if this manager stands by.
        """
        if self._claim.state is Mastership.STANDBY or self._deployment.is_switching():
            return
        now_ns = self._turn.now_ns
        since_ns = now_ns if change.since_ns is None else change.since_ns
        self._script.situation_changed(self._situation.now(), change.cause)
        cause = Cause(change.cause, now_ns, since_ns)
        if self._finishes_first():
            self._requests.gather(cause)
            return
        self._requests.add_cause(cause)
        if self._deployment.next is not None or self._requests.waiting:
            self._storms.ended_one()
        self._deployment.abandon(change.cause)
        if self._claim.state is not Mastership.LISTENING and not self._health.starting():
            self.request()

    def need_in_time(self, change: PlanInTime) -> None:
        """Request the best plan, while what runs runs on; where there is no time for that, as `need`.

        So nothing that the best plan keeps is lost in between, as it might be with an immediate plan. If the situation
        changes before the plan has come, an immediate plan is requested.
        """
        running = self._deployment.running
        if self._settings.advise or running is None or self._deployment.is_held() or self._requests.gathered:
            self.need(PlanNeeded(change.cause))
            return
        now, now_ns = self._situation.now(), self._turn.now_ns
        self._script.situation_changed(now, change.cause)
        self._requests.add_cause(Cause(change.cause, now_ns, now_ns))
        self._requests.request_with_time(now, running)

    def _finishes_first(self) -> bool:
        """Tell whether a new change must wait until the present request or epoch is finished.

        This is so only during a storm (see storms.py), and only in two cases: an epoch is being prepared, and its
        configuration may still be deployed; or no epoch is being prepared, and a plan is awaited.
        """
        if not self._storms.rages:
            return False
        opened = self._deployment.next
        return self._requests.waiting if opened is None else self._may_finish(opened.configuration)

    def _may_finish(self, wanted: Configuration) -> bool:
        return self._storms.may_finish(self._situation.now(), wanted, self._deployment.configuration)

    def forget(self) -> None:
        """Drop the present request and all causes, since this manager no longer plans."""
        self._requests.forget()

    @property
    def is_waiting(self) -> bool:
        """Tell whether the planner owes an answer."""
        return self._requests.waiting

    @property
    def is_urgent(self) -> bool:
        """Tell whether an immediate plan is awaited, or will be requested again."""
        requests = self._requests
        return requests.is_owed and not requests.in_background and not requests.has_time

    @property
    def again_ns(self) -> int | None:
        """Time (ns) at which to call `tick`, because a failed request is repeated then; None: none has failed."""
        return self._requests.again_ns

    def limit(self, change: LimitChanged) -> None:
        """React to a changed limit of a radio.

        Keep the running plan if it is still the best one and nothing is under way. In all other cases request a plan.
        """
        plan = self._deployment.plan
        if plan is not None and self._requests.idle and self._situation.spares(plan):
            self._settle()
        else:
            self.need(PlanNeeded(change.cause))

    def need_higher_epoch(self, pe: str) -> None:
        """Request a plan, which brings a newer epoch, if the PE `pe` runs a newer epoch than this manager has opened.

        Do nothing if this manager is not active, while an answer of the planner is awaited, or while a failed
        request waits to be repeated. See *overtaken* in `deployment`.
        """
        is_active = self._claim.state is Mastership.ACTIVE
        if is_active and not self._requests.is_owed and self._deployment.is_overtaken_by(pe):
            self.need(PlanNeeded(f"pe:{pe}: it runs a newer epoch"))

    def take_over(self, cause: Cause) -> None:
        """Request the first plan after a take-over from another manager; `cause` becomes the cause of the request."""
        self._requests.add_cause(cause)
        if not self._health.starting():
            self.request()

    # Scripts of the operator

    def fly(self, target: Configuration) -> None:
        """Request the best plan in the background, to compare it with `target`, which a script orders.

        When the plan has come, `ready` compares them: `target` is deployed unless it is worse than the plan at level 1.
        """
        running = self._deployment.running
        assert running is not None, "a script is refused while nothing runs"
        self._script.order(target)
        self._requests.request_to_compare(target, self._situation.now(), running)

    def release(self) -> None:
        """Request the best plan as soon as nothing is under way, since the operator has ended a script."""
        if self._requests.idle:
            self._settle()

    # Plans

    def request(self) -> None:
        """Request a plan.

        Before the first request of a term: if the PEs run the configuration that is remembered or was overheard, adopt
        it instead.
        """
        is_first = self._claim.commands()
        runs = self._following.runs if self._settings.advise else self._turn.memory.runs
        if is_first and self._deployment.adopts_remembered(self._situation.now(), runs):
            self._weigh()
        else:
            self._request()

    def _request(self) -> None:
        if self._deployment.is_held():
            self._is_held = True
            return
        self._is_held = False
        self._requests.request(self._situation.now(), self._deployment.running, target=self._script.target)

    def tick(self) -> None:
        """Request a plan if the start-up window has just closed, or a failed request is due again."""
        is_first = self._claim.state is Mastership.STARTING and not self._health.starting()
        is_free = self._is_held and not self._deployment.is_held()
        if is_first or is_free or self._requests.is_due_again():
            self.request()

    def ready(self, answer: PlanReady) -> None:
        """Deploy a plan from the planner; a manager that only advises reports it as advice.

        There are three exceptions:

        - Changes were gathered in a storm, and the plan does not suit the new situation: a new plan is requested.
        - The plan was requested in the background, and is not better than the running plan: it is dropped.
        - The PEs run the plan already: it is dropped.
        """
        deployment = self._deployment
        if not self._requests.awaits(answer) or self._deployment.is_switching():
            return
        if self._requests.gathered and not self._may_finish(answer.plan.configuration):
            self._request()
            return
        answer = self._weighed(answer)
        if self._requests.keeps_to(deployment.plan, answer):
            self._settle()
            return
        self._requests.takes(answer)
        if self._settings.advise:
            self._following.planned(answer.plan)
        if self._runs_already(answer.plan):
            self._requests.drop_causes()
            self._turn.emit(events.PlanUnchanged, request=answer.request)
            self._storms.over()
            self._settle()
        elif self._settings.advise:
            self._advice.advise(answer.plan, self._known.unknown_epoch(), self._following.runs)
            self._requests.drop_causes()
        else:
            deployment.prepare(answer.plan, self._requests.causes)

    def _weighed(self, answer: PlanReady) -> PlanReady:
        """Return the answer to deploy: the given one, or one whose plan is the configuration of a script.

        A script that the operator has just ordered is tried first, then the held script: its configuration is
        taken unless it is worse at level 1 than the plan in `answer`. If none is taken, `answer` is returned.
        """
        script, deployment = self._script, self._deployment
        was_ordered = script.is_ordered
        plan = script.weigh(answer.plan, self._situation.now(), deployment.running)
        if was_ordered and plan is not None and plan.configuration == script.target:
            self._requests.target_taken()
        elif was_ordered:
            self._requests.target_refused()
        return answer if plan is None else PlanReady(answer.request, plan)

    def failed(self, answer: PlanFailed) -> None:
        """Note that the planner could not answer; a request is repeated unless it was made in the background."""
        if self._requests.failed(answer) and self._requests.in_background:
            if self._script.is_ordered:
                self._script.refuse(
                    f"the planner gave no plan with which to compare the result of the script: {answer.reason}"
                )
            self._requests.drop_causes()
            self._settle()

    def _runs_already(self, plan: Plan) -> bool:
        """Tell whether the PEs run this plan already, even if it was deployed in another term."""
        deployment = self._deployment
        may_adopt = deployment.current is None or self._settings.advise
        return deployment.runs(plan) or (may_adopt and deployment.adopts(plan))

    # What runs

    def advance(self) -> None:
        """Command the next step of each epoch for which nothing is left to wait for.

        If an epoch is completed, drop its causes, and decide what to request next (`_settle`). If the epoch that
        was being prepared has been activated, tell `storms`: a storm of changes ends with an activation.
        """
        was_next = self._deployment.next
        done = self._deployment.advance()
        if was_next is not None and self._deployment.next is None:
            self._storms.over()
        if done is not None:
            self._requests.done(done.causes)
            self._settle()

    def look_at_what_runs(self) -> None:
        """In a manager that only advises: find out whether the PEs run a configuration that was advised or overheard.

        If such a configuration has just become known as the running one, decide whether it may stay (`_weigh`).
        """
        is_active = self._claim.state is Mastership.ACTIVE
        if is_active and self._advice.follow(self._situation.now(), self._following.runs):
            self._requests.add_cause(Cause("another epoch runs", self._turn.now_ns, self._turn.now_ns))
            self._weigh()

    def _weigh(self) -> None:
        """Decide whether the PEs keep the configuration that has become known to run.

        They keep it if it may stay (`_may_stay`) and no plan is awaited. Otherwise a plan is requested.
        """
        if self._may_stay() and not self._requests.waiting:
            self._requests.drop_causes()
            self._settle()
        else:
            self._request()

    def _may_stay(self) -> bool:
        """Tell whether the running configuration may stay.

        It may if it is legal, serves all critical functions that are wanted, and is run by every available PE.
        Besides, none of its modules may have been stopped by a fault that the operator has cleared.
        """
        spec, situation, deployment = self._settings.spec, self._situation, self._deployment
        plan, now = deployment.plan, situation.now()
        if plan is None or not deployment.all_available_run_it():
            return False
        functions = spec.functions.values()
        wanted = sum(now.priority_of(f) for f in functions if f.criticality_in(now.phase) in CRITICAL_CLASSES)
        if sum(plan.objective.critical) < wanted:
            return False
        return not verify(spec, now, plan.configuration)

    def _settle(self) -> None:
        """Decide what to request next, if there is a current epoch, none is being prepared and no plan is awaited.

        - If changes were gathered, request a plan for them.
        - Else request the optimal plan in the background, unless the running plan is optimal, a script is held,
            or the last request was already one in the background.
        - In these three cases, report that the plan has settled.
        """
        deployment = self._deployment
        running, plan = deployment.running, deployment.plan
        if running is None or deployment.next is not None or self._requests.waiting:
            return
        if self._requests.gathered:
            self.request()
            return
        now = self._situation.now()
        may_improve = plan is not None and not plan.optimal and self._script.target is None
        if may_improve and not self._requests.in_background:
            self._requests.request_in_background(now, running)
        else:
            self._turn.do(Settled(now, running))
