"""Cut sets and probabilities beside those of scram, on drawn fault trees with shared subtrees.

    python -m lab.fault_tree_race                     twenty trees of 60 to 300 events and 80 to 300 gates
    python -m lab.fault_tree_race --trees 5 --first 100

Each tree becomes a spec (`heronry import openpsa` has the same way), the spec is exported, and both tools read what was
exported from the same file. Counts of every order must be equal, and probabilities to the digits that scram prints.
Where a diagram was truncated here, the counts to its order must be equal, and the probability of scram must lie between
the bounds. A disagreement is printed and makes the exit code 1, and so does a tree that takes more than 20 s or 1 GiB
here, or more than three times the CPU of scram where both solve it exactly.

CPU seconds: `here` is reading the file, all diagrams, counts and the probability, and a list of up to 100 000 sets, in
a process for each tree; `scram` is the whole program, which writes all sets. scram is Debian's.
"""

import argparse
import random
import re
import resource
import shutil
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from heronry_dg.loader import load
from heronry_tools.analysis.reliability.chances import Hazards
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.failure import failure
from heronry_tools.analysis.reliability.formula import Formula
from heronry_tools.analysis.reliability.open_psa.reading import Tree, read_tree
from heronry_tools.analysis.reliability.open_psa.spec_text import spec_text
from heronry_tools.analysis.reliability.open_psa.writing import fault_tree

SCRAM: Final = shutil.which("scram")
_MOST_LISTED: Final = 100_000
_SECONDS: Final = 60  # after which scram is stopped
_MOST_SECONDS: Final = 20.0  # of CPU here
_MOST_MIB: Final = 1024.0
_MOST_TIMES: Final = 3.0  # the CPU of scram


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
    """Counts by order, the probability, CPU seconds; `None` for what was not found.

    order: counts are known up to this one; None: all.
    at_most: upper bound of a probability that is not exact.
    mib: the most memory that the process had.
    """

    by_order: dict[int, int] | None
    probability: float | None
    cpu_s: float
    order: int | None = None
    at_most: float | None = None
    mib: float = 0.0

    @property
    def exact(self) -> bool:
        """Tell whether everything was found, without a bound."""
        return self.by_order is not None and self.order is None and self.at_most is None


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
    chances = Hazards(tree.rates, tree.demands).chances(1.0)
    solution = Solution(tree.formula, tree.gates[tree.tops[0]], truncate=chances)
    probability = solution.probability(chances)
    at_most = None if solution.exact else solution.at_most(chances)
    deque(solution.sets(_MOST_LISTED), maxlen=0)
    cpu_s, kib = time.process_time() - began, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return Result(solution.by_order(), probability, cpu_s, solution.order, at_most, kib / 1024)


def agree(ours: Result, scram: Result) -> bool:
    """Tell whether two results agree, as far as both know; scram prints six digits."""
    if ours.by_order is None or scram.by_order is None or ours.probability is None or scram.probability is None:
        return True
    known = {order: sets for order, sets in scram.by_order.items() if ours.order is None or order <= ours.order}
    near, at_most = 1e-5 * scram.probability, ours.probability if ours.at_most is None else ours.at_most
    return ours.by_order == known and ours.probability - near <= scram.probability <= at_most + near


def here_alone(file: Path) -> Result:
    """Solve the tree of a file in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(here, file).result()


def races(
    seeds: Iterator[int], folder: Path, solve: Callable[[Path], Result] = here
) -> Iterator[tuple[int, Tree, Result, Result]]:
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
        yield seed, tree, solve(file), by_scram(file)


def _row(seed: int, tree: Tree, ours: Result, theirs: Result) -> str:
    nodes = tree.formula.below(tree.gates["top"])
    events = sum(node in tree.formula.names for node in nodes)
    says = "scram stopped" if theirs.by_order is None else "equal" if agree(ours, theirs) else "DIFFER"
    if not ours.exact:
        says = f"at most {ours.at_most:.6g}, sets to order {ours.order}; {says}"
    says = "; ".join([says, *_too_much(ours, theirs)])
    sets, chance = sum((ours.by_order or {}).values()), f"{ours.probability or 0:.6g}"
    times = f"{ours.cpu_s:8.2f} {theirs.cpu_s:8.2f}"
    return f"{seed:4} {events:6} {len(nodes) - events:5} {sets:12} {chance:>12} {times} {ours.mib:5.0f}  {says}"


def _too_much(ours: Result, theirs: Result) -> Iterator[str]:
    """Name each limit that is exceeded here."""
    if ours.cpu_s > _MOST_SECONDS:
        yield f"MORE THAN {_MOST_SECONDS:g} s"
    if ours.mib > _MOST_MIB:
        yield f"MORE THAN {_MOST_MIB:g} MiB"
    if ours.exact and theirs.by_order is not None and ours.cpu_s > _MOST_TIMES * theirs.cpu_s:
        yield f"MORE THAN {_MOST_TIMES:g} TIMES"


def main(argv: list[str] | None = None) -> int:
    """Let both tools solve drawn trees, and print a table; gives the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trees", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="the seed of the first tree")
    arguments = parser.parse_args(argv)
    if SCRAM is None:
        print("there is no scram here; apt-get install scram")
        return 2
    wrong, exceeded, totals = 0, 0, [0.0, 0.0]
    seeds = iter(range(arguments.first, arguments.first + arguments.trees))
    print("seed events gates         sets  probability  here, s scram, s   MiB  result")
    with TemporaryDirectory() as folder:
        for seed, tree, ours, theirs in races(seeds, Path(folder), here_alone):
            wrong += not agree(ours, theirs)
            exceeded += any(_too_much(ours, theirs))
            print(_row(seed, tree, ours, theirs), flush=True)
            if ours.exact and theirs.by_order is not None:
                totals = [totals[0] + ours.cpu_s, totals[1] + theirs.cpu_s]
    print(
        f"where both finish: {totals[0]:.2f} s here, {totals[1]:.2f} s scram; {wrong} differ, {exceeded} exceed a limit"
    )
    return 1 if wrong or exceeded else 0


if __name__ == "__main__":
    sys.exit(main())
