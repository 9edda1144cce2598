"""The policy that chooses a planner for each request, and pre-plans the next faults; flight and simulator share it.

The manager's core requests plans (`RequestPlan`), and reports when a configuration runs and nothing is under way
(`Settled`). The policy answers a request itself, or names the planner that must answer. Then the driver carries the
request to that planner, and the answer back. The driver is the manager's shell, which works with processes, or the
simulator, which works in virtual time.

    idle       the pre-planner has answered every `PrePlan`; if a question is left, it goes out immediately
    planning   a `PrePlan` is out; the state ends with the PrePlannerAnswered that has its number

When the core makes its next request, the questions that have not gone out yet are dropped: the configuration for
which they were made will not stay.

Only requests of the core, reports of the core, and answers of the processes change the state of the policy.

A request is *immediate* if a running configuration must be replaced. It is *in the background* in two cases:

    - it is for the first configuration of an active manager: no running configuration is interrupted
    - it is for the optimal plan, which the core requests once an immediate plan runs

A plan comes from the first of these sources that has one:

    contingencies   made before the flight for these faults, this phase and the running configuration
                    (`contingency.look_up`); none while a radio is limited or a priority is changed
    pre-planned     made in flight for exactly this situation, before it happened
    planner         only for background requests: the exact planner, in its own process
    immediate       the greedy planner, within the call, checked by the verifier (`heronry_dg.verify`)
    safe mode       made before the flight for this phase (`contingency.look_up`); it takes the place of an immediate
                    plan that is not legal, or serves less of class A. The optimal plan is then requested as usual

Special cases:

    - If the verifier refuses a greedy plan, and there is no legal safe mode, the exact planner answers. If there is no
      exact planner, the request fails.
    - If the exact planner fails, or needs more time than the driver gives it, the greedy planner answers. So the
      aircraft gets a configuration even if a planner hangs. But a request that is only for a better plan then fails.
    - Without a solver there is no exact planner: the greedy planner answers everything, and nothing is pre-planned.
    - Some simulated flights leave out the greedy planner. Then the exact planner answers everything.

*Pre-planning.* When a configuration has settled, the policy prepares *questions*: the loss of each PE that is up, the
return of each PE that is down, and the next mission phase. The policy gives the questions one after the other to the
*pre-planner*, another process, which runs with a lower priority than all others. Faults of devices and modules, and
pairs of faults, are left to the contingencies. A question that a contingency answers is not pre-planned. A pre-planned
plan is kept by its `Question`, which has all that the plan depends on; so the plan is never used in another situation.
The plans for the last few configurations are kept (`_KEPT_CONFIGURATIONS`): if a device fails and recovers again and
again, the pre-planner works only the first time.

What may go wrong with an answer:

    late        An answer of the planner is handed on; the core drops it if its request is no longer the present one. An
                answer of the pre-planner is kept under its question like every other.
    doubled     The second answer is dropped.
    lost        The core runs an immediate plan meanwhile, and requests anew when the situation changes. If an answer of
                the pre-planner is lost, nothing more is pre-planned. When a process ends, its client answers with a
                failure.
    a failure   The core decides what follows from a failure of the planner (`planning`). A question on which the
                pre-planner fails is left out.

A restart forgets everything here; pre-planning begins anew once a configuration runs. The policy has no clock: the
driver limits how long a process may take, and after that time reports the failure of the process.
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

_KEPT_CONFIGURATIONS = 4  # whose pre-planned plans are kept, each with a plan for every PE and one for the next phase


class ImmediatePlanner(Protocol):
    """A planner that answers before its call returns: `heronry_manager.planner.greedy`."""

    def plan(self, now: Situation, running: Placement | None = None) -> Plan:
        """Find a plan for this situation in a few milliseconds."""


@dataclass(frozen=True, slots=True)
class Question:
    """The request for a plan ahead: for the situation `now`, while the placement `running` runs."""

    now: Situation
    running: Placement

    def __hash__(self) -> int:
        return hash((self.now, frozenset(self.running.items())))


class Source(Enum):
    """Where a plan comes from; events show the value, a string, as the origin of the plan."""

    CONTINGENCIES = "contingencies"
    PRE_PLANNED = "pre-planned"
    IMMEDIATE = "immediate"
    PLANNER = "planner"
    SAFE_MODE = "safe mode"


@dataclass(frozen=True, slots=True)
class PlannerAnswered:
    """Event: the planner's process has answered."""

    answer: PlanReady | PlanFailed


