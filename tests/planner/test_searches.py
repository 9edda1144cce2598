"""All strategies of a complete search prove the same; what one leaves open, the next one decides."""

import random
from collections.abc import Callable, Iterator

import pytest

from heronry_manager.planner import exact
from heronry_manager.planner.cp_sat import CpSolver
from heronry_manager.planner.exact import plan
from heronry_manager.planner.levels import Kind
from heronry_manager.planner.solver import core_solver, light_solver, new_solver
from planner.random_specs import random_case


def alone(way: Callable[[float], CpSolver]) -> Callable[[Kind], Iterator[Callable[[float], CpSolver]]]:
    """Return the ways, where this is the only one."""
    return lambda _: iter([way])


@pytest.mark.parametrize("way", [core_solver, light_solver])
def test_one_way_alone_proves_the_same(way: Callable[[float], CpSolver], monkeypatch: pytest.MonkeyPatch) -> None:
    searched = 0
    for seed in range(40):
        case = random_case(random.Random(seed))
        usual = plan(case.spec, case.now, case.running)
        with monkeypatch.context() as patch:
            patch.setattr(exact, "searches", alone(way))
            other = plan(case.spec, case.now, case.running)
            patch.setattr(exact, "searches", lambda _: iter(()))
            searched += not plan(case.spec, case.now, case.running).optimal
        assert usual.optimal
        assert other.optimal
        assert other.objective == usual.objective, f"seed {seed}"
    assert searched > 5


def test_a_search_by_cores_goes_on_where_the_first_one_ends_without_a_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    used: list[bool] = []

    def short(effort: float) -> CpSolver:
        used.append(False)
        return new_solver(Kind.SUPPLYING, min(effort, 1e-9))

    def cores(effort: float) -> CpSolver:
        used.append(True)
        return core_solver(effort)

    monkeypatch.setattr(exact, "searches", lambda kind: iter([short, cores] if kind is Kind.SUPPLYING else [cores]))
    for seed in range(40):
        case = random_case(random.Random(seed))
        assert plan(case.spec, case.now, case.running).optimal, f"seed {seed}"
    assert used.count(False) > 2
    assert used.count(True) > 2
