"""The processes that plan, behind the planning policy: requests go to them, and their answers come back.

The planner's process is started before the flight; the pre-planner's with its first question.
`heronry_manager.core.planning_policy` decides which process gets which request.
"""

from collections.abc import Callable
from typing import Protocol

from heronry_dg.objective import Placement
from heronry_dg.situation import Situation
from heronry_manager.core.planning_policy import (
    Answer,
    AskPlanner,
    FromPlanner,
    Instruction,
    PlannerAnswered,
    PlanningPolicy,
    PrePlan,
    PrePlannerAnswered,
)
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan, Settled
from heronry_manager.planner.client import Failed, Planned


class PlannerLink(Protocol):
    """A planner that answers later: `heronry_manager.planner.client.PlannerClient`."""

    def request(self, number: int, now: Situation, running: Placement | None) -> None:
        """Request a plan for situation `now`; `poll` returns the answer, with this number."""

    def poll(self) -> list[Planned | Failed]:
        """Return the answers that have arrived, without waiting."""

    def fileno(self) -> int:
        """Give the descriptor that is readable when `poll` has something to do."""


class PlannerProcesses:
    """The policy, the planner, and the pre-planner once there is one."""

    def __init__(
        self, policy: PlanningPolicy, planner: PlannerLink | None, start_pre_planner: Callable[[], PlannerLink]
    ) -> None:
        """`planner`: None where there is no solver; the policy must know that, and starts no pre-planner."""
        self._policy, self._planner, self._start_pre_planner = policy, planner, start_pre_planner
        self._pre_planner: PlannerLink | None = None

    def readers(self) -> list[PlannerLink]:
        """Give what an event loop must watch: one of these is readable when `poll` has something to do."""
        return [one for one in (self._planner, self._pre_planner) if one is not None]

    def take(self, told: RequestPlan | Settled) -> list[PlanReady | PlanFailed]:
        """Hand a request or report of the core to the policy; returns an immediate answer, `poll` any later one."""
        return self._carry_out(self._policy.step(told))

    def poll(self) -> list[PlanReady | PlanFailed]:
        """Return the answers to the core's requests; the pre-planner's answers stay with the policy."""
        ahead = [] if self._pre_planner is None else self._pre_planner.poll()
        answers = [] if self._planner is None else self._planner.poll()
        events: list[FromPlanner] = [
            *(PrePlannerAnswered(one.request, one.plan if isinstance(one, Planned) else None) for one in ahead),
            *(PlannerAnswered(_in_the_cores_words(one)) for one in answers),
        ]
        return [answer for event in events for answer in self._carry_out(self._policy.step(event))]

    def _carry_out(self, instructions: list[Instruction]) -> list[PlanReady | PlanFailed]:
        answers = []
        for instruction in instructions:
            match instruction:
                case Answer(answer):
                    answers.append(answer)
                case AskPlanner(plan_request):
                    assert self._planner is not None  # else the policy knows that there is none
                    self._planner.request(plan_request.request, plan_request.now, plan_request.running)
                case PrePlan(number, question):  # pragma: no branch - nothing else is left
                    self._pre_planner = self._pre_planner or self._start_pre_planner()
                    self._pre_planner.request(number, question.now, question.running)
        return answers


def _in_the_cores_words(answer: Planned | Failed) -> PlanReady | PlanFailed:
    if isinstance(answer, Planned):
        return PlanReady(answer.request, answer.plan)
    return PlanFailed(answer.request, answer.reason)
