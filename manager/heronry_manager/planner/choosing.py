"""Choose first, then pack: levels 1 and 2 when not all wanted functions fit on the PEs.

A *choice* says which modules run, and in which modes, but not on which PEs.

    choose   Find the best choice, as if all PEs that can run a mode were one large PE. This problem is small: some
             hundred literals. A legal configuration is never better than the best choice, so the value of the best
             choice is an upper bound on levels 1 and 2. As a rule a legal configuration reaches this bound
    pack     Of all choices with this value, take the one that needs the least CPU, since it leaves the most room. The
             search then fixes this choice in its own model, and has to find only the PEs

A module cannot be divided between PEs. So a choice may not fit on the PEs, although all of them together have enough
room. If no packing of the cheapest choice is found, another choice of the same or a lower value may fit. The search
over modules and PEs together looks for it. That search takes longer to prepare, because its model also has constraints
that exclude combinations of modules that do not fit on one PE.
"""

from collections.abc import Mapping, Sequence
from typing import Final

from heronry_manager.planner.candidates import Candidates
from heronry_manager.planner.cp_sat import OPTIMAL, CpModel, CpSolver, LinearExpr
from heronry_manager.planner.levels import Level, merged, serving_levels
from heronry_manager.planner.placing import Choice, weighted
from heronry_manager.planner.solver import light_solver
from heronry_manager.planner.wiring import Wiring

PACKING_EFFORT: Final = 0.03  # deterministic seconds; an existing packing is found in less
_CHOOSING_EFFORT: Final = 0.1

Chosen = Mapping[tuple[str, str], bool]
"""Module and mode -> whether the module runs in the mode."""


class Choosing(Choice):
    """The solver model that chooses, for one situation, which modules run and in which modes, but not where."""

    def __init__(self, possible: Candidates, group: Sequence[Level], key: Sequence[int]) -> None:
        """Build the small model, in which modules and modes are chosen but not placed.

        group: the levels to maximise, merged into one sum.
        key: a value for each level, by position. At each level before the group, a choice must not be worse than this.
        """
        super().__init__(CpModel(), possible)
        self.spent = 0.0  # deterministic time
        self._add_modules()
        self._one_of_rivals()
        self._add_capacities()
        Wiring(self._model, possible, self)
        self._worth = self._aim(group, key)

    def bound(self) -> int | None:
        """Return an upper bound of the sum into which the levels of the constructor's `group` are merged.

        From then on, choices whose sum is below this bound are ruled out.

        None: the effort was used up before the best sum was proven; no choice is ruled out then.
        """
        self._model.maximize(self._worth)
        solver = self._solved()
        if solver is None:
            return None
        bound = -solver.response_proto.inner_objective_lower_bound
        self._model.add(self._worth >= bound)
        return bound

    def cheapest(self) -> Chosen | None:
        """Find the choice that takes the least CPU among those that `bound` has not ruled out.

        Call `bound` first. None: the effort was used up before a choice was proven to be the cheapest one.
        """
        modules = self.possible.spec.modules
        cpu = [(literal, modules[name].modes[mode].cpu_millis) for (name, mode), literal in self.on.items()]
        self._model.minimize(weighted(cpu))
        solver = self._solved()
        return None if solver is None else {key: solver.boolean_value(literal) for key, literal in self.on.items()}

    def _solved(self) -> CpSolver | None:
        solver = light_solver(_CHOOSING_EFFORT)
        status = solver.solve(self._model)
        self.spent += solver.response_proto.deterministic_time
        return solver if status == OPTIMAL else None

    def _add_modules(self) -> None:
        for name, candidate in self.possible.modules.items():
            for mode in candidate.hosts:
                self.on[name, mode] = self._model.new_bool_var(f"{name}.{mode}")
            self.runs[name] = self._sum([self.on[name, mode] for mode in candidate.hosts], name)

    def _add_capacities(self) -> None:
        """Let choices take no more CPU, memory and flash than the PEs have.

        One limit is for all modes, on all PEs together. Each mode gives another limit, for the set of PEs that can
        run this mode: all modes that can run only on PEs of this set must fit on these PEs together.
        """
        modules = self.possible.modules
        everywhere = frozenset(self.possible.left.pe_cpu_millis)
        hosts = {frozenset(pes) for candidate in modules.values() for pes in candidate.hosts.values()}
        for pes in sorted(hosts | {everywhere}, key=sorted):
            modes = [(name, mode) for name, mode in self.on if pes.issuperset(modules[name].hosts[mode])]
            self._fits_in(pes, modes, [name for name, candidate in modules.items() if pes.issuperset(candidate.pes())])

    def _aim(self, group: Sequence[Level], key: Sequence[int]) -> LinearExpr:
        levels = {level.position: level for level in serving_levels(self)}
        for position, level in levels.items():
            if position < group[0].position and level.terms:
                self._model.add(weighted(level.terms) >= level.value(key))
        return weighted(merged([levels[level.position] for level in group]))
