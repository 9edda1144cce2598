"""The solver is loaded without pandas, which takes longer to import than it, and is there for others afterwards."""

import subprocess
import sys
from pathlib import Path

import pytest


def run(program: str) -> None:
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_planner_has_no_pandas_and_a_program_that_imports_it_gets_the_true_one() -> None:
    run(
        "import sys, heronry_manager.planner.exact\n"
        "assert 'pandas' not in sys.modules\n"
        "import pandas\n"
        "assert pandas.Series([1, 2]).sum() == 3"
    )


def test_where_pandas_was_imported_before_the_solver_has_it() -> None:
    run(
        "import pandas; from heronry_manager.planner import cp_sat; from ortools.sat.python import cp_model as c\n"
        "assert c.pd is pandas"
    )


@pytest.mark.parametrize("needed", ["import pandas.api", "import pandas; pandas.DataFrame"])
def test_a_module_that_needs_more_of_pandas_is_left_to_be_imported_with_it(needed: str, tmp_path: Path) -> None:
    (tmp_path / "needs_pandas.py").write_text(needed)
    run(
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        "from heronry_manager.planner.cp_sat import load_without_pandas\n"
        "load_without_pandas('needs_pandas')\n"
        "assert {'needs_pandas', 'pandas'}.isdisjoint(sys.modules)"
    )
