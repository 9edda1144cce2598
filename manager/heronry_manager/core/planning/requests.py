"""Requests for plans: only the latest request counts, and its causes are kept.

    idle      no answer is awaited
    waiting   RequestPlan was sent. PlanReady or PlanFailed with its number ends this state; an answer with an older
              number is dropped
    again     the planner has failed. The core repeats the request after PLAN_AGAIN_NS, or earlier if the situation
              changes. Until the next plan the running configuration goes on

*In the background.* An immediate plan may not be the best one. When it runs everywhere and nothing else is under way,
the core requests the optimal plan, with as few changes to the running configuration as possible. There is one such
request for each situation, and none after a failure of the planner. There is none either while a plan is being
deployed, since the answer could end a change that is half done.

The core takes the answer only if it is better at levels 1 to 3 of the objective. These levels rank above the number of
changes (level 4), so they justify that a module is interrupted. The lower levels do not.

A lost answer blocks nothing: the next change of the situation leads to a new request. An answer that comes twice is
dropped.

*Causes* are kept from the moment at which they are known until the epoch that takes them into account runs everywhere.
So every change in the events has a cause. A restart forgets the causes; the manager then finds the faults again. If a
mastership begins while every PE is held down, the cause of its first request is the mastership itself.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.objective import Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.core.epochs import Cause
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan
from heronry_wire.protocol_times import PLAN_AGAIN_NS

_IN_BACKGROUND = "a better plan"  # cause of an epoch that follows from a request in the background
_SCRIPT = "a script of the operator"
_FIRST = "a mastership begins"  # the cause if no PE is available; else a PE that joined is the cause
_ABOVE_CHANGES = 6  # integers of `Objective.key`: levels 1 to 3


class PlanRequests:
    """Keeps the present request for a plan, and the causes of the reconfiguration that is not done yet.

    It also keeps the causes that only the next request will take into account.
    """

    def __init__(self, turn: Turn) -> None:
        self._turn = turn
        self._number = 0
        self.waiting = False
        self.in_background = False  # whether the last request was one in the background
        self.has_time = False  # whether the present request is one for the best plan, which is deployed in any case
        self.again_ns: int | None = None
        self.causes: list[Cause] = []  # of the reconfiguration that is not done yet
        self.gathered: list[Cause] = []  # causes that the next request will take into account

    def request(
        self,
        now: Situation,
        running: Placement | None,
        *,
        in_background: bool = False,
        target: Configuration | None = None,
    ) -> None:
        """Request a plan for the situation `now`.

        running: the placement that runs now; None if none is known.
        in_background: request the optimal plan, however long it takes; otherwise an immediate plan.
        target: the configuration of the operator's script, with which the plan is compared; None if there is no script.
        """
        self.causes += self.gathered
        self.gathered.clear()
        if not in_background:
            self.causes = [cause for cause in self.causes if cause.what != _IN_BACKGROUND]
        if not self.causes:
            self.causes.append(Cause(_FIRST, self._turn.now_ns, self._turn.now_ns))
        self._number += 1
        self.waiting, self.again_ns, self.in_background = True, None, in_background
        self.has_time = False
        self._turn.do(RequestPlan(self._number, now, running, in_background, target))
        self._turn.emit(
            events.PlanRequested,
            request=self._number,
            down=tuple(sorted(now.down)),
            limits={element: f"{float(100 * share):g}%" for element, share in sorted(now.limits.items())},
            phase=now.phase,
            causes=tuple(cause.what for cause in self.causes),
        )

    def add_cause(self, cause: Cause) -> None:
        """Keep a cause of the present request, or of the next one if there is none."""
        self.causes.append(cause)

    def gather(self, cause: Cause) -> None:
        """Keep a cause for the next request only; a cause that is kept already is not added again."""
        if all(one.what != cause.what for one in self.gathered):
            self.gathered.append(cause)

    def drop_causes(self) -> None:
        """Drop all causes but those that are gathered for the next request."""
        self.causes.clear()

    @property
    def is_owed(self) -> bool:
        """Tell whether the manager waits for the planner's answer, or will repeat a request that failed."""
        return self.waiting or self.again_ns is not None

    @property
    def idle(self) -> bool:
        """Tell whether there is no plan to wait for and no change left to plan for.

        So no plan is awaited, no failed request will be repeated, and no cause of a request is kept.
        """
        return not self.is_owed and not self.causes and not self.gathered

    def is_due_again(self) -> bool:
        """Tell whether it is time to repeat a request that failed."""
        return self.again_ns is not None and self._turn.now_ns >= self.again_ns

    def failed(self, answer: PlanFailed) -> bool:
        """Note that the planner could not answer a request; tells whether this is the present request.

        The present request is repeated after PLAN_AGAIN_NS, except a background request, which is not repeated.
        """
        if answer.request != self._number or not self.waiting:
            return False
        self.waiting, self.again_ns = False, None if self.in_background else self._turn.now_ns + PLAN_AGAIN_NS
        self.has_time = False
        self._turn.emit(events.PlanFailed, request=answer.request, reason=answer.reason)
        return True

    def awaits(self, answer: PlanReady) -> bool:
        """Tell whether `answer` is the first answer to the present request."""
        return answer.request == self._number and self.waiting

    def takes(self, answer: PlanReady) -> None:
        """End the present request, because its answer is to be deployed."""
        self.waiting = False
        decide_ns = self._turn.now_ns - self.causes[-1].known_ns if self.causes else 0
        self._turn.emit(events.PlanReady, request=answer.request, plan=answer.plan.told(), decide_ns=decide_ns)

    def keeps_to(self, running: Plan | None, answer: PlanReady) -> bool:
        """Tell whether the running plan stays, and the answer to a background request is dropped.

        This is so if a plan runs, and the plan of the answer is not better at levels 1 to 3. Then the request
        ends, and its causes are dropped.
        """
        if running is None or not self.in_background or _is_better(answer.plan, running):
            return False
        self.waiting = False
        self.causes.clear()
        self._turn.emit(events.PlanKept, request=answer.request)
        return True

    def request_in_background(self, now: Situation, running: Placement) -> None:
        """Request the optimal plan for this situation, which may replace the immediate plan that runs now."""
        self.causes.append(Cause(_IN_BACKGROUND, self._turn.now_ns, self._turn.now_ns))
        self.request(now, running, in_background=True)

    def request_with_time(self, now: Situation, running: Placement) -> None:
        """Request the best plan for this situation, for which what runs has to make room, but not at once.

        Unlike the answer to a background request, this answer is deployed even if it is worse than what runs. If the
        planner fails, the request is repeated as one for an immediate plan.
        """
        self.causes = [cause for cause in self.causes if cause.what != _IN_BACKGROUND]
        self.request(now, running, in_background=True)
        self.in_background, self.has_time = False, True

    def request_to_compare(self, target: Configuration, now: Situation, running: Placement) -> None:
        """Request the best plan for this situation, to compare it with the configuration of a script.

        target: the configuration of the script.
        running: what runs now.
        """
        self.causes = [Cause(_SCRIPT, self._turn.now_ns, self._turn.now_ns)]
        self.request(now, running, in_background=True, target=target)

    def target_taken(self) -> None:
        """Note that the configuration of a script is deployed: the optimal plan may be requested later."""
        self.in_background = False

    def target_refused(self) -> None:
        """Note that the script is refused: the plan made for comparison counts as one from a background request."""
        self.causes = [Cause(_IN_BACKGROUND, cause.known_ns, cause.since_ns) for cause in self.causes]

    def forget(self) -> None:
        """Drop the present request, its causes and the gathered causes, since this manager no longer plans."""
        self.waiting, self.again_ns, self.in_background, self.has_time = False, None, False, False
        self.causes.clear()
        self.gathered.clear()

    def done(self, causes: tuple[Cause, ...]) -> None:
        """Drop these causes, since the configuration that was planned because of them runs now."""
        self.causes = [cause for cause in self.causes if cause not in causes]


def _is_better(plan: Plan, running: Plan) -> bool:
    return plan.objective.key()[:_ABOVE_CHANGES] > running.objective.key()[:_ABOVE_CHANGES]
