"""Plans for simulated managers, and best plans for the oracles.

Plans are kept for the life of the process. This changes no flight, since a plan depends only on the spec, the situation
and the running configuration. As in flight, the verifier has accepted every plan.

An oracle needs only levels 1 to 3 of the best plan. The running configuration has an effect only from level 4 on. So an
oracle may use any plan that is proven best at levels 1 to 3, whatever ran before.

The planning policy is that of a real manager (`heronry_manager.planning_policy`): it decides which planner gets a
request. `Planners` names the planners from which the policy can choose:

    BEST        only the exact planner, so every answer is the best plan, as if every fault had been pre-planned; the
                default
    IMMEDIATE   the greedy planner, and in the background the exact one; nothing is pre-planned
    GREEDY      only the greedy planner: a manager without a solver
    ALL         the greedy planner, the exact one and a pre-planner: a manager as equipped for a flight
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

from heronry_dg.model import Spec
from heronry_dg.objective import Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation, elements
from heronry_dg.verify import verify
from heronry_manager.contingency.contingencies import Contingencies
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_manager.core.tables import Compiler, ContingencyNumbers, loaded, on_board
from heronry_manager.core.vocabulary import PlanReady, RequestPlan
from heronry_manager.planner.exact import Planner
from heronry_manager.planner.greedy.planner import Greedy
from heronry_manager.planner.sweep import Scope
from heronry_manager.planning_policy import Answer, Instruction, PlanningPolicy
from heronry_tools.analysis.campaign.sweeping import numbered, sweep
from heronry_wire.compressed_table import compressed
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import InvariantError, require

_Question = tuple[str, Situation]  # digest of the spec, situation
_Key = tuple[_Question, frozenset[tuple[str, tuple[str, str]]] | str | None]
_WHATEVER = "whatever runs"  # in a key instead of what runs: any best plan for the situation
KNOWN_PLANS: dict[_Key, Plan] = {}  # of this process
_CRITICAL: dict[_Question, tuple[int, ...]] = {}  # level 1 of the best plan, where only this was requested
_PLANNERS: dict[str, Planner] = {}  # by digest of the spec
_GREEDY: dict[str, Greedy] = {}  # by digest of the spec


@dataclass(frozen=True)
class Prepared:
    """The tables of an aircraft's PEs, and its contingencies.

    compiler: compiled the tables; the managers share it
    made: the contingencies; None if there are none
    numbers: the numbers by which PREPARE names a contingency on board; None if there are none
    """

    tables: Mapping[str, PeTable]
    compiler: Compiler
    made: ContingencyTable | None = None
    numbers: ContingencyNumbers | None = None

    @cached_property
    def contents(self) -> Mapping[str, bytes]:
        """The tables as a manager brings them over the bus."""
        return {pe: compressed(table.to_json()) for pe, table in self.tables.items()}


PREPARED: dict[tuple[str, int | None], Prepared] = {}  # by digest of the spec, and number of faults


def prepared(spec: Spec, faults: int | None) -> Prepared:
    """Return the tables of a spec, with contingencies for up to `faults` faults on board.

    If `faults` is None, there are no contingencies.
    """
    known = PREPARED.get((spec.digest, faults))
    if known is None:
        made = None if faults is None else plan_ahead(spec, faults)
        known = PREPARED[spec.digest, faults] = prepared_with(spec, made)
    return known


def prepared_with(spec: Spec, made: Contingencies | None) -> Prepared:
    """Return the tables of a spec, with the contingencies `made` on board; None: without contingencies."""
    compiler = Compiler(spec)
    tables = {pe: compiler.table(pe) for pe in spec.pes}
    if made is None:
        return Prepared(tables, compiler)
    held = on_board(spec, made)
    with_plans = {one.pe: loaded(tables[one.pe], one) for one in held}
    return Prepared(with_plans, compiler, ContingencyTable(spec, made), ContingencyNumbers(spec, made, held))


def plan_ahead(spec: Spec, faults: int) -> Contingencies:
    """Make a contingency for every set of up to `faults` faults in every phase, as `heronry contingencies` does."""
    scope = Scope(elements(spec), faults, tuple(spec.phases) or (None,), places=True)
    return numbered(spec, scope, sweep(spec, scope, None))


class Planners(Enum):
    """The planners that a manager's planning policy can use."""

    BEST = "the exact planner"
    IMMEDIATE = "the greedy planner, and in the background the exact one"
    GREEDY = "the greedy planner"
    ALL = "the greedy planner, the exact one, and a pre-planner"

    def policy(self, spec: Spec, made: ContingencyTable | None) -> PlanningPolicy:
        """Return a new planning policy with these planners and these contingencies."""
        immediate = None if self is Planners.BEST else _greedy(spec)
        return PlanningPolicy(spec, immediate, has_planner=self is not Planners.GREEDY, contingencies=made)


