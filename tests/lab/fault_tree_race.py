"""Cut sets and probabilities beside those of scram, on drawn fault trees with shared subtrees.

    python -m lab.fault_tree_race                     twenty trees of 60 to 300 events and 80 to 300 gates
    python -m lab.fault_tree_race --trees 5 --first 100

Each tree becomes a spec (`heronry import openpsa` has the same way), the spec is exported, and both tools read what was
exported from the same file. Counts of every order must be equal, and probabilities to the digits that scram prints. A
disagreement is printed and makes the exit code 1. CPU seconds: `here` is reading the file, all diagrams, counts and the
probability, and a list of up to 100 000 sets; `scram` is the whole program, which writes all sets. scram is Debian's.
"""

import argparse
import random
import re
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from heronry_dg.loader import load
from heronry_tools.analysis.reliability.chances import Hazards
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.failure import failure
from heronry_tools.analysis.reliability.formula import Formula, TooLargeError
from heronry_tools.analysis.reliability.open_psa.reading import Tree, read_tree
from heronry_tools.analysis.reliability.open_psa.spec_text import spec_text
from heronry_tools.analysis.reliability.open_psa.writing import fault_tree

SCRAM: Final = shutil.which("scram")
_MOST_LISTED: Final = 100_000
_SECONDS: Final = 60  # after which scram is stopped


def drawn_tree(seed: int) -> Tree:
    """Draw a tree of which many gates are read by several others, with a probability for each event."""
    rng = random.Random(seed)
    formula = Formula()
    events = [f"e{number}" for number in range(rng.randint(60, 300))]
    gates, shared = rng.randint(80, 300), rng.choice((0.02, 0.05, 0.1, 0.15))
    fresh, alone, made = rng.sample(events, len(events)), list[int](), list[int]()

    def drawn_input() -> int:
        drawn = rng.random()
        if drawn < shared and made:
            return rng.choice(made[-30:])
        if drawn < shared + 0.05:
            return formula.event(rng.choice(events))
        if alone and (drawn < 0.55 or not fresh):
            return alone.pop(0)
        return formula.event(fresh.pop() if fresh else rng.choice(events))

    for _ in range(gates - 1):
        inputs = {drawn_input() for _ in range(rng.choice((2, 2, 3, 3, 4)))}
        kind = rng.choices(("or", "and", "vote"), (5, 4, 1))[0]
        least = {"or": 1, "and": len(inputs)}.get(kind, rng.randint(1, len(inputs)))
        made.append(formula.at_least(least, sorted(inputs)))
        alone[:] = [one for one in dict.fromkeys([*alone, made[-1]]) if one not in inputs or one == made[-1]]
    root = formula.any_of(alone)
    demands = {name: 10 ** rng.uniform(-4, -1) for name in formula.events}
    return Tree(formula, ("top",), {"top": root}, {}, demands, (), ())


@dataclass(frozen=True, slots=True)
class Result:
    """Counts by order, the probability, CPU seconds; `None` for what was not found."""

    by_order: dict[int, int] | None
    probability: float | None
    cpu_s: float
    listed: int = 0


def by_scram(file: Path) -> Result:
    """Let scram read a file; it is stopped after a minute."""
    out = file.with_suffix(".out")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [SCRAM or "scram", "--probability", "true", "--limit-order", "1000", "-o", str(out), str(file)]
    try:
        subprocess.run(command, check=True, capture_output=True, timeout=_SECONDS)
        with out.open() as report:
            text = report.read(100_000)
    except (subprocess.TimeoutExpired, subprocess.CalledProcessError):
        text = ""
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found = re.search(r'<sum-of-products[^>]* products="\d+" probability="([^"]*)" distribution="([^"]*)"', text)
    if found is None:
        return Result(None, None, cpu_s)
    counts = {order: int(number) for order, number in enumerate(found[2].split(), 1) if int(number)}
    return Result(counts, float(found[1]), cpu_s)


def here(file: Path) -> Result:
    """Solve the tree of a file."""
    began = time.process_time()
    tree = read_tree(file)
    try:
        solution = Solution(tree.formula, tree.gates[tree.tops[0]])
    except TooLargeError:
        return Result(None, None, time.process_time() - began)
    hazards = Hazards(tree.rates, tree.demands)
    probability = solution.probability(hazards.chances(1.0))
    listed = sum(1 for _ in solution.sets(_MOST_LISTED))
    return Result(solution.by_order(), probability, time.process_time() - began, listed)


def agree(one: Result, other: Result) -> bool:
    """Tell whether two results agree, as far as both know; scram prints six digits."""
    if None in (one.by_order, other.by_order) or one.probability is None or other.probability is None:
        return True
    return one.by_order == other.by_order and abs(one.probability - other.probability) <= 1e-5 * other.probability


def races(seeds: Iterator[int], folder: Path) -> Iterator[tuple[int, Tree, Result, Result]]:
    """Let both tools solve the trees of some seeds."""
    for seed in seeds:
        tree = drawn_tree(seed)
        spec_file, file = folder / "tree.dg.yaml", folder / "tree.xml"
        spec_file.write_text(spec_text(Tree(tree.formula, tree.tops, tree.gates, {}, {}, (), ()), "tree"))
        spec = load(spec_file)
        devices = [f"device:{name}" for name in spec.devices]
        found = failure(spec, "top", devices)
        demands = {f"device:{name}": chance for name, chance in tree.demands.items()}
        file.write_text(fault_tree("top", found.formula, found.root, Hazards({}, demands), 1.0))
        yield seed, tree, here(file), by_scram(file)


def _row(seed: int, tree: Tree, ours: Result, theirs: Result) -> str:
    nodes = tree.formula.below(tree.gates["top"])
    events = sum(node in tree.formula.names for node in nodes)
    if ours.by_order is None:
        says = "too large here"
    elif theirs.by_order is None:
        says = "scram stopped"
    else:
        says = "equal" if agree(ours, theirs) else "DIFFER"
    sets, chance = sum((ours.by_order or {}).values()), f"{ours.probability or 0:.6g}"
    times = f"{ours.cpu_s:8.2f} {theirs.cpu_s:8.2f}"
    return f"{seed:4} {events:6} {len(nodes) - events:5} {sets:12} {chance:>12} {times}  {says}"


def main(argv: list[str] | None = None) -> int:
    """Let both tools solve drawn trees, and print a table; gives the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trees", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="the seed of the first tree")
    arguments = parser.parse_args(argv)
    if SCRAM is None:
        print("there is no scram here; apt-get install scram")
        return 2
    wrong, totals = 0, [0.0, 0.0]
    seeds = iter(range(arguments.first, arguments.first + arguments.trees))
    print("seed events gates         sets  probability  here, s scram, s  result")
    with TemporaryDirectory() as folder:
        for seed, tree, ours, theirs in races(seeds, Path(folder)):
            wrong += not agree(ours, theirs)
            print(_row(seed, tree, ours, theirs), flush=True)
            if ours.by_order is not None and theirs.by_order is not None:
                totals = [totals[0] + ours.cpu_s, totals[1] + theirs.cpu_s]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"where both finish: {totals[0]:.2f} s here, {totals[1]:.2f} s scram; {memory:.0f} MiB here; {wrong} differ")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
