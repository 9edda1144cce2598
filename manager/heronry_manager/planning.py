"""Plans asked for: one question at a time counts, the latest, and why it was asked.

    idle      nothing is awaited
    waiting   RequestPlan is out; PlanReady or PlanFailed with its number ends that, any older number is dropped
    again     the planner has failed: the same is asked again after PLAN_AGAIN_NS, or before that if the situation
              changes; until then what runs goes on

An answer that never comes blocks nothing: the next change of the situation asks anew. One that comes twice is dropped.

*Causes* are kept from the moment they are known until the epoch that takes them into account runs everywhere. A restart
forgets them: what is wrong then is found out again.
"""

from heronry_dg.objective import Placement
from heronry_manager.reconfiguration import Cause
from heronry_manager.turn import Turn
from heronry_manager.vocabulary import PlanFailed, PlanReady, RequestPlan

PLAN_AGAIN_NS = 1_000_000_000


class Planning:
    """The question to the planner that counts."""

    def __init__(self, turn: Turn) -> None:
        self._turn = turn
        self._request = 0
        self.waiting = False
        self.again_ns: int | None = None
        self.causes: list[Cause] = []  # of the reconfiguration that is not done yet

    def ask(self, down: frozenset[str], phase: str | None, running: Placement | None) -> None:
        """Ask for the best plan in this situation."""
        self._request += 1
        self.waiting, self.again_ns = True, None
        self._turn.ask(RequestPlan(self._request, down, phase, running))
        self._turn.emit(
            "plan_requested",
            request=self._request,
            down=sorted(down),
            phase=phase,
            causes=[cause.what for cause in self.causes],
        )

    def is_due_again(self) -> bool:
        """Tell whether it is time to ask again."""
        return self.again_ns is not None and self._turn.now_ns >= self.again_ns

    def failed(self, answer: PlanFailed) -> None:
        """The planner could not answer."""
        if answer.request != self._request:
            return
        self.waiting, self.again_ns = False, self._turn.now_ns + PLAN_AGAIN_NS
        self._turn.emit("plan_failed", request=answer.request, reason=answer.reason)

    def takes(self, answer: PlanReady) -> bool:
        """Tell whether a plan answers the question that counts; it does so once."""
        if answer.request != self._request or not self.waiting:
            return False
        self.waiting = False
        decide_ns = self._turn.now_ns - self.causes[-1].known_ns if self.causes else 0
        self._turn.emit("plan_ready", request=answer.request, plan=answer.plan.document(), decide_ns=decide_ns)
        return True

    def done(self, causes: tuple[Cause, ...]) -> None:
        """These have been taken into account, by what runs now."""
        self.causes = [cause for cause in self.causes if cause not in causes]
