"""The settings of CP-SAT."""

from pathlib import Path

import pytest

import heronry_manager
import heronry_pcs
import heronry_tools
from heronry_manager.planner.levels import Kind
from heronry_manager.planner.solver import core_solver, new_solver, plain_solver


@pytest.mark.parametrize("solver", [plain_solver(1.0), core_solver(1.0), *(new_solver(kind, 1.0) for kind in Kind)])
def test_no_search_ends_by_itself_when_an_interrupt_comes(solver) -> None:
    assert not solver.parameters.catch_sigint_signal


def test_every_search_is_set_up_by_one_function() -> None:
    """A solver with the usual settings ends its search on SIGINT, and a worse result would be given as the answer."""
    homes = [Path(package.__file__).parent for package in (heronry_pcs, heronry_manager, heronry_tools)]
    found = [path.name for home in homes for path in home.rglob("*.py") if "CpSolver()" in path.read_text()]
    assert found == ["solver.py"]
