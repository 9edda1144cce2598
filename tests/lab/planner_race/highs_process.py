"""HiGHS in a process of its own, since highspy and ortools cannot share one.

    python -m lab.planner_race.highs_process

Problems come on standard input and answers go to standard output, one JSON object a line:

    problem  {"count": 3, "rows": [[[[0, 2], [1, 1]], null, 2], ...], "goals": [[[0, 5]], ...], "seconds": 20}
    answer   {"ones": [0, 2], "proven": true, "cpu_seconds": 0.12}

Goals are maximised in their order, each fixed before the next: their weighted sum would outgrow floating point. Default
options, one thread, no gap; `seconds` limits the search for one goal, and `cpu_seconds` is what building and solving
took. Ends when standard input closes. What HiGHS itself prints (1.16 greets whatever its options say) goes nowhere.
"""

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import highspy
import numpy as np


def main() -> None:
    """Answer until standard input closes."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
    for line in sys.stdin:
        problem = json.loads(line)
        start = time.process_time()
        ones, proven = _solved(problem)
        answer = {"ones": ones, "proven": proven, "cpu_seconds": time.process_time() - start}
        print(json.dumps(answer), file=answers, flush=True)


def _solved(problem: dict[str, Any]) -> tuple[list[int], bool]:
    highs, proven = _built(problem), True
    ones: list[int] = []
    columns = np.arange(problem["count"], dtype=np.int32)
    for goal in problem["goals"]:
        costs = np.zeros(problem["count"])
        for variable, weight in goal:
            costs[variable] = weight
        highs.changeColsCost(problem["count"], columns, costs)
        highs.run()
        proven &= highs.getModelStatus() == highspy.HighsModelStatus.kOptimal
        ones = [number for number, value in enumerate(highs.getSolution().col_value) if value > 0.5]
        chosen = set(ones)
        _add_row(highs, goal, sum(weight for variable, weight in goal if variable in chosen), None)
    return ones, proven


def _built(problem: dict[str, Any]) -> highspy.Highs:
    highs = highspy.Highs()  # type: ignore[no-untyped-call]
    highs.setOptionValue("output_flag", False)
    highs.setOptionValue("threads", 1)
    highs.setOptionValue("mip_rel_gap", 0.0)
    highs.setOptionValue("mip_abs_gap", 0.999)
    highs.setOptionValue("time_limit", float(problem["seconds"]))
    count = problem["count"]
    highs.addVars(count, np.zeros(count), np.ones(count))
    highs.changeColsIntegrality(
        count, np.arange(count, dtype=np.int32), np.array([highspy.HighsVarType.kInteger] * count)
    )
    highs.changeObjectiveSense(highspy.ObjSense.kMaximize)
    for terms, low, high in problem["rows"]:
        _add_row(highs, terms, low, high)
    return highs


def _add_row(highs: highspy.Highs, terms: list[tuple[int, int]], low: int | None, high: int | None) -> None:
    highs.addRow(
        -highspy.kHighsInf if low is None else low,
        highspy.kHighsInf if high is None else high,
        len(terms),
        np.array([variable for variable, _ in terms], dtype=np.int32),
        np.array([weight for _, weight in terms], dtype=np.float64),
    )


if __name__ == "__main__":
    main()
