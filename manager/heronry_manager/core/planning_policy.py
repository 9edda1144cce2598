"""Which planner answers a request for a plan, and what is planned ahead: one policy, wherever a manager flies.

The manager's core requests plans (`RequestPlan`), and reports when a configuration runs and nothing is under way
(`Settled`). The policy answers, or names the planner to be asked; its driver carries the request there and the answer
back. The driver is the manager's shell, between processes, or the simulator, in virtual time.

A request is *immediate*, while something that flies waits for the answer, or *in the background*: the first
configuration of an active manager, which interrupts nothing, and the better plan that the core requests once what was
answered immediately runs. Where a plan comes from, in this order:

    contingencies   made before the flight for these faults, this phase and what runs (`contingency.look_up`)
    pre-planned     made in flight for just this, before it happened
    planner         background requests alone: the exact planner, in its own time
    immediate       the greedy planner, here and now, checked by the verifier (`heronry_dg.verify`)

If the verifier refuses a greedy plan, the planner is asked in its place; where there is none, the request fails.
Without a solver there is no planner and nothing is pre-planned: the greedy planner answers everything. Without an
immediate planner, which is how simulated flights leave its plans out, the planner is asked everything.

*Pre-planning.* When a configuration has settled, the questions ahead are: each PE lost that is up, each PE back that is
down, the next mission phase. The policy gives them one after the other to the *pre-planner*, another process, which
runs with a lower priority than all others. Faults of devices and modules, and pairs of faults, are left to the
contingencies; what these answer is not pre-planned. A pre-made plan is kept under all that it depends on (`Question`),
so a stale one is never found. What was made for another configuration is forgotten when the next one settles.

    pre-planner   idle       `PrePlan` never went out, or is answered: the next question goes out immediately, if one is
                  left
                  planning   `PrePlan` is out; ends with PrePlannerAnswered of its number

The core requests and settles, the processes answer; nothing else changes the state here. What may go wrong with an
answer:

    late        The planner's is handed on: the core knows which request counts, and drops what answers an older one.
                The pre-planner's is kept under its own question until another configuration settles.
    doubled     Nothing waits for it any more: it is dropped.
    lost        The core requests anew when the situation changes, and has an immediate answer meanwhile. After a loss
                of the pre-planner's nothing more is pre-planned. A client whose process ends answers for it with a
                failure.
    a failure   The core decides what follows from the planner's (`planning`). The pre-planner's question is left out.

A restart forgets everything here; what is ahead is pre-planned anew once a configuration runs. The policy knows no
time: nothing limits how long the planner may take for a request.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Protocol

from heronry_dg.model import Spec
from heronry_dg.objective import Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_dg.verify import Violation, verify
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan, Settled
from heronry_wire.sansio import require


class ImmediatePlanner(Protocol):
    """A planner that answers within the call: `heronry_manager.planner.greedy`."""

    def plan(self, now: Situation, running: Placement | None = None) -> Plan:
        """Find a plan in a few milliseconds."""


@dataclass(frozen=True, slots=True)
class Question:
    """All that a plan depends on, beside the spec."""

    now: Situation
    running: Placement

    def __hash__(self) -> int:
        return hash((self.now, frozenset(self.running.items())))


class Source(Enum):
    """Where an answer to a request comes from."""

    CONTINGENCIES = "contingencies"
    PRE_PLANNED = "pre-planned"
    IMMEDIATE = "immediate"
    PLANNER = "planner"


@dataclass(frozen=True, slots=True)
class PlannerAnswered:
    """The planner's process has answered."""

    answer: PlanReady | PlanFailed


@dataclass(frozen=True, slots=True)
class PrePlannerAnswered:
    """The pre-planner's process has answered; None: it found no plan, or has ended."""

    number: int
    plan: Plan | None


@dataclass(frozen=True, slots=True)
class Answer:
    """Hand this answer to the core."""

    answer: PlanReady | PlanFailed
    source: Source


@dataclass(frozen=True, slots=True)
class AskPlanner:
    """Ask the planner's process; answer with PlannerAnswered. `refusal`: why the verifier refused the greedy plan."""

    request: RequestPlan
    refusal: Violation | None = None


@dataclass(frozen=True, slots=True)
class PrePlan:
    """Ask the pre-planner's process, which is idle; answer with PrePlannerAnswered and the number."""

    number: int
    question: Question


FromPlanner = PlannerAnswered | PrePlannerAnswered
PolicyEvent = RequestPlan | Settled | FromPlanner
Instruction = Answer | AskPlanner | PrePlan


