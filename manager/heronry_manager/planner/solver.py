"""How CP-SAT is set up for every search: measured to suit problems of 30 to 60 modules, and deterministic."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from ortools.sat.python.cp_model import CpSolver

from heronry_manager.planner.levels import Kind

_SHORT_EFFORT: Final = {Kind.SERVING: 0.1, Kind.SUPPLYING: 0.3}


def searches(kind: Kind) -> Iterator[Callable[[float], CpSolver]]:
    """Return the ways to search everything for levels of a kind, short ones first: each takes an effort, its limit.

    A configuration that serves all that the linear relaxation allows is found soon. Where deadlines, hosts and CPU
    together forbid some of it, the relaxation does not see that, and sets of inputs are looked for that cannot all be
    had.
    """
    if kind is Kind.SERVING:
        yield lambda effort: light_solver(min(effort, _SHORT_EFFORT[kind]))
    if kind is Kind.SUPPLYING:
        yield lambda effort: new_solver(kind, min(effort, _SHORT_EFFORT[kind]))
        yield core_solver
    yield partial(new_solver, kind)


def new_solver(kind: Kind, effort: float) -> CpSolver:
    """Set up a search over everything for levels of a kind. `effort`: its limit, in deterministic time."""
    solver = light_solver(effort)
    solver.parameters.cp_model_probing_level = 2
    if kind is Kind.SERVING:  # what choosing and packing have left open is worth a long look beforehand
        solver.parameters.max_presolve_iterations = 3
    return solver


def core_solver(effort: float) -> CpSolver:
    """Set up a search for sets of terms that cannot all be had: what the linear relaxation does not bound."""
    solver = light_solver(effort)
    solver.parameters.optimize_with_core = True
    solver.parameters.core_minimization_level = 1
    solver.parameters.linearization_level = 0
    return solver


def light_solver(effort: float) -> CpSolver:
    """Set up a search that loses no time on preparations."""
    solver = CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.catch_sigint_signal = False  # it would end the search, and give a worse plan as the best one
    solver.parameters.random_seed = 0
    solver.parameters.max_deterministic_time = effort
    solver.parameters.absolute_gap_limit = 0.0  # a gap is computed in floating point; merged levels outgrow it
    solver.parameters.symmetry_level = 0
    solver.parameters.cut_level = 0
    solver.parameters.max_presolve_iterations = 1
    solver.parameters.linearization_level = 2  # the bound that proves utility where there is too much work
    solver.parameters.cp_model_probing_level = 0
    return solver


def packing_solvers(effort: float) -> Iterator[CpSolver]:
    """Set up searches for places alone, all else being fixed by a hint: where the first one fails, the next may not."""
    quick = light_solver(effort)
    quick.parameters.linearization_level = 1
    for solver in (new_solver(Kind.SERVING, effort), quick):
        solver.parameters.fix_variables_to_their_hinted_value = True
        yield solver
