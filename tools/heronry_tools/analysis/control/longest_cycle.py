"""The longest component-cycle of a block of a component graph, found with the solver CP-SAT.

The terms are those of heronry_pcs.cycles, where the members of a graph are its components:

    component-cycle   a path of three or more members whose last member is a neighbor of the first
    block             a largest set of members that stays connected whichever one of them is removed

The solver's model is one circuit (AddCircuit). It has an arc in each direction between any two neighbors. A member that
the cycle may leave out has a loop. Of the two arcs between two members at most one is used, since a path there and back
is no cycle.

The search ends when the solver has done as much work as `effort` allows. The solver counts this work itself, so the
bounds are the same on every machine. If the search ends before a cycle is proven to be the longest, the lower and the
upper bound differ.
"""

from typing import Final

from heronry_manager.planner.cp_sat import FEASIBLE, INFEASIBLE, OPTIMAL, CpModel, CpSolver, CpSolverStatus
from heronry_manager.planner.solver import plain_solver
from heronry_pcs.cycles import LEAST_CYCLE, Bounds, Touching, bounds_alone

EFFORT: Final = 5.0  # deterministic seconds for one block; blocks of 200 members are proven in less
MOST_MEMBERS: Final = 400  # of a block that is searched: in a larger one the search finds nothing in that time


def longest_cycle(block: Touching, through: frozenset[str], effort: float = EFFORT) -> Bounds:
    """Find bounds for the length of the longest of those cycles of a block that pass through all of `through`.

    through: the members through which the cycle must pass.

    Returns the lower and the upper bound. They are equal if a cycle is proven to be the longest, and (0, 0) if there is
    no such cycle. A block of more than `MOST_MEMBERS` is not searched, and gets the bounds that `bounds_alone` gives.

    The function serves as `Search` of heronry_pcs.cycles.
    """
    if len(block) > MOST_MEMBERS:
        return bounds_alone(block, through)
    model = CpModel()
    number = {name: index for index, name in enumerate(block)}
    arcs = {
        (number[name], number[other]): model.new_bool_var("") for name, touching in block.items() for other in touching
    }
    left_out = {name: model.new_bool_var("") for name in block if name not in through}
    model.add_circuit(
        [(start, end, used) for (start, end), used in arcs.items()]
        + [(number[name], number[name], skipped) for name, skipped in left_out.items()]
    )
    for (start, end), used in arcs.items():
        if start < end:
            model.add_at_most_one(used, arcs[end, start])
    model.maximize(len(block) - sum(left_out.values()))
    solver = plain_solver(effort)
    return _bounds(solver, solver.solve(model), bounds_alone(block, through))


def _bounds(solver: CpSolver, status: CpSolverStatus, known: Bounds) -> Bounds:
    least, most = known
    if status == INFEASIBLE:
        return 0, 0
    if status not in (OPTIMAL, FEASIBLE):
        return known
    least, most = max(least, round(solver.objective_value)), min(most, round(solver.best_objective_bound))
    return (least, most) if most >= LEAST_CYCLE else (0, 0)