@dataclass(frozen=True, slots=True)
class PrePlannerAnswered:
    """Event: the pre-planner's process has answered; `plan` is None if it found none, or the process has ended."""

    number: int
    plan: Plan | None


@dataclass(frozen=True, slots=True)
class Answer:
    """Instruction to the driver: give the core this answer to its request for a plan."""

    answer: PlanReady | PlanFailed
    source: Source


@dataclass(frozen=True, slots=True)
class AskPlanner:
    """Instruction to the driver: send this request to the planner's process.

    refusal: the violation for which the verifier refused the greedy plan; None if no plan was refused.
    """

    request: RequestPlan
    refusal: Violation | None = None


@dataclass(frozen=True, slots=True)
class PrePlan:
    """Instructs the driver to send `question` to the process of the pre-planner, which is idle.

    The event `PrePlannerAnswered` that brings the answer repeats the `number` of this instruction.
    """

    number: int
    question: Question


FromPlanner = PlannerAnswered | PrePlannerAnswered
PolicyEvent = RequestPlan | Settled | FromPlanner
Instruction = Answer | AskPlanner | PrePlan


class PlanningPolicy:
    """Chooses the planner for each request of one manager, and pre-plans the next faults."""

    def __init__(
        self,
        spec: Spec,
        immediate: ImmediatePlanner | None,
        *,
        has_planner: bool,
        contingencies: ContingencyTable | None = None,
    ) -> None:
        """`immediate`: the greedy planner; None: every request goes to the exact planner.

        has_planner: there is a solver, and so an exact planner and a pre-planner; if False, `immediate` must be given.
        """
        require(immediate is not None or has_planner, "there is no planner")
        self._spec, self._immediate, self._has_planner = spec, immediate, has_planner
        self._contingencies = contingencies
        self._owed: dict[int, RequestPlan] = {}  # requests that the planner has not answered, by number
        self._pre_planned: dict[Question, Plan] = {}  # the one that was made or looked up last comes last
        self._ahead: deque[Question] = deque()  # to be pre-planned, the next one first
        self._in_pre_planning: PrePlan | None = None
        self._number = 0  # of the last question ahead

    def step(self, event: PolicyEvent) -> list[Instruction]:
        """Process one event; gives the instructions for the driver, in order.

        A RequestPlan leads to exactly one instruction.
        """
        match event:
            case RequestPlan():
                self._ahead.clear()
                return [self._decide(event)]
            case Settled(now, running):
                self._look_ahead(now, running)
                return self._pre_plan()
            case PlannerAnswered(answer):
                request = self._owed.pop(answer.request, None)
                return [] if request is None else [self._in_its_place(request, answer)]
            case PrePlannerAnswered(number, plan):  # pragma: no branch - nothing else is left
                self._keep(number, plan)
                return self._pre_plan()

    # Questions of the core

    def _decide(self, request: RequestPlan) -> Instruction:
        made = self._made_before(request)
        if made is not None:
            return Answer(PlanReady(request.request, made), Source.CONTINGENCIES)
        if request.running is not None:
            made = self._recall(Question(request.now, request.running))
            if made is not None:
                return Answer(PlanReady(request.request, made), Source.PRE_PLANNED)
        has_time = request.in_background or request.running is None
        if self._immediate is None or (has_time and self._has_planner):
            return self._ask(request)
        return self._plan_at_once(self._immediate, request)

    def _made_before(self, request: RequestPlan) -> Plan | None:
        """Find a contingency that answers this request; None if there is none.

        Contingencies are made without limited radios, changed priorities and scripts of the operator. So no contingency
        answers while a radio is limited or a priority is changed, or while a script is asked for or held.
        """
        if self._contingencies is None or request.target is not None or request.now.limits or request.now.priorities:
            return None
        return self._contingencies.plan(request.now.down, request.now.phase, request.running)

    def _plan_at_once(self, immediate: ImmediatePlanner, request: RequestPlan) -> Instruction:
        plan = immediate.plan(request.now, request.running)
        refusals = verify(self._spec, request.now, plan.configuration)
        safe = self._safe_mode(request, None if refusals else plan)
        if safe is not None:
            return safe
        if not refusals:
            return Answer(PlanReady(request.request, plan), Source.IMMEDIATE)
        if self._has_planner:
            return self._ask(request, refusals[0])
        reason = f"the greedy plan is not legal: {refusals[0]}"
        return Answer(PlanFailed(request.request, reason), Source.IMMEDIATE)

    def _in_its_place(self, request: RequestPlan, answer: PlanReady | PlanFailed) -> Answer:
        """Return the answer of the exact planner or, if it has failed, an answer of the greedy planner in its place.

        The failure itself is the answer to a background request. It is also the answer if there is no greedy
        planner, or if the greedy plan is not legal.
        """
        if isinstance(answer, PlanFailed) and self._immediate is not None and not request.in_background:
            plan = self._immediate.plan(request.now, request.running)
            if not verify(self._spec, request.now, plan.configuration):
                return Answer(PlanReady(request.request, plan), Source.IMMEDIATE)
        if isinstance(answer, PlanFailed) and not request.in_background:
            return self._safe_mode(request, None) or Answer(answer, Source.PLANNER)
        return Answer(answer, Source.PLANNER)

    def _safe_mode(self, request: RequestPlan, immediate: Plan | None) -> Answer | None:
        """Return the safe mode as the answer, if it is legal and serves more of class A than the immediate plan.

        immediate: None: no immediate plan is legal.
        """
        if self._contingencies is None or (immediate is not None and self._serves_class_a(request.now, immediate)):
            return None
        safe = self._contingencies.safe_mode(request.now, request.running)
        if safe is None or (immediate is not None and safe.objective.critical[0] <= immediate.objective.critical[0]):
            return None
        return Answer(PlanReady(request.request, safe), Source.SAFE_MODE)

    def _serves_class_a(self, now: Situation, plan: Plan) -> bool:
        """Tell whether a plan serves every wanted function of class A."""
        functions = self._spec.functions.values()
        wanted = sum(now.priority_of(one) for one in functions if one.criticality_in(now.phase) == "A")
        return plan.objective.critical[0] >= wanted

    def _ask(self, request: RequestPlan, refusal: Violation | None = None) -> AskPlanner:
        self._owed[request.request] = request
        return AskPlanner(request, refusal)

    # Questions ahead

    def _look_ahead(self, now: Situation, running: Placement) -> None:
        """List the questions to pre-plan while `running` runs in the situation `now`, in place of the old list.

        A question that has an answer already, or that the pre-planner works on, is left out. Without a solver
        nothing is listed.
        """
        if not self._has_planner:
            return
        ahead = (Question(next_one, running) for next_one in self._next_situations(now))
        self._ahead = deque(one for one in ahead if not self._is_answered_ahead(one))

    def _next_situations(self, now: Situation) -> Iterable[Situation]:
        """Yield the situations to plan ahead for.

        These are the loss of each PE that is up, the return of each PE that is down, and the next phase.
        """
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
        """Tell whether a question needs no pre-planning.

        This is so if a pre-planned plan or a contingency answers it, or the pre-planner works on it already.
        """
        if self._recall(one) is not None:
            return True
        if self._in_pre_planning is not None and self._in_pre_planning.question == one:
            return True
        if self._contingencies is None or one.now.limits or one.now.priorities:
            return False
        return self._contingencies.find(one.now.down, one.now.phase, one.running) is not None

    def _pre_plan(self) -> list[Instruction]:
        """Return the instruction that gives the next question to the pre-planner.

        The list is empty if the pre-planner is not idle, or no question is left.
        """
        if self._in_pre_planning is not None or not self._ahead:
            return []
        self._number += 1
        self._in_pre_planning = PrePlan(self._number, self._ahead.popleft())
        return [self._in_pre_planning]

    def _keep(self, number: int, plan: Plan | None) -> None:
        if self._in_pre_planning is None or self._in_pre_planning.number != number:
            return
        if plan is not None:
            plan.report.work_out()  # now, rather than when the plan is needed
            self._pre_planned[self._in_pre_planning.question] = plan
            if len(self._pre_planned) > _KEPT_CONFIGURATIONS * (len(self._spec.pes) + 1):
                del self._pre_planned[next(iter(self._pre_planned))]
        self._in_pre_planning = None

    def _recall(self, question: Question) -> Plan | None:
        """Return the pre-planned plan that answers a question; None if there is none.

        Of all pre-planned plans that are kept now, this plan will be forgotten last.
        """
        plan = self._pre_planned.pop(question, None)
        if plan is not None:
            self._pre_planned[question] = plan
        return plan
