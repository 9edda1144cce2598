"""Requests for plans: one counts at a time, the latest, and the causes of it are kept.

    idle      no answer is awaited
    waiting   RequestPlan is out; PlanReady or PlanFailed with its number ends that, any older number is dropped
    again     the planner has failed: the same request is made again after PLAN_AGAIN_NS, or before that if the
              situation changes; until then what runs goes on

*In the background.* A plan that was made immediately may not be the best. Once it runs everywhere and nothing else is
under way, the best plan is requested, with what runs now as what to keep to; so the answer can be compared, and there
is one request only for each situation. The plan is taken if it is better at levels 1 to 3 of the objective. Those rank
above the number of changes (level 4): they are worth interrupting a module for, and what ranks below is not. After a
failure there is no second request. No plan is swapped while it is being deployed: that would restart a half-done
change, for a plan that did not know of it.

An answer that never comes blocks nothing: the next change of the situation leads to a new request. An answer that comes
twice is dropped.

*Causes* are kept from the moment they are known until the epoch that takes them into account runs everywhere. A restart
forgets them: what is wrong then is found out again. A mastership that begins while every PE is held down makes a
request without a cause; the mastership itself is then the cause. So a reader of the events never meets a change without
one.
"""

from heronry_dg.objective import Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager.core.reconfiguration import Cause
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan
from heronry_wire.protocol_times import PLAN_AGAIN_NS

_IN_BACKGROUND = "a better plan"  # cause of what follows from a request in the background
_FIRST = "a mastership begins"  # and no PE is available: else a PE that joined is the cause
_ABOVE_CHANGES = 6  # integers of `Objective.key`: levels 1 to 3


class Planning:
    """The one request for a plan that counts."""

    def __init__(self, turn: Turn) -> None:
        self._turn = turn
        self._request = 0
        self.waiting = False
        self.in_background = False  # whether the last request was
        self.again_ns: int | None = None
        self.causes: list[Cause] = []  # of the reconfiguration that is not done yet

    def ask(self, now: Situation, running: Placement | None, *, in_background: bool = False) -> None:
        """Request a plan for this situation."""
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
        """Tell whether a plan is awaited, or will be requested again."""
        return self.waiting or self.again_ns is not None

    @property
    def idle(self) -> bool:
        """Tell whether no plan is owed, and no change is on its way."""
        return not self.is_owed and not self.causes

    def is_due_again(self) -> bool:
        """Tell whether it is time to make a failed request again."""
        return self.again_ns is not None and self._turn.now_ns >= self.again_ns

    def failed(self, answer: PlanFailed) -> bool:
        """Tell whether the request that counts has failed; one in the background is given up by that."""
        if answer.request != self._request or not self.waiting:
            return False
        self.waiting, self.again_ns = False, None if self.in_background else self._turn.now_ns + PLAN_AGAIN_NS
        self._turn.emit("plan_failed", request=answer.request, reason=answer.reason)
        return True

    def awaits(self, answer: PlanReady) -> bool:
        """Tell whether a plan answers the request that counts; it does so once."""
        return answer.request == self._request and self.waiting

    def takes(self, answer: PlanReady) -> None:
        """Take this plan: its request is answered."""
        self.waiting = False
        decide_ns = self._turn.now_ns - self.causes[-1].known_ns if self.causes else 0
        self._turn.emit("plan_ready", request=answer.request, plan=answer.plan.document(), decide_ns=decide_ns)

    def keeps_to(self, running: Plan | None, answer: PlanReady) -> bool:
        """Tell whether a plan is not good enough to take the place of what runs; then the request is settled."""
        if running is None or not self.in_background or _is_better(answer.plan, running):
            return False
        self.waiting = False
        self.causes.clear()
        self._turn.emit("plan_kept", request=answer.request)
        return True

    def ask_in_background(self, now: Situation, running: Placement) -> None:
        """Request the best plan, in place of one that was made immediately and runs now."""
        self.causes.append(Cause(_IN_BACKGROUND, self._turn.now_ns, self._turn.now_ns))
        self.ask(now, running, in_background=True)

    def forget(self) -> None:
        """Drop what is awaited and its causes: another manager plans now."""
        self.waiting, self.again_ns, self.in_background = False, None, False
        self.causes.clear()

    def done(self, causes: tuple[Cause, ...]) -> None:
        """Drop these causes: what runs now takes them into account."""
        self.causes = [cause for cause in self.causes if cause not in causes]


def _is_better(plan: Plan, running: Plan) -> bool:
    return plan.objective.key()[:_ABOVE_CHANGES] > running.objective.key()[:_ABOVE_CHANGES]
