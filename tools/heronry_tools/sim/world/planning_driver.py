"""The driver of a simulated manager's planning policy: its planners, and the virtual time that they take.

The policy is the same code as in flight (`heronry_manager.planning_policy`), with the planners in `Planners`. An
immediate answer takes a fixed time; the processes of planner and pre-planner take a drawn time. An answer that is under
way arrives even if the manager is paused or dies meanwhile.
"""

from collections.abc import Callable

from heronry_dg.model import Spec
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_manager.core.vocabulary import PlanFailed, PlanReady, RequestPlan
from heronry_manager.planning_policy import (
    Answer,
    AskPlanner,
    FromPlanner,
    Instruction,
    PlannerAnswered,
    PolicyEvent,
    PrePlan,
    PrePlannerAnswered,
    Source,
)
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.planning import Planners, best_plan
from heronry_wire.sansio import require

_LOOKED_UP_NS = 100_000  # time to look up a contingency
_IMMEDIATE_NS = 3_000_000  # time of the greedy planner and the verifier
_TAKES_NS = {
    Source.CONTINGENCIES: _LOOKED_UP_NS,
    Source.PRE_PLANNED: _LOOKED_UP_NS,
    Source.IMMEDIATE: _IMMEDIATE_NS,
    Source.SAFE_MODE: _IMMEDIATE_NS,
}


class PlanningDriver:
    """Runs the planning policy of one simulated manager, and gives it the answers of simulated planners."""

    def __init__(
        self,
        clock: Clock,
        spec: Spec,
        planners: Planners,
        made: ContingencyTable | None,
        *,
        decide_ns: Callable[[], int],
        tell: Callable[[PlanReady | PlanFailed | FromPlanner], None],
    ) -> None:
        """Begin with no request.

        decide_ns: returns the time that a planning process takes for its next plan
        tell: is called with each answer when the answer arrives. It must give an answer of type FromPlanner to `take`
            as soon as the manager is awake
        """
        self._clock, self._spec, self._planners = clock, spec, planners
        self._decide_ns, self._tell = decide_ns, tell
        self._policy = planners.policy(spec, made)

    def take(self, event: PolicyEvent) -> None:
        """Give the policy an event of the core or of a planner, and execute the policy's instructions."""
        for instruction in self._policy.step(event):
            self._carry_out(instruction)

    def ask_planner(self, request: RequestPlan) -> None:
        """Let the planner's process answer a request."""
        plan = best_plan(self._spec, request.now, request.running)
        self.answer(self._decide_ns(), PlannerAnswered(PlanReady(request.request, plan)))

    def answer(self, after_ns: int, answer: PlanReady | PlanFailed | FromPlanner) -> None:
        """Let an answer arrive `after_ns` from now, in virtual time."""
        self._clock.at(self._clock.now_ns + after_ns, lambda: self._tell(answer))

    def _carry_out(self, instruction: Instruction) -> None:
        match instruction:
            case Answer(answer, Source.PLANNER):
                self._tell(answer)
            case Answer(answer, source):
                require(isinstance(answer, PlanReady), "the verifier refuses a plan: {}", answer)
                self.answer(_TAKES_NS[source], answer)
            case AskPlanner(request, refusal):
                require(refusal is None, "the greedy plan for {} is not legal: {}", sorted(request.now.down), refusal)
                self.ask_planner(request)
            case PrePlan(number, question):  # pragma: no branch - the last kind of instruction
                if self._planners is Planners.ALL:
                    plan = best_plan(self._spec, question.now, question.running)
                    self.answer(self._decide_ns(), PrePlannerAnswered(number, plan))