def best_plan(spec: Spec, now: Situation, running: Placement | None) -> Plan:
    """Return the exact planner's plan for a situation; raises InvariantError if the verifier refuses the plan.

    running: what runs, which counts at level 4; None if nothing runs
    """
    question = _question(spec, now)
    key: _Key = (question, None if running is None else frozenset(running.items()))
    known = KNOWN_PLANS.get(key)
    if known is None:
        known = _planner(spec).plan(now, running)
        refusals = verify(spec, now, known.configuration)
        require(not refusals, "the planner's plan for {} is not legal: {}", sorted(now.down), refusals)
        KNOWN_PLANS[key] = known
        if known.optimal:
            KNOWN_PLANS.setdefault((question, _WHATEVER), known)
    return known


def best_at_all(spec: Spec, now: Situation) -> Plan:
    """Return a plan that is the best one at levels 1 to 3; for these levels it does not matter what runs.

    The oracles use this plan.
    """
    known = KNOWN_PLANS.get((_question(spec, now), _WHATEVER))
    return best_plan(spec, now, None) if known is None else known


def immediate_plan(spec: Spec, now: Situation, running: Placement | None) -> Plan:
    """Return the plan of a manager without a solver; raises InvariantError if the verifier refuses it."""
    (decided,) = Planners.GREEDY.policy(spec, None).step(RequestPlan(0, now, running))
    return plan_of(decided)


def plan_of(decided: Instruction) -> Plan:
    """Return the plan in the immediate answer of a planning policy.

    Raises InvariantError if the policy has not answered with a plan, for example because the verifier refused it.
    """
    match decided:
        case Answer(PlanReady(plan=plan)):
            return plan
        case _:
            raise InvariantError(f"the planning policy answered with {decided} instead of a plan")


def critical_at_best(spec: Spec, now: Situation) -> tuple[int, ...]:
    """Return level 1 (criticality) of the best plan's value, for oracles that need only this level."""
    question = _question(spec, now)
    known = KNOWN_PLANS.get((question, _WHATEVER))
    if known is not None:
        return known.objective.critical
    if question not in _CRITICAL:
        search = _planner(spec).serve(now)
        refusals = verify(spec, now, search.best)
        require(not refusals, "the planner's plan for {} is not legal: {}", sorted(now.down), refusals)
        _CRITICAL[question] = search.objective.critical
    return _CRITICAL[question]


def _question(spec: Spec, now: Situation) -> _Question:
    return spec.digest, now


def _planner(spec: Spec) -> Planner:
    """Return the planner of a spec, which is kept between calls."""
    if spec.digest not in _PLANNERS:
        _PLANNERS[spec.digest] = Planner(spec)
    return _PLANNERS[spec.digest]


def _greedy(spec: Spec) -> Greedy:
    """Return the greedy planner of a spec, which is kept between calls."""
    if spec.digest not in _GREEDY:
        _GREEDY[spec.digest] = Greedy(spec)
    return _GREEDY[spec.digest]


def plans_known() -> int:
    """Return the number of plans that this process has made and keeps."""
    return sum(runs != _WHATEVER for _, runs in KNOWN_PLANS)
