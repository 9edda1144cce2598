"""Runs the processes that plan: gives them the requests for plans, and takes their answers.

`heronry_manager.planning_policy` (the *policy*) decides which process gets which request. The planner's
process is started before the flight, the pre-planner's process with its first request.

Two measures save processor time while a device fails and recovers again and again:

- The policy learns that a configuration has settled only when no other request has come for `CALM_NS`. So
  nothing is pre-planned meanwhile, and the nodes on this computer get the processor time.
- The planner's last optimal plans are kept. The planner is deterministic, so if a request is repeated, the kept
  plan answers it, and the planner's process is not needed.

Every request has a time budget, which begins when the request is made. A process that has not answered by the
end of the budget is killed and replaced, and all its requests have failed. (The process may have been stopped,
its disk may not answer, or the search may not end.) If the aircraft waits for the plan, the policy then uses
the greedy planner, which needs no process.

The driver says when the fillers pause (`filler_pauses`). Then the pre-planner's process is stopped, and so is the
planner's process unless the aircraft waits for its plan. A pause does not count in a budget, and nothing new is
pre-planned in it.
"""

import time
from collections.abc import Callable
from typing import Protocol

from heronry_dg.objective import Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan, Settled
from heronry_manager.planner.client import Failed, Planned
from heronry_manager.planning_policy import (
    Answer,
    AskPlanner,
    FromPlanner,
    Instruction,
    PlannerAnswered,
    PlanningPolicy,
    PrePlan,
    PrePlannerAnswered,
    Question,
)

AWAITED_NS = 10_000_000_000
"""Budget of a request whose plan the aircraft waits for: the first request, or one after a refused greedy plan."""

AHEAD_NS = 300_000_000_000
"""Budget of a request while a legal configuration runs: for a better plan, or for a situation that may come."""

CALM_NS = 2_000_000_000
"""For how long a configuration must run before anything is pre-planned for it."""

_KEPT_PLANS = 8


class PlannerLink(Protocol):
    """The methods that this file uses of a planner's process: `heronry_manager.planner.client.PlannerClient`."""

    def request(self, number: int, now: Situation, running: Placement | None) -> None:
        """Request a plan for situation `now`; `poll` returns the answer, with this number.

        running: the placement that runs now; None: none is known.
        """

    def poll(self) -> list[Planned | Failed]:
        """Return the answers that have arrived, without waiting."""

    def cancel(self) -> None:
        """Forget all requests: they get no answer. If the process works on a request, replace the process."""

    def hold(self, is_held: bool) -> None:
        """Stop the process, so that it takes no processor time, or let it go on where it was."""

    def fileno(self) -> int:
        """Return the descriptor that is readable when `poll` has something to do."""


