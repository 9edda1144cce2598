"""The exact planner: the best legal configuration of semantics.md, proven level by level.

The model is built once. Each group of levels is maximised, then fixed: later groups may not fall below it. Every
solution is looked at before it counts: one that misses a deadline (rule 9) is cut off and the same group solved again,
so a value is fixed only when a legal configuration has it. A level that already stands at its bound costs no search.

Deterministic: one worker, a fixed seed, no clock. The limit is the solver's own count of its work, `effort`; when it
runs out, the best configuration found so far is returned and the plan says that it is not proven. The empty
configuration is always legal, so there is always a plan.
"""

from ortools.sat.python.cp_model import FEASIBLE, OPTIMAL, CpModel, CpSolver

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, score
from heronry_dg.plan import Plan, make_plan
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation
from heronry_dg.traffic import Hop, hops
from heronry_manager.planner.candidates import Candidates, candidates
from heronry_manager.planner.deadlines import deadline_conflicts
from heronry_manager.planner.levels import Level, level_groups, merged
from heronry_manager.planner.placing import Placing, Terms, weighted
from heronry_manager.planner.publishing import Publishing
from heronry_manager.planner.wiring import Wiring

DEFAULT_EFFORT = 60.0  # deterministic seconds, near real ones on a desktop computer of 2020


class PlannerDefectError(RuntimeError):
    """The planner has caught itself in an error of its own; the message says in which."""


def plan(spec: Spec, now: Situation, running: Placement | None = None, *, effort: float = DEFAULT_EFFORT) -> Plan:
    """Find the best legal configuration for a situation.

    running: what runs now, for the fewest changes (level 4); None: nothing is known to run, and changes are free.
    effort: limit on the search in the solver's deterministic time; it bounds work, not time, so that a plan is the same
    on every machine.
    """
    search = Search(candidates(spec, now), running, ResponseTimes(spec), effort)
    search.run()
    objective = score(spec, now, search.best, running)
    return make_plan(spec, now, search.best, objective, optimal=search.proven)


class Search:
    """One search for one situation; `best` and `proven` are its answer."""

    def __init__(self, possible: Candidates, running: Placement | None, times: ResponseTimes, effort: float) -> None:
        """Build the model."""
        self.best = Configuration()
        self.proven = True
        self._possible = possible
        self._effort = effort
        self._times = times
        self._forbidden: set[frozenset[Hop]] = set()
        self._model = CpModel()
        self._placing = Placing(self._model, possible)
        self._wiring = Wiring(self._model, possible, self._placing)
        self._publishing = Publishing(self._model, possible, self._placing, self._wiring)
        self._groups = level_groups(self._placing, self._wiring, self._publishing, running)
        self._values = [0] * len(self._model.proto.variables)  # of `best`: the empty configuration is all zeros

    def run(self, groups: int | None = None) -> None:
        """Solve group after group of levels: the first `groups` ones, or all."""
        for group in self._groups[:groups]:
            open_levels = self._fix_leading_at_bound(group)
            if not open_levels:
                continue
            self.proven &= self._maximise(open_levels)
            for level in open_levels:
                self._fix(level)

    def _fix_leading_at_bound(self, group: list[Level]) -> list[Level]:
        """Fix the first levels of a group as far as they already stand at their bounds; return the others."""
        for number, level in enumerate(group):
            if _sum(level.terms, self._values) < level.high:
                return group[number:]
            self._fix(level)
        return []

    def _fix(self, level: Level) -> None:
        self._model.add(weighted(level.terms) >= _sum(level.terms, self._values))

    def _maximise(self, group: list[Level]) -> bool:
        """Search the best of a group of levels; tell whether it is proven to be the best."""
        goal = merged(group)
        self._model.maximize(weighted(goal))
        while self._effort > 0:
            solver = _solver(self._effort / 2)  # half of what is left: later levels want their share
            self._hint()
            status = solver.solve(self._model)
            self._effort -= solver.response_proto.deterministic_time
            if status not in (OPTIMAL, FEASIBLE):
                return False
            found = self._configuration(solver)
            conflicts = deadline_conflicts(self._times, hops(self._possible.left, found))
            for messages in conflicts:
                self._forbid(messages)
            if conflicts:
                continue
            self._take(found, list(solver.response_proto.solution), goal)
            return status == OPTIMAL
        return False

    def _forbid(self, messages: frozenset[Hop]) -> None:
        """Cut off what misses a deadline; a cut that did not hold would be found again for ever."""
        if messages in self._forbidden:
            raise PlannerDefectError(
                f"these were forbidden together and are planned again: {sorted(map(str, messages))}"
            )
        self._forbidden.add(messages)
        self._publishing.forbid_together(messages)

    def _hint(self) -> None:
        """Start the search from the best configuration so far."""
        self._model.proto.clear_solution_hint()
        if self.best.modules:
            hint = self._model.proto.solution_hint
            hint.vars.extend(range(len(self._values)))
            hint.values.extend(self._values)

    def _take(self, found: Configuration, values: list[int], goal: Terms) -> None:
        """Keep a legal configuration, unless a search cut short found a worse one."""
        if _sum(goal, values) >= _sum(goal, self._values):
            self.best, self._values = found, values

    def _configuration(self, solver: CpSolver) -> Configuration:
        """Read a solution."""
        inputs: dict[str, dict[str, Wire]] = {}
        for (consumer, mode, path), wires in self._wiring.wires.items():
            if solver.boolean_value(self._placing.on[consumer, mode]):
                for source, leaf, literal in wires:
                    if solver.boolean_value(literal):
                        wire = Wire(source.module, leaf.variable, source.version)
                        inputs.setdefault(consumer, {})[path] = wire
        return Configuration(
            {
                name: Running(pe, mode, inputs.get(name, {}))
                for (name, mode, pe), literal in self._placing.x.items()
                if solver.boolean_value(literal)
            }
        )


def _sum(terms: Terms, values: list[int]) -> int:
    return sum(worth for literal, worth in terms if values[literal.index])


def _solver(effort: float) -> CpSolver:
    """Set up one search: measured to suit problems of 30 to 60 modules, and deterministic."""
    solver = CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = 0
    solver.parameters.max_deterministic_time = effort
    solver.parameters.absolute_gap_limit = 0.0  # a gap is computed in floating point; merged levels outgrow it
    solver.parameters.symmetry_level = 0
    solver.parameters.linearization_level = 2
    solver.parameters.cp_model_probing_level = 0
    solver.parameters.max_presolve_iterations = 1
    return solver
