"""How long it takes to look a fault up: every entry of a contingency file, in a random order.

    python -m lab.benches.look_up big_blue.contingencies big_blue

*Found* is what a switch by number needs: the precondition is checked, and the number of the configuration is known. *As
a plan* adds the report that the manager's event stream carries, worked out when a plan is wanted for the first time.
"""

import argparse
import random
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from heronry_dg.loader import load
from heronry_dg.objective import placement
from heronry_manager.contingency.file_format import read_contingencies
from heronry_manager.contingency.look_up import ContingencyTable
from heronry_tools.console.errors import exit_code
from heronry_tools.console.spec_argument import spec_path

_PLANS_TRIED: Final = 1000


def main() -> int:
    """Measure and print; gives the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", metavar="FILE", type=Path)
    parser.add_argument("spec", metavar="SPEC")
    arguments = parser.parse_args()
    spec = load(spec_path(arguments.spec))
    begun_ns = time.process_time_ns()
    made = read_contingencies(arguments.file, spec)
    table = ContingencyTable(spec, made)
    print(f"read and made ready: {(time.process_time_ns() - begun_ns) / 1e6:.0f} ms")
    running = {phase: placement(made.configuration(plan.number)) for phase, down, plan in made.entries() if not down}
    calls = [(down, phase, dict(running[phase])) for phase, down, _ in made.entries()]
    random.Random(0).shuffle(calls)
    _show("found", [_spent_ns(partial(table.find, *call)) for call in calls])
    _show("as a plan", [_spent_ns(partial(table.plan, *call)) for call in calls[:_PLANS_TRIED]])
    return 0


def _spent_ns(call: Callable[[], object]) -> int:
    begun_ns = time.perf_counter_ns()
    call()
    return time.perf_counter_ns() - begun_ns


def _show(what: str, spent_ns: list[int]) -> None:
    spent_ns.sort()
    median, p99 = spent_ns[len(spent_ns) // 2], spent_ns[len(spent_ns) * 99 // 100]
    print(f"{what}: {len(spent_ns)} look-ups, median {median / 1e3:.1f} us, p99 {p99 / 1e3:.1f} us")


if __name__ == "__main__":
    sys.exit(exit_code(main, "look_up_bench"))
