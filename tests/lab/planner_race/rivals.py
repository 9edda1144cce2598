"""Other solvers on the same problem: untuned CP-SAT here, HiGHS in its own process.

Both maximise the goals of a `Milp` with one thread and no gap: CP-SAT as one weighted sum, which it counts in 64 bits,
HiGHS one after the other, since it counts in floating point. The deadlines of a solution are checked as the planner
checks its own; a solution that misses one is cut off and the problem solved again. `cpu_seconds` counts all work of the
solver, with the building of its model; stating the problem, checking deadlines, and the transport to the other process
are not counted.
"""

import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from types import TracebackType
from typing import Self

from heronry_dg.configuration import Configuration
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation
from heronry_dg.traffic import hops
from heronry_manager.planner.candidates import candidates
from heronry_manager.planner.cp_sat import FEASIBLE, OPTIMAL, CpModel, CpSolver, LinearExpr
from heronry_manager.planner.deadlines import deadline_conflicts
from lab.planner_race.milp import Milp, Terms

SECONDS = 20  # for one goal; wall-clock, for rivals only


@dataclass(frozen=True, slots=True)
class Solved:
    """The result of a solver."""

    ones: list[int]
    proven: bool
    cpu_seconds: float


@dataclass(frozen=True, slots=True)
class Answer:
    """A configuration that keeps all deadlines, and its CPU time."""

    configuration: Configuration
    proven: bool
    cpu_seconds: float


Solver = Callable[[Milp], Solved]


def answered(solver: Solver, times: ResponseTimes, now: Situation) -> Answer:
    """Solve levels 1 and 2 of a situation."""
    possible = candidates(times.spec, now)
    milp, cpu_seconds, proven = Milp(possible), 0.0, True
    while True:
        solved = solver(milp)
        cpu_seconds += solved.cpu_seconds
        proven &= solved.proven
        found = milp.configuration(solved.ones)
        conflicts = deadline_conflicts(times, hops(possible.left, found))
        if not conflicts:
            return Answer(found, proven, cpu_seconds)
        for messages in conflicts:
            milp.forbid(messages)


def cp_sat(milp: Milp) -> Solved:
    """Solve a problem by CP-SAT with its default options, but for the number of workers."""
    start = time.process_time()
    model = CpModel()
    variables = [model.new_bool_var("") for _ in range(milp.count)]

    def total(terms: Terms) -> LinearExpr:
        return LinearExpr.weighted_sum([variables[v] for v, _ in terms], [weight for _, weight in terms])

    for row in milp.rows:
        if row.low is not None:
            model.add(total(row.terms) >= row.low)
        if row.high is not None:
            model.add(total(row.terms) <= row.high)
    solver = CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.max_time_in_seconds = SECONDS
    model.maximize(total(_one_sum(milp.goals)))
    status = solver.solve(model)
    ones: list[int] = []
    if status in (OPTIMAL, FEASIBLE):
        ones = [number for number, variable in enumerate(variables) if solver.boolean_value(variable)]
    return Solved(ones, status == OPTIMAL, time.process_time() - start)


def _one_sum(goals: list[Terms]) -> Terms:
    """Weigh the goals so that each outweighs all that come after it."""
    weights: Counter[int] = Counter()
    weight = 1
    for goal in reversed(goals):
        for variable, worth in goal:
            weights[variable] += weight * worth
        weight *= sum(worth for _, worth in goal) + 1
    return sorted(weights.items())


class Highs:
    """HiGHS with its default options; a context manager, which ends its process."""

    def __init__(self) -> None:
        """Start the process; raises ModuleNotFoundError where highspy is not installed."""
        if find_spec("highspy") is None:
            raise ModuleNotFoundError("highspy is not installed", name="highspy")
        command = [sys.executable, "-m", "lab.planner_race.highs_process"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.communicate()

    def __call__(self, milp: Milp) -> Solved:
        """Solve a problem in the process of HiGHS."""
        problem = {
            "count": milp.count,
            "rows": [[row.terms, row.low, row.high] for row in milp.rows],
            "goals": milp.goals,
            "seconds": SECONDS,
        }
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(problem) + "\n")
        self._process.stdin.flush()
        answer = json.loads(self._process.stdout.readline())
        return Solved(answer["ones"], answer["proven"], answer["cpu_seconds"])
