"""Would the tests notice? Draws defects for the flight code from a seed and tries each one.

    tools/mutate --seed 7                    300 mutants of the cores, the rate of those killed, every survivor
    tools/mutate --seed 7 --count 20 --jobs 2
    tools/mutate --seed 7 --list             only say which

Exit code 0 when at least the required share is killed, 1 when not or when the tests fail without any mutant, 2 usage.
"""

import argparse
import json
import random
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from heronry_tools.mutation.mutants import Mutant, mutants_of
from heronry_tools.mutation.trial import Stage, Tree, Verdict

CORES = (  # what decides in flight, sans I/O
    "manager/heronry_manager/*.py",
    "pe_agent/heronry_agent/*.py",
)
NOT_CORES = frozenset(  # shells, and what only describes
    (
        *("__init__", "__main__", "cli", "control_socket", "driver", "events", "host", "incarnation"),
        "journal",
        *("module", "ports", "vocabulary"),
    )
)
STAGES: tuple[Stage, ...] = (("tests/manager", "tests/agent", "-m", "not live and not vcan"), ("tests/scenarios",))
_TIMEOUT_S = 900.0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; gives its exit code."""
    arguments = _parser().parse_args(argv)
    checkout = Path(__file__).resolve().parents[3]
    drawn = draw(all_mutants(checkout), arguments.seed, arguments.count)
    if arguments.list:
        for mutant in drawn:
            print(mutant.describe((checkout / mutant.file).read_bytes()))
        return 0
    verdicts = []
    for verdict in _verdicts(checkout, drawn, arguments.jobs):
        if isinstance(verdict, str):
            print(f"tools/mutate: without any mutant, {verdict} fails; mend that first", file=sys.stderr)
            return 1
        verdicts.append(verdict)
        if not arguments.json:
            what = verdict.mutant.describe((checkout / verdict.mutant.file).read_bytes())
            fate = "SURVIVED" if verdict.killed_by is None else f"killed by {verdict.killed_by}"
            print(f"{len(verdicts)}/{len(drawn)} {fate}\n    {what}", flush=True)
    return _report(checkout, verdicts, arguments)


def all_mutants(checkout: Path) -> list[Mutant]:
    """Every mutant of the cores."""
    files = sorted(file for pattern in CORES for file in checkout.glob(pattern) if file.stem not in NOT_CORES)
    return [mutant for file in files for mutant in mutants_of(file.relative_to(checkout), file.read_bytes())]


def draw(mutants: Sequence[Mutant], seed: int, count: int) -> list[Mutant]:
    """Draw `count` of them, or all; the same seed and code draw the same."""
    return random.Random(seed).sample(mutants, min(count, len(mutants)))


def _verdicts(checkout: Path, drawn: Sequence[Mutant], jobs: int) -> Iterator[Verdict | str]:
    with tempfile.TemporaryDirectory(prefix="heronry-mutate-") as folder:
        trees: SimpleQueue[Tree] = SimpleQueue()
        for number in range(jobs):
            trees.put(Tree(checkout, Path(folder) / str(number)))
        tree = trees.get()
        broken = tree.fails(STAGES, _TIMEOUT_S)
        trees.put(tree)
        if broken is not None:
            yield broken
            return

        def judge(mutant: Mutant) -> Verdict:
            tree = trees.get()
            try:
                return tree.judge(mutant, STAGES, _TIMEOUT_S)
            finally:
                trees.put(tree)

        pool = ThreadPoolExecutor(jobs)
        try:
            yield from pool.map(judge, drawn)
        finally:
            pool.shutdown(cancel_futures=True)


def _report(checkout: Path, verdicts: Sequence[Verdict], arguments: argparse.Namespace) -> int:
    survivors = [verdict.mutant for verdict in verdicts if verdict.killed_by is None]
    told = [mutant.describe((checkout / mutant.file).read_bytes()) for mutant in survivors]
    rate = 1 - len(survivors) / len(verdicts) if verdicts else 1.0
    if arguments.json:
        print(json.dumps({"seed": arguments.seed, "tried": len(verdicts), "killed": rate, "survivors": told}, indent=2))
    else:
        print(f"{len(verdicts) - len(survivors)} of {len(verdicts)} killed, {rate:.1%}; survivors:")
        print("".join(f"    {line}\n" for line in told), end="")
    return 0 if rate >= arguments.require / 100 else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tools/mutate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, required=True, help="which mutants are drawn")
    parser.add_argument("--count", type=int, default=300, metavar="N", help="how many (default: 300)")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="trials side by side (default: 2)")
    parser.add_argument("--require", type=float, default=85.0, metavar="PERCENT", help="to be killed (default: 85)")
    parser.add_argument("--list", action="store_true", help="only say which mutants are drawn")
    parser.add_argument("--json", action="store_true", help="one JSON object at the end")
    return parser


if __name__ == "__main__":
    sys.exit(main())