class PlannerProcesses:
    """The processes that plan for one manager: that of the planner, and that of the pre-planner once it is needed."""

    def __init__(
        self,
        policy: PlanningPolicy,
        planner: PlannerLink | None,
        start_pre_planner: Callable[[], PlannerLink],
        *,
        calm_ns: int = CALM_NS,
    ) -> None:
        """Begin with the planner's process, and without a process of the pre-planner.

        planner: None if there is no solver. Then the policy must have been made with `has_planner` false.
        start_pre_planner: starts the process of the pre-planner; called when the pre-planner is first needed.
        calm_ns: for how long a configuration must run before anything is pre-planned for it.
        """
        self._policy, self._planner, self._start_pre_planner = policy, planner, start_pre_planner
        self._pre_planner: PlannerLink | None = None
        self._calm_ns = calm_ns
        self._settled: tuple[int, Settled] | None = None  # when the policy is to learn it
        self._asked: dict[int, Question] = {}  # by request in the planner
        self._kept: dict[Question, Plan] = {}  # optimal plans of the planner, the latest one last
        self._at_hand: list[PlannerAnswered] = []  # answers from `_kept`, for the next poll
        self._until_ns: dict[int, int] = {}  # by request in the planner: the end of its budget
        self._ahead_until_ns: dict[int, int] = {}  # by request in the pre-planner: the end of its budget
        self._awaited: set[int] = set()  # requests in the planner for whose plan the aircraft waits
        self._held_since_ns: int | None = None  # begin of the pause of the fillers

    def readers(self) -> list[PlannerLink]:
        """Return the objects that an event loop must watch: if one of them is readable, `poll` has something to do."""
        return [one for one in (self._planner, self._pre_planner) if one is not None]

    def hold(self, is_held: bool, now_ns: int) -> None:
        """Let the fillers pause, or go on."""
        if is_held and self._held_since_ns is None:
            self._held_since_ns = now_ns
        elif not is_held and self._held_since_ns is not None:
            paused_ns, self._held_since_ns = now_ns - self._held_since_ns, None
            for request in self._until_ns.keys() - self._awaited:
                self._until_ns[request] += paused_ns
            for request in self._ahead_until_ns:
                self._ahead_until_ns[request] += paused_ns
        else:
            return
        self._hold_processes()

    def _hold_processes(self) -> None:
        is_held = self._held_since_ns is not None
        if self._pre_planner is not None:
            self._pre_planner.hold(is_held)
        if self._planner is not None:
            self._planner.hold(is_held and bool(self._until_ns) and not self._awaited)

    def take(self, told: RequestPlan | Settled) -> list[PlanReady | PlanFailed]:
        """Take a request or report of the core; returns an immediate answer, if there is one.

        A request goes to the policy at once, and `poll` gives its later answers. The report that a
        configuration has settled goes to the policy in `poll`, if no request comes within `calm_ns`.
        """
        if isinstance(told, Settled):
            if self._settled is None or self._settled[1] != told:
                self._settled = time.monotonic_ns() + self._calm_ns, told
            return []
        self._settled = None
        return self._carry_out(self._policy.step(told))

    def poll(self) -> list[PlanReady | PlanFailed]:
        """Return the answers that have arrived for the core.

        All answers of both processes are given to the policy (`planning_policy`), which decides what goes to the
        core. The plans of the pre-planner stay with the policy.
        """
        is_paused = self._held_since_ns is not None
        ahead = _answers(self._pre_planner, self._ahead_until_ns, may_hang=not is_paused)
        answers = _answers(self._planner, self._until_ns, may_hang=not is_paused or bool(self._awaited))
        for one in answers:
            self._keep(one)
            self._awaited.discard(one.request)
        if answers and is_paused:
            self._hold_processes()
        events: list[FromPlanner | Settled] = [
            *(PrePlannerAnswered(one.request, one.plan if isinstance(one, Planned) else None) for one in ahead),
            *(PlannerAnswered(_in_the_cores_words(one)) for one in answers),
            *self._at_hand,
        ]
        self._at_hand = []
        if self._settled is not None and self._settled[0] <= time.monotonic_ns() and not is_paused:
            events.append(self._settled[1])
            self._settled = None
        return [answer for event in events for answer in self._carry_out(self._policy.step(event))]

    def next_deadline_ns(self) -> int | None:
        """The time (ns) at which to call `poll` at the latest; None: nothing waits for a time.

        At this time the budget of a request ends, or the configuration has run for `calm_ns`, so that
        pre-planning for it may begin. 0: a kept plan already waits for `poll`.
        """
        if self._at_hand:
            return 0
        if self._held_since_ns is not None:
            return min((self._until_ns[request] for request in self._awaited), default=None)
        calm_ns = () if self._settled is None else (self._settled[0],)
        return min((*self._until_ns.values(), *self._ahead_until_ns.values(), *calm_ns), default=None)

    def _carry_out(self, instructions: list[Instruction]) -> list[PlanReady | PlanFailed]:
        answers = []
        for instruction in instructions:
            match instruction:
                case Answer(answer):
                    answers.append(answer)
                case AskPlanner(plan_request):
                    assert self._planner is not None  # else the policy knows that there is none
                    if self._is_at_hand(plan_request):
                        continue
                    budget_ns = AHEAD_NS if plan_request.in_background else AWAITED_NS
                    self._until_ns[plan_request.request] = time.monotonic_ns() + budget_ns
                    if not plan_request.in_background:
                        self._awaited.add(plan_request.request)
                    self._planner.request(plan_request.request, plan_request.now, plan_request.running)
                    self._hold_processes()
                case PrePlan(number, question):  # pragma: no branch - nothing else is left
                    self._pre_planner = self._pre_planner or self._start_pre_planner()
                    self._ahead_until_ns[number] = time.monotonic_ns() + AHEAD_NS
                    self._pre_planner.request(number, question.now, question.running)
        return answers

    def _is_at_hand(self, request: RequestPlan) -> bool:
        """Have the next poll answer a request with a kept plan; returns False if no plan is kept for the request.

        In that case the request is noted, so that its plan can be kept. A request without a running placement
        is never answered with a kept plan, and not noted.
        """
        if request.running is None:
            return False
        question = Question(request.now, request.running)
        plan = self._kept.get(question)
        if plan is None:
            self._asked[request.request] = question
        else:
            self._at_hand.append(PlannerAnswered(PlanReady(request.request, plan)))
        return plan is not None

    def _keep(self, answer: Planned | Failed) -> None:
        question = self._asked.pop(answer.request, None)
        if question is None or isinstance(answer, Failed) or not answer.plan.optimal:
            return
        self._kept[question] = answer.plan
        if len(self._kept) > _KEPT_PLANS:
            del self._kept[next(iter(self._kept))]


def _answers(planner: PlannerLink | None, until_ns: dict[int, int], *, may_hang: bool) -> list[Planned | Failed]:
    """Return the answers that have arrived from a process; there are none if `planner` is None.

    If a request has exceeded its budget, the process is replaced, and all its unanswered requests have failed.

    until_ns: by request, the time (ns) at which its budget ends; answered and failed requests are removed.
    may_hang: whether a process that says nothing hangs; False: it pauses.
    """
    if planner is None:
        return []
    answers = planner.poll()
    for answer in answers:
        until_ns.pop(answer.request, None)
    if may_hang and until_ns and min(until_ns.values()) <= time.monotonic_ns():
        planner.cancel()
        reason = "the planner's process hangs: it did not answer within its budget, and was replaced"
        answers += [Failed(number, reason) for number in until_ns]
        until_ns.clear()
    return answers


def _in_the_cores_words(answer: Planned | Failed) -> PlanReady | PlanFailed:
    if isinstance(answer, Planned):
        return PlanReady(answer.request, answer.plan)
    return PlanFailed(answer.request, answer.reason)
