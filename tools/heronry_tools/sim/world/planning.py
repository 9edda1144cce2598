"""Plans for simulated managers, and the same for the oracles of a run: what could be served, if all were known.

An answer is kept for as long as the process lives. A plan depends on the spec, the situation and what runs, and on
nothing else; keeping it changes no run. Every plan has passed the verifier, as it has in flight. What could be served
at best does not depend on what runs (that comes at level 4): an oracle accepts any plan for the situation that is
proven to be the best one.

Which planner gets a request is decided by the policy that flies (`heronry_manager.core.planning_policy`), behind which
the planners here stand (`Planners`). By default there is only the exact one, so that every answer is the best plan, as
if every fault had been planned ahead. With `IMMEDIATE` none has: the pre-planner never answers. `GREEDY` is a manager
without a solver. `ALL` is a manager as it is equipped for a flight.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from heronry_dg.model import Spec
from heronry_dg.objective import Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation, elements
from heronry_dg.verify import verify
from heronry_manager.contingency.contingencies import Contingencies
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_manager.contingency.on_board import ContingencyNumbers, loaded, on_board
from heronry_manager.core.compilation import Compiler
from heronry_manager.core.planning_policy import Answer, Instruction, PlanningPolicy
from heronry_manager.core.vocabulary import PlanReady, RequestPlan
from heronry_manager.planner.exact import Planner
from heronry_manager.planner.greedy.planner import Greedy
from heronry_manager.planner.sweep import Scope
from heronry_tools.analysis.campaign.sweeping import numbered, sweep
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import InvariantError, require

_Question = tuple[str, Situation]  # by the digest of the spec
_Key = tuple[_Question, frozenset[tuple[str, tuple[str, str]]] | str | None]
_WHATEVER = "whatever runs"  # in the place of what runs: any best plan for the situation
KNOWN_PLANS: dict[_Key, Plan] = {}  # of this process
_CRITICAL: dict[_Question, tuple[int, ...]] = {}  # what could be served at best, where only that was requested
_PLANNERS: dict[str, Planner] = {}  # by digest of the spec
_GREEDY: dict[str, Greedy] = {}  # the same


@dataclass(frozen=True, slots=True)
class Prepared:
    """What an aircraft flies with: the tables of its PEs, and the plans made ahead, if there are any."""

    tables: Mapping[str, PeTable]
    made: ContingencyTable | None = None
    numbers: ContingencyNumbers | None = None


PREPARED: dict[tuple[str, int | None], Prepared] = {}  # by digest of the spec: they are the same in every run


def prepared(spec: Spec, faults: int | None) -> Prepared:
    """Compile the tables; with plans for up to so many faults on board, or none at all."""
    known = PREPARED.get((spec.digest, faults))
    if known is None:
        made = None if faults is None else plan_ahead(spec, faults)
        known = PREPARED[spec.digest, faults] = prepared_with(spec, made)
    return known


def prepared_with(spec: Spec, made: Contingencies | None) -> Prepared:
    """Compile the tables, with these plans on board."""
    compiler = Compiler(spec)
    tables = {pe: compiler.table(pe) for pe in spec.pes}
    if made is None:
        return Prepared(tables)
    held = on_board(spec, made)
    with_plans = {one.pe: loaded(tables[one.pe], one) for one in held}
    return Prepared(with_plans, ContingencyTable(spec, made), ContingencyNumbers(spec, made, held))


def plan_ahead(spec: Spec, faults: int) -> Contingencies:
    """Plan for every set of up to so many faults in every phase, as `heronry contingencies` does."""
    scope = Scope(elements(spec), faults, tuple(spec.phases) or (None,))
    return numbered(spec, scope, sweep(spec, scope, None))


class Planners(Enum):
    """The planners behind a manager's planning policy."""

    BEST = "the exact planner"
    IMMEDIATE = "the greedy planner, and for what has time the exact one"
    GREEDY = "the greedy planner"
    ALL = "the greedy planner, the exact one, and a pre-planner"

    def policy(self, spec: Spec, made: ContingencyTable | None) -> PlanningPolicy:
        """Give a new policy with these planners behind it, and with these contingencies."""
        immediate = None if self is Planners.BEST else _greedy(spec)
        return PlanningPolicy(spec, immediate, has_planner=self is not Planners.GREEDY, contingencies=made)


def best_plan(spec: Spec, now: Situation, running: Placement | None) -> Plan:
    """Give the best legal plan; raises InvariantError where the verifier refuses the planner's own."""
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
    """Give some plan that is the best at levels 1 to 3, whatever runs: for oracles."""
    known = KNOWN_PLANS.get((_question(spec, now), _WHATEVER))
    return best_plan(spec, now, None) if known is None else known


def immediate_plan(spec: Spec, now: Situation, running: Placement | None) -> Plan:
    """Give the plan that a manager without a solver flies; raises InvariantError where the verifier refuses it."""
    (decided,) = Planners.GREEDY.policy(spec, None).step(RequestPlan(0, now, running))
    return plan_of(decided)


def plan_of(decided: Instruction) -> Plan:
    """Give the plan that was decided on immediately; raises InvariantError where a greedy plan was refused."""
    match decided:
        case Answer(PlanReady(plan=plan)):
            return plan
        case _:
            raise InvariantError(f"no plan is at hand: {decided}")


def critical_at_best(spec: Spec, now: Situation) -> tuple[int, ...]:
    """Give what could be served at best by criticality (level 1): for an oracle that needs no more."""
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
    """Give the planner of a spec, which is kept between calls."""
    if spec.digest not in _PLANNERS:
        _PLANNERS[spec.digest] = Planner(spec)
    return _PLANNERS[spec.digest]


def _greedy(spec: Spec) -> Greedy:
    """Give the greedy planner of a spec, which is kept between calls."""
    if spec.digest not in _GREEDY:
        _GREEDY[spec.digest] = Greedy(spec)
    return _GREEDY[spec.digest]


def plans_known() -> int:
    """Count the requests for a plan that have been answered in this process."""
    return sum(runs != _WHATEVER for _, runs in KNOWN_PLANS)
