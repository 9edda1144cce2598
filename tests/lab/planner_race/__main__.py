"""`python -m lab.planner_race`: the planner's speed and quality beside other solvers', on aircraft drawn from a seed.

Exit codes: 0 measured; 1 two proofs contradict each other, or a plan is not legal; 2 the input cannot be used.
"""

import argparse
import json
import re
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from heronry_tools.console.errors import UserError, exit_code

if TYPE_CHECKING:
    from lab.planner_race.race import Entry, Race, Size

_SIZE = re.compile(r"(?P<modules>\d{1,3})x(?P<pes>\d{1,2})", re.ASCII)
_RIVALS = ("cp-sat", "highs")
_MOST_WORK = 10.0  # a load above ten times the CPU shows nothing more

_PLAN_EPILOG = """\
Specs are generated, ten faults for each; the same seed gives the same ones. Work is the CPU of every module in its best
mode, as a share of the CPU of all PEs: above 1 not everything fits. Times are CPU time of one core.

examples:
  python -m lab.planner_race --cases 20                        a first look
  python -m lab.planner_race --sizes 30x8,60x12 --cases 200    the figures in docs/planner.md
  python -m lab.planner_race --work 1.3 --effort 2             overloaded, with a limit on the search
  python -m lab.planner_race --sizes 200x20 --rivals none      large, without other solvers
  python -m lab.planner_race --json >race.json
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; gives its exit code."""
    return run_plan(_parser().parse_args(argv))


def _parser() -> argparse.ArgumentParser:
    plan = argparse.ArgumentParser(
        prog="python -m lab.planner_race",
        description="Plan for generated aircraft with faults, and compare with other solvers in the same run.",
        epilog=_PLAN_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    plan.add_argument("--sizes", default="30x8", metavar="MxP,...", help="modules x PEs (default: 30x8)")
    plan.add_argument("--cases", type=int, default=50, metavar="N", help="faults for each size (default: 50)")
    plan.add_argument("--seed", type=int, default=0, metavar="N", help="of the first spec (default: 0)")
    plan.add_argument("--work", type=float, default=1.05, metavar="SHARE", help="of the CPU there is (default: 1.05)")
    plan.add_argument(
        "--effort", type=float, default=5.0, metavar="E", help="limit of each search in deterministic seconds (5)"
    )
    plan.add_argument("--rivals", default=",".join(_RIVALS), metavar="NAME,...", help="cp-sat, highs, or none")
    plan.add_argument("--json", action="store_true", help="write the figures as JSON")
    return plan


def run_plan(arguments: argparse.Namespace) -> int:
    """Race and report; returns the exit code."""
    from lab.planner_race.race import run  # noqa: PLC0415 - loads the solver

    if arguments.cases < 1:
        raise UserError(f"--cases {arguments.cases}: measure at least one case")
    if not 0 < arguments.work <= _MOST_WORK:
        raise UserError(f"--work {arguments.work:g}: write a share of the CPU, above 0 and up to {_MOST_WORK:g}")
    if not 0 <= arguments.effort < float("inf"):
        raise UserError(f"--effort {arguments.effort:g} is not a limit of the search; write a number of 0 or more")
    rivals = _rivals(arguments.rivals)
    races = []
    for size in _sizes(arguments):
        progress = _Progress(size, arguments)
        races.append(
            run(size, arguments.cases, arguments.seed, effort=arguments.effort, rivals=rivals, progress=progress)
        )
        if not arguments.json:
            print("\n".join(_report(races[-1])), flush=True)
    if arguments.json:
        print(json.dumps([_document(race) for race in races], indent=2))
    return 1 if any(race.disagreements() or race.illegal for race in races) else 0


def _rivals(text: str) -> list[str]:
    names = [] if text == "none" else text.split(",")
    for name in names:
        if name not in _RIVALS:
            raise UserError(
                f"--rivals {text}: '{name}' is not one of {', '.join(_RIVALS)}; for no other solver write none"
            )
    return names


def _sizes(arguments: argparse.Namespace) -> "list[Size]":
    from lab.planner_race.race import Size  # noqa: PLC0415 - loads the solver

    sizes = []
    for text in arguments.sizes.split(","):
        match = _SIZE.fullmatch(text.strip())
        if match is None or not (30 <= int(match["modules"]) <= 220 and 6 <= int(match["pes"]) <= 34):
            raise UserError(f"--sizes: '{text}' is not a size; write MODULESxPES, 30x6 to 220x34")
        sizes.append(Size(int(match["modules"]), int(match["pes"]), arguments.work))
    return sizes


class _Progress:
    """The progress of a race: one line on a terminal, rewritten."""

    def __init__(self, size: "Size", arguments: argparse.Namespace) -> None:
        self._text, self._cases = str(size), arguments.cases

    def __call__(self, done: int) -> None:
        if sys.stderr.isatty():
            end = "\r" if done + 1 < self._cases else "\n"
            print(f"{self._text}: case {done + 1} of {self._cases}", end=end, file=sys.stderr, flush=True)


def _report(race: "Race") -> list[str]:
    lines = [f"{race.size}: {len(race.serving['planner'].cpu_ms)} faults; CPU time in ms"]
    lines.append(f"{'levels 1 and 2':16}{'median':>9}{'p90':>9}{'p99':>9}{'proven':>9}  against the planner's median")
    ours = race.serving["planner"].percentile(50)
    lines.extend(_row(entry, f"{entry.percentile(50) / ours:.1f} times") for entry in race.serving.values())
    lines.append("all levels, by the work there is for the CPU that a fault leaves")
    lines.extend(_row(entry, f"{len(entry.cpu_ms)} faults") for entry in (race.plans, race.overloaded))
    for level, count in sorted(race.unproven.items()):
        lines.append(f"  {level}: {count} not proven; gap {max(race.gaps[level]):.1%} at most")
    lines.append(
        f"greedy: {race.greedy_utility():.2%} of the utility on average, "
        f"fewer critical functions in {race.greedy_losses()} cases"
    )
    lines.append(f"proofs that disagree: {race.disagreements()}; plans that are not legal: {race.illegal}")
    return [*lines, ""]


def _row(entry: "Entry", text: str) -> str:
    times = "".join(f"{entry.percentile(percent):9.1f}" for percent in (50, 90, 99))
    return f"{entry.name:16}{times}{entry.share_proven():9.1%}  {text}".rstrip()


def _document(race: "Race") -> dict[str, object]:
    by_work = (race.plans, race.overloaded)
    return {
        "modules": race.size.modules,
        "pes": race.size.pes,
        "work": race.size.work,
        "cases": len(race.serving["planner"].cpu_ms),
        "levels_1_and_2": {name: _figures(entry) for name, entry in race.serving.items()},
        "all_levels": {entry.name: {"cases": len(entry.cpu_ms), **_figures(entry)} for entry in by_work},
        "not_proven": {level: {"plans": n, "largest_gap": max(race.gaps[level])} for level, n in race.unproven.items()},
        "greedy_share_of_utility": race.greedy_utility(),
        "greedy_fewer_critical": race.greedy_losses(),
        "proofs_that_disagree": race.disagreements(),
        "illegal": race.illegal,
    }


def _figures(entry: "Entry") -> dict[str, float]:
    times = {f"{name}_ms": entry.percentile(p) for name, p in (("median", 50), ("p90", 90), ("p99", 99))}
    return {**times, "proven": entry.share_proven()}


if __name__ == "__main__":
    sys.exit(exit_code(main, "planner race"))