class PlanningPolicy:
    """The policy of one manager."""

    def __init__(
        self,
        spec: Spec,
        immediate: ImmediatePlanner | None,
        *,
        has_planner: bool,
        contingencies: ContingencyTable | None = None,
    ) -> None:
        """`has_planner`: there is a solver, and so a process to ask, and another one to pre-plan; else `immediate`."""
        require(immediate is not None or has_planner, "there is no planner")
        self._spec, self._immediate, self._has_planner = spec, immediate, has_planner
        self._contingencies = contingencies
        self._owed: set[int] = set()  # requests that the planner has not answered
        self._pre_planned: dict[Question, Plan] = {}
        self._ahead: deque[Question] = deque()  # to be pre-planned, the next one first
        self._in_pre_planning: PrePlan | None = None
        self._number = 0  # of the last question ahead

    @property
    def is_pre_planning(self) -> bool:
        """Tell whether the pre-planner owes an answer."""
        return self._in_pre_planning is not None

    def step(self, event: PolicyEvent) -> list[Instruction]:
        """Take one event; returns what is to be done, in order. A RequestPlan gives exactly one instruction."""
        match event:
            case RequestPlan():
                return [self._decide(event)]
            case Settled(now, running):
                self._look_ahead(now, running)
                return self._pre_plan()
            case PlannerAnswered(answer):
                if answer.request not in self._owed:
                    return []
                self._owed.remove(answer.request)
                return [Answer(answer, Source.PLANNER)]
            case PrePlannerAnswered(number, plan):  # pragma: no branch - nothing else is left
                self._keep(number, plan)
                return self._pre_plan()

    # Questions of the core

    def _decide(self, request: RequestPlan) -> Instruction:
        made = self._made_before(request)
        if made is not None:
            return Answer(PlanReady(request.request, made), Source.CONTINGENCIES)
        if request.running is not None:
            made = self._pre_planned.get(Question(request.now, request.running))
            if made is not None:
                return Answer(PlanReady(request.request, made), Source.PRE_PLANNED)
        has_time = request.in_background or request.running is None
        if self._immediate is None or (has_time and self._has_planner):
            return self._ask(request)
        return self._plan_at_once(self._immediate, request)

    def _made_before(self, request: RequestPlan) -> Plan | None:
        """Find the plan of a contingency; these are made for situations without limits. None: there is none."""
        if self._contingencies is None or request.now.limits:
            return None
        return self._contingencies.plan(request.now.down, request.now.phase, request.running)

    def _plan_at_once(self, immediate: ImmediatePlanner, request: RequestPlan) -> Instruction:
        plan = immediate.plan(request.now, request.running)
        refusals = verify(self._spec, request.now, plan.configuration)
        if not refusals:
            return Answer(PlanReady(request.request, plan), Source.IMMEDIATE)
        if self._has_planner:
            return self._ask(request, refusals[0])
        reason = f"the greedy plan is not legal: {refusals[0]}"
        return Answer(PlanFailed(request.request, reason), Source.IMMEDIATE)

    def _ask(self, request: RequestPlan, refusal: Violation | None = None) -> AskPlanner:
        self._owed.add(request.request)
        return AskPlanner(request, refusal)

    # Questions ahead

    def _look_ahead(self, now: Situation, running: Placement) -> None:
        """Find the questions ahead; forget the plans for any others."""
        if not self._has_planner:
            return
        ahead = [Question(next_one, running) for next_one in self._next_situations(now)]
        self._pre_planned = {one: self._pre_planned[one] for one in ahead if one in self._pre_planned}
        self._ahead = deque(one for one in ahead if one not in self._pre_planned and not self._is_answered_ahead(one))

    def _next_situations(self, now: Situation) -> Iterable[Situation]:
        """Give the situations that may come next: one PE lost, one PE back, the next phase in the spec's order."""
        for pe in self._spec.pes:
            if f"pe:{pe}" not in now.down:
                yield replace(now, down=now.down | {f"pe:{pe}"})
        for element in sorted(now.down):
            if element.startswith("pe:"):
                yield replace(now, down=now.down - {element})
        if now.phase is not None:
            phases = list(self._spec.phases)
            for following in phases[phases.index(now.phase) + 1 :][:1]:
                yield replace(now, phase=following)

    def _is_answered_ahead(self, one: Question) -> bool:
        """Tell whether a contingency answers a question, or the pre-planner is working on it."""
        if self._in_pre_planning is not None and self._in_pre_planning.question == one:
            return True
        if self._contingencies is None or one.now.limits:
            return False
        return self._contingencies.find(one.now.down, one.now.phase, one.running) is not None

    def _pre_plan(self) -> list[Instruction]:
        """Give out the next question ahead, if the pre-planner is idle."""
        if self._in_pre_planning is not None or not self._ahead:
            return []
        self._number += 1
        self._in_pre_planning = PrePlan(self._number, self._ahead.popleft())
        return [self._in_pre_planning]

    def _keep(self, number: int, plan: Plan | None) -> None:
        if self._in_pre_planning is None or self._in_pre_planning.number != number:
            return
        if plan is not None:
            plan.report.work_out()  # while there is time
            self._pre_planned[self._in_pre_planning.question] = plan
        self._in_pre_planning = None
