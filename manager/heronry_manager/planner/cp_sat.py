"""CP-SAT, the solver of OR-Tools, loaded without pandas; all modules of the planner import the solver from here.

The Python interface of CP-SAT imports pandas for functions that take pandas series. This project calls none of these
functions. But the import of pandas takes longer than all other imports of a planner's process together. So an empty
module takes the place of pandas while CP-SAT is imported. Afterwards pandas can be imported as usual.

CP-SAT gets the true pandas in two cases: a program has imported pandas before, or a release of OR-Tools cannot be
imported with the empty module.
"""

import sys
from contextlib import suppress
from importlib import import_module
from types import ModuleType
from typing import Final

_INTERFACE: Final = "ortools.sat.python.cp_model"


def load_without_pandas(module: str) -> None:
    """Import a module that needs only the types of pandas, while an empty module takes the place of pandas.

    If the module needs more of pandas, this import fails without an error. The caller's own import of the module then
    uses the true pandas.
    """
    if "pandas" in sys.modules:
        return
    sys.modules["pandas"] = stand_in = ModuleType("pandas")
    stand_in.__dict__["Series"] = stand_in.__dict__["Index"] = type("Series", (), {})
    try:
        with suppress(ImportError, AttributeError):
            import_module(module)
    finally:
        del sys.modules["pandas"]


load_without_pandas(_INTERFACE)

from ortools.sat.python.cp_model import (  # noqa: E402 - the second import finds what the first one has loaded
    FEASIBLE,
    INFEASIBLE,
    OPTIMAL,
    CpModel,
    CpSolver,
    CpSolverStatus,
    IntVar,
    LinearExpr,
)

__all__ = ["FEASIBLE", "INFEASIBLE", "OPTIMAL", "CpModel", "CpSolver", "CpSolverStatus", "IntVar", "LinearExpr"]
