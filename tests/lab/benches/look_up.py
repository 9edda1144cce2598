"""How long the look-up of a fault takes: every entry of a contingency file, in a random order.

    python -m lab.benches.look_up big_blue.contingencies big_blue

*Found* is all that a switch by number needs: the precondition is checked, and the number of the configuration is known.
*As a plan* adds the plan with its report for the manager's event stream, which is computed at its first use.
"""

import random
import sys
import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from heronry_dg.objective import placement
from heronry_manager.contingency.file_format import read_contingencies
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_tools.console.spec_files import load_spec
from lab.benches.harness import Benchmark, Report

_PLANS_TRIED: Final = 1000


def measure(arguments: Namespace, report: Report) -> None:
    """Look up every entry once."""
    spec = load_spec(arguments.spec)
    begun_ns = time.process_time_ns()
    made = read_contingencies(arguments.file, spec)
    table = ContingencyTable(spec, made)
    report.figures("read and made ready: {ready_ms:.0f} ms", ready_ms=(time.process_time_ns() - begun_ns) / 1e6)
    running = {phase: placement(made.configuration(plan.number)) for phase, down, plan in made.entries() if not down}
    calls = [(down, phase, dict(running[phase])) for phase, down, _ in made.entries()]
    random.Random(0).shuffle(calls)
    report.times("found", [_spent_us(partial(table.find, *call)) for call in calls], unit="us")
    report.times("as a plan", [_spent_us(partial(table.plan, *call)) for call in calls[:_PLANS_TRIED]], unit="us")


def _spent_us(call: Callable[[], object]) -> float:
    begun_ns = time.perf_counter_ns()
    call()
    return (time.perf_counter_ns() - begun_ns) / 1e3


main = Benchmark(
    "look_up",
    __doc__,
    measure,
    lambda parser: parser.add_argument("file", metavar="FILE", type=Path),
    lambda parser: parser.add_argument("spec", metavar="SPEC"),
)
if __name__ == "__main__":
    sys.exit(main())
