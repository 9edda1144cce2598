"""The exact planner: the best legal configuration by docs/semantics.md, proven level by level.

The planner starts from the greedy plan, builds one model for the solver, and takes the groups of levels in their order:

1. It maximises the value of the group. Each solution is analysed before it counts. If a solution misses a deadline
   (semantics rule 9), the model excludes it, and the group is solved again.
2. It fixes the best value that a legal configuration has reached: later groups must not make this value worse.

A level whose value has reached its upper bound needs no search. As a rule this is so for the levels of the functions
(levels 1 and 2), since the greedy plan serves all that can be served. If the greedy plan serves less, the planner
first chooses which modules run, and then finds PEs for them (`choosing`). If this result is below the bound, the
planner searches over all modules and PEs together.

The planner is deterministic: one worker, a fixed seed, no clock. The search is limited by the solver's own count of
its work, `effort`. When this limit is reached, the planner returns the best configuration found so far; the plan then
says for each level whether its value is proven, or how good the value could be. There is always a plan: at worst the
greedy one.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.model import Spec
from heronry_dg.objective import Objective, Placement, score_among
from heronry_dg.plan import Plan, plan_with_bounds
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation
from heronry_dg.traffic import hops
from heronry_manager.planner.candidates import Candidates, candidates
from heronry_manager.planner.choosing import PACKING_EFFORT, Choosing, Chosen
from heronry_manager.planner.cp_sat import FEASIBLE, OPTIMAL, CpModel, CpSolver
from heronry_manager.planner.deadlines import Deadlines
from heronry_manager.planner.greedy.planner import Greedy
from heronry_manager.planner.levels import Kind, Level, bounds_of, level_groups, merged
from heronry_manager.planner.placing import Placing, weighted
from heronry_manager.planner.publishing import Publishing
from heronry_manager.planner.solver import packing_solvers, searches
from heronry_manager.planner.wiring import Wiring

DEFAULT_EFFORT = 60.0  # deterministic seconds, near real ones on a desktop computer of 2020

NOTHING: Final = Configuration()


class Planner:
    """The exact planner of one spec; what does not depend on the situation is worked out once."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        self._times = ResponseTimes(spec)
        self._greedy = Greedy(spec)

    def plan(self, now: Situation, running: Placement | None = None, *, effort: float = DEFAULT_EFFORT) -> Plan:
        """Find the best legal configuration for a situation.

        running: the running configuration, for the fewest changes (level 4); None: it is not known, so changes do not
        count.
        effort: limit of the search, in the solver's own count of its work (`deterministic_time`). The work is limited
        and not the time, so that a plan is the same on every machine.
        """
        search = self.solved(now, running, effort=effort)
        return plan_with_bounds(self.spec, now, search.best, search.objective, search.bounds())

    def solved(self, now: Situation, running: Placement | None = None, *, effort: float = DEFAULT_EFFORT) -> "Search":
        """Search as `plan` does, but return the finished search instead of a `Plan`."""
        search = self._search(now, running, effort)
        search.run()
        return search

    def immediate(self, now: Situation, running: Placement | None = None) -> Plan:
        """Find a legal configuration without a search, by the greedy planner.

        running: the running configuration; None: it is not known.
        """
        return self._greedy.plan(now, running)

    def serve(self, now: Situation, running: Placement | None = None, *, effort: float = DEFAULT_EFFORT) -> "Search":
        """Search for levels 1 and 2 alone (critical functions and utility); return the finished search.

        The arguments are those of `plan`.
        """
        search = self._search(now, running, effort)
        search.serve()
        return search

    def _search(self, now: Situation, running: Placement | None, effort: float) -> "Search":
        first = self.immediate(now, running)
        possible = candidates(self.spec, now)
        return Search(possible, running, self._times, effort, first.configuration, worth=first.objective)


def plan(spec: Spec, now: Situation, running: Placement | None = None, *, effort: float = DEFAULT_EFFORT) -> Plan:
    """Find the best legal configuration for one situation; see `Planner.plan`."""
    return Planner(spec).plan(now, running, effort=effort)


