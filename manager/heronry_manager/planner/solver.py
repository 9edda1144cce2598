"""The settings of CP-SAT for every search: deterministic, and chosen by measurements on specs of 30 to 60 modules."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from heronry_manager.planner.cp_sat import CpSolver
from heronry_manager.planner.levels import Kind

_SHORT_EFFORT: Final = {Kind.SERVING: 0.1, Kind.SUPPLYING: 0.3}


def searches(kind: Kind) -> Iterator[Callable[[float], CpSolver]]:
    """Yield the searches for levels of this kind, the short ones first.

    A search is a function that sets up a solver; its argument is the limit of the search, in deterministic time.

        short search    SERVING and SUPPLYING: if some configuration reaches the bound of the linear
                        relaxation, this search soon finds it
        core search     SUPPLYING: deadlines, places and CPU together may exclude every configuration that
                        reaches the bound. For this case the core search looks for sets of inputs that cannot
                        be wired together
        full search     all kinds: searches the whole model
    """
    if kind is Kind.SERVING:
        yield lambda effort: light_solver(min(effort, _SHORT_EFFORT[kind]))
    if kind is Kind.SUPPLYING:
        yield lambda effort: new_solver(kind, min(effort, _SHORT_EFFORT[kind]))
        yield core_solver
    yield partial(new_solver, kind)


def new_solver(kind: Kind, effort: float) -> CpSolver:
    """Set up a search of the whole model, with more probing than `light_solver`.

    kind: the kind of the levels for which the search is made; for SERVING, the presolve is longer, too.
    effort: limit of the search, in deterministic time.
    """
    solver = light_solver(effort)
    solver.parameters.cp_model_probing_level = 2
    if kind is Kind.SERVING:  # thorough presolve, since choosing and packing have failed
        solver.parameters.max_presolve_iterations = 3
    return solver


def core_solver(effort: float) -> CpSolver:
    """Set up a search that finds sets of inputs that cannot be wired together.

    The search does not use the linear relaxation, which gives no bound for such sets.

    effort: limit of the search, in deterministic time.
    """
    solver = light_solver(effort)
    solver.parameters.optimize_with_core = True
    solver.parameters.core_minimization_level = 1
    solver.parameters.linearization_level = 0
    return solver


def plain_solver(effort: float) -> CpSolver:
    """Set up a search that gives the same result on every machine; `effort`: its limit, in deterministic time.

    CP-SAT's own handler of SIGINT is switched off. It would end the search early, and the caller would take the best
    result so far for the final result.
    """
    solver = CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.catch_sigint_signal = False
    solver.parameters.random_seed = 0
    solver.parameters.max_deterministic_time = effort
    return solver


def light_solver(effort: float) -> CpSolver:
    """Set up a search with little presolve; `effort`: its limit, in deterministic time."""
    solver = plain_solver(effort)
    solver.parameters.absolute_gap_limit = 0.0  # a gap is computed in floating point; merged levels outgrow it
    solver.parameters.symmetry_level = 0
    solver.parameters.cut_level = 0
    solver.parameters.max_presolve_iterations = 1
    solver.parameters.linearization_level = 2  # gives the bound that proves utility when not all functions fit
    solver.parameters.cp_model_probing_level = 0
    return solver


def packing_solvers(effort: float) -> Iterator[CpSolver]:
    """Yield two searches with different settings; the second may find a solution where the first finds none.

    Both searches keep every value that the model's hint gives: which modules run, and in which modes.
    effort: the limit of each search, in deterministic time.
    """
    quick = light_solver(effort)
    quick.parameters.linearization_level = 1
    for solver in (new_solver(Kind.SERVING, effort), quick):
        solver.parameters.fix_variables_to_their_hinted_value = True
        yield solver
