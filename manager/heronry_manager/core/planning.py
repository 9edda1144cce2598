"""Plans asked for: one question at a time counts, the latest, and why it was asked.

    idle      nothing is awaited
    waiting   RequestPlan is out; PlanReady or PlanFailed with its number ends that, any older number is dropped
    again     the planner has failed: the same is asked again after PLAN_AGAIN_NS, or before that if the situation
              changes; until then what runs goes on

*At leisure.* A plan that was made at once may not be the best. Once it runs everywhere and nothing else is under way,
the best one is asked for, with what runs now as what to keep to; so the answer can be compared, and asked once only for
each situation. It is taken if it is better at levels 1 to 3 of the objective. Those rank above the number of changes
(level 4): they are worth interrupting a module for, and what ranks below is not. A failure to answer is left at that.
No plan is swapped while it is being deployed: that would begin anew what is half done, for a plan that did not know.

An answer that never comes blocks nothing: the next change of the situation asks anew. One that comes twice is dropped.

*Causes* are kept from the moment they are known until the epoch that takes them into account runs everywhere. A restart
forgets them: what is wrong then is found out again. A question without one, which a reign asks that begins while
everybody is held down, has that as its cause: a reader of the events never meets a change that nothing has brought
about.
"""

from heronry_dg.objective import Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager.core.reconfiguration import Cause
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan
from heronry_wire.protocol_times import PLAN_AGAIN_NS

_IN_BACKGROUND = "a better plan"  # cause of what follows from being asked at leisure
_FIRST = "a reign begins"  # and finds nobody to command: whoever is there has caused it
_ABOVE_CHANGES = 6  # integers of `Objective.key`: levels 1 to 3


class Planning:
    """The question to the planner that counts."""

    def __init__(self, turn: Turn) -> None:
        self._turn = turn
        self._request = 0
        self.waiting = False
        self.in_background = False  # the last question was
        self.again_ns: int | None = None
        self.causes: list[Cause] = []  # of the reconfiguration that is not done yet

    def ask(self, now: Situation, running: Placement | None, *, in_background: bool = False) -> None:
        """Ask for a plan in this situation."""
        if not in_background:
            self.causes = [cause for cause in self.causes if cause.what != _IN_BACKGROUND]
        if not self.causes:
            self.causes.append(Cause(_FIRST, self._turn.now_ns, self._turn.now_ns))
        self._request += 1
        self.waiting, self.again_ns, self.in_background = True, None, in_background
        self._turn.ask(RequestPlan(self._request, now, running, in_background))
        self._turn.emit(
            "plan_requested",
            request=self._request,
            down=sorted(now.down),
            limits={element: f"{float(100 * share):g}%" for element, share in sorted(now.limits.items())},
            phase=now.phase,
            causes=[cause.what for cause in self.causes],
        )

    @property
    def is_owed(self) -> bool:
        """Tell whether a plan is awaited, or will be asked for again."""
        return self.waiting or self.again_ns is not None

    @property
    def idle(self) -> bool:
        """Tell whether nothing is owed or on its way."""
        return not self.is_owed and not self.causes

    def is_due_again(self) -> bool:
        """Tell whether it is time to ask again."""
        return self.again_ns is not None and self._turn.now_ns >= self.again_ns

    def failed(self, answer: PlanFailed) -> bool:
        """Tell whether the question that counts has found no answer; what was asked at leisure is given up."""
        if answer.request != self._request or not self.waiting:
            return False
        self.waiting, self.again_ns = False, None if self.in_background else self._turn.now_ns + PLAN_AGAIN_NS
        self._turn.emit("plan_failed", request=answer.request, reason=answer.reason)
        return True

    def awaits(self, answer: PlanReady) -> bool:
        """Tell whether a plan answers the question that counts; it does so once."""
        return answer.request == self._request and self.waiting

    def takes(self, answer: PlanReady) -> None:
        """This plan it is."""
        self.waiting = False
        decide_ns = self._turn.now_ns - self.causes[-1].known_ns if self.causes else 0
        self._turn.emit("plan_ready", request=answer.request, plan=answer.plan.document(), decide_ns=decide_ns)

    def keeps_to(self, running: Plan | None, answer: PlanReady) -> bool:
        """Tell whether a plan is not good enough to take the place of what runs; then that is settled."""
        if running is None or not self.in_background or _is_better(answer.plan, running):
            return False
        self.waiting = False
        self.causes.clear()
        self._turn.emit("plan_kept", request=answer.request)
        return True

    def ask_in_background(self, now: Situation, running: Placement) -> None:
        """Ask for the best plan, in place of one that was made at once and runs now."""
        self.causes.append(Cause(_IN_BACKGROUND, self._turn.now_ns, self._turn.now_ns))
        self.ask(now, running, in_background=True)

    def forget(self) -> None:
        """Nothing is awaited any more: somebody else plans now."""
        self.waiting, self.again_ns, self.in_background = False, None, False
        self.causes.clear()

    def done(self, causes: tuple[Cause, ...]) -> None:
        """These have been taken into account, by what runs now."""
        self.causes = [cause for cause in self.causes if cause not in causes]


def _is_better(plan: Plan, running: Plan) -> bool:
    return plan.objective.key()[:_ABOVE_CHANGES] > running.objective.key()[:_ABOVE_CHANGES]