class Search:
    """One search for one situation.

    best: the best legal configuration found so far.
    objective: its value.
    bounds: an upper bound for each integer of `objective.key()`.
    """

    def __init__(
        self,
        possible: Candidates,
        running: Placement | None,
        times: ResponseTimes,
        effort: float,
        first: Configuration = NOTHING,
        *,
        worth: Objective | None = None,
    ) -> None:
        """Build the model. `first`: a legal configuration to start from; `worth`: its objective, if it is known."""
        self._possible = possible
        self._running = running
        self._effort = effort
        self._model = CpModel()
        self._placing = Placing(self._model, possible)
        self._wiring = Wiring(self._model, possible, self._placing)
        self._publishing = Publishing(self._model, possible, self._placing, self._wiring)
        self._deadlines = Deadlines(self._model, self._publishing, times)
        self._groups = level_groups(self._placing, self._wiring, self._publishing, running)
        self._bounds = {level.position: level.high for group in self._groups for level in group}
        self._looked_at: list[Level] = []
        self._values: dict[int, int] = {}  # variable of the model -> its value in `best`
        self._start_from(first, self._score(first) if worth is None else worth)

    @property
    def proven(self) -> bool:
        """Tell whether `best` is proven to be the best one in all levels that were searched."""
        return self._is_at_bound(self._looked_at)

    def run(self, groups: int | None = None) -> None:
        """Solve the first `groups` groups of levels, one after the other; None: all groups."""
        self._looked_at = [level for group in self._groups[:groups] for level in group]
        for group in self._groups[:groups]:
            open_levels = self._fix_leading_at_bound(group)
            if open_levels:
                self._maximise(open_levels)
                for level in open_levels:
                    self._fix(level)

    def serve(self) -> None:
        """Improve only the values of levels 1 and 2; the levels after them are not searched."""
        self.run(sum(group[0].kind is Kind.SERVING for group in self._groups))

    def bounds(self) -> tuple[int, ...]:
        """Return an upper bound for each integer of `objective.key()`.

        A bound holds for all configurations in which no earlier integer of the key is worse than that of `best`.
        """
        levels = {level.position: level for group in self._groups for level in group}
        return tuple(
            self._bounds[position] + levels[position].offset if position in levels else value
            for position, value in enumerate(self._key)
        )

    def _fix_leading_at_bound(self, group: list[Level]) -> list[Level]:
        """Fix the first levels of a group, as long as they stand at their bounds already.

        Return the first level that does not stand at its bound, and all levels of the group after this level.
        """
        for number, level in enumerate(group):
            if level.value(self._key) < level.high:
                return group[number:]
            self._fix(level)
        return []

    def _fix(self, level: Level) -> None:
        self._model.add(weighted(level.terms) >= level.value(self._key))

    def _maximise(self, group: list[Level]) -> None:
        kind = group[0].kind
        if kind is Kind.SERVING and self._effort > 0:
            self._choose_and_pack(group)
            if self._is_at_bound(group):
                return
            self._placing.count_parts()
        self._model.maximize(weighted(merged(group)))
        for set_up in searches(kind):
            self._search(group, set_up)

    def _search(self, group: list[Level], set_up: Callable[[float], CpSolver]) -> None:
        """Search for better values of a group of levels, in several attempts.

        The attempts end when a solution meets all deadlines of its messages, when an attempt finds no solution,
        when the levels are at their bounds, or when the effort is used up.

        set_up: makes the solver of each attempt; gets the effort that the attempt may use.
        """
        while self._effort > 0 and not self._is_at_bound(group):
            solver = set_up(self._effort / 2)  # half of what is left: later levels need their share
            self._hint(self._values)
            in_time = self._look(solver)
            if in_time is None:
                return
            self._bound(group, -solver.response_proto.inner_objective_lower_bound)
            if in_time:
                return

    def _choose_and_pack(self, group: list[Level]) -> None:
        """Find an upper bound for a group of levels by choosing modules, but no PEs for them.

        Then try to find PEs for the chosen modules.
        """
        choosing = Choosing(self._possible, group, self._key)
        bound = choosing.bound()
        if bound is not None:
            self._bound(group, bound)
            chosen = None if self._is_at_bound(group) else choosing.cheapest()
            if chosen is not None:
                self._pack(chosen)
                self._bound(group, bound)
        self._effort -= choosing.spent

    def _pack(self, chosen: Chosen) -> None:
        self._model.proto.clear_objective()
        self._hint({self._placing.on[key].index: is_on for key, is_on in chosen.items()})
        for solver in packing_solvers(PACKING_EFFORT):
            in_time: bool | None = False
            while in_time is False and self._effort > 0:
                in_time = self._look(solver)
            if in_time:
                return

    def _look(self, solver: CpSolver) -> bool | None:
        """Search once, and keep the solution if it meets its deadlines and is better than the best one so far.

        Tells whether the solution meets its deadlines. None: no solution was found.
        """
        status = solver.solve(self._model)
        self._effort -= solver.response_proto.deterministic_time
        if status not in (OPTIMAL, FEASIBLE):
            return None
        found = self._configuration(solver)
        in_time = self._deadlines.are_met(frozenset(hops(self._possible.left, found)))
        if in_time:
            self._take(found, solver.response_proto.solution)
        return in_time

    def _is_at_bound(self, group: list[Level]) -> bool:
        return all(level.value(self._key) == self._bounds[level.position] for level in group)

    def _bound(self, group: list[Level], bound: int) -> None:
        """Lower the upper bounds of a group of levels by what was proven for the sum into which they are merged."""
        for level, most in zip(group, bounds_of(group, bound, self._key), strict=True):
            self._bounds[level.position] = min(most, self._bounds[level.position])

    def _hint(self, values: Mapping[int, int]) -> None:
        """Let the next search of the solver start from these values.

        values: index of a variable of the model -> its value.
        """
        self._model.proto.clear_solution_hint()
        hint = self._model.proto.solution_hint
        hint.vars.extend(values.keys())
        hint.values.extend(values.values())

    def _start_from(self, first: Configuration, worth: Objective) -> None:
        self.best, self.objective = first, worth
        if first.modules:
            published = frozenset(hops(self._possible.left, first))
            self._deadlines.know(published)
            for part in (
                self._placing.hint(first),
                self._wiring.hint(first),
                self._publishing.hint(published),
            ):
                self._values.update((literal.index, value) for literal, value in part)

    def _take(self, found: Configuration, values: Sequence[int]) -> None:
        """Keep a legal configuration if it is better than the best one so far.

        values: the values of all variables of the model in this configuration; they are kept with it.
        """
        objective = self._score(found)
        if objective.key() > self._key:
            self.best, self.objective = found, objective
            self._values = dict(enumerate(values))

    def _score(self, configuration: Configuration) -> Objective:
        return score_among(self._possible.left, self._possible.now, configuration, self._running)

    @property
    def _key(self) -> tuple[int, ...]:
        return self.objective.key()

    def _configuration(self, solver: CpSolver) -> Configuration:
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
