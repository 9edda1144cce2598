"""Would the tests notice a defect? Draws defects for the flight code from a seed, and flies each one.

    tools/mutate --seed 7                    300 mutants of the cores, the rate of those killed, every survivor
    tools/mutate --seed 7 --count 20 --jobs 2
    tools/mutate --seed 7 --list             only list the mutants
    tools/mutate --seed 7 --killers scenario,sim      the rate without conformance tests

The killers are conformance tests, the scenario files, and drawn flights with the simulator's oracles, and no unit test.
For each survivor the report has the reason: no flight runs it; it changes no frame; or frames differ, and every oracle
holds.

Exit code 0 when at least the required share is killed, 1 when not or when a flight fails without any mutant, 2 usage.
"""

import argparse
import json
import random
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from heronry_tools.console.errors import UserError, exit_code
from heronry_tools.console.progress import Progress
from lab.mutation.flight_code import core_files
from lab.mutation.flights import KINDS, flights
from lab.mutation.mutants import Mutant, compiles, mutants_of
from lab.mutation.survivors import reason
from lab.mutation.trial import Trials, Verdict


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; gives its exit code."""
    arguments = _parser().parse_args(argv)
    for option in ("count", "jobs"):
        if getattr(arguments, option) < 1:
            raise UserError(f"--{option} {getattr(arguments, option)} measures nothing; write 1 or more")
    killers = arguments.killers.split(",")
    if not set(killers) <= set(KINDS):
        raise UserError(f"--killers {arguments.killers}: name some of {', '.join(KINDS)}, with commas between")
    checkout = Path(__file__).resolve().parents[3]
    drawn = draw(checkout, arguments.seed, arguments.count)
    if arguments.list:
        for mutant in drawn:
            print(mutant.describe((checkout / mutant.file).read_bytes()))
        return 0
    sys.path.insert(0, str(checkout / "tests"))  # images of some scenarios
    trials = Trials(checkout, [one for one in flights(checkout) if one.what in killers], arguments.jobs)
    broken = _first_flights(trials)
    if broken is not None:
        print(f"tools/mutate: without any mutant, {broken}; mend that first", file=sys.stderr)
        return 1
    return _report(checkout, list(_tried(checkout, trials, drawn, arguments)), arguments)


def all_mutants(checkout: Path) -> list[Mutant]:
    """Return every mutant of the cores; a few do not compile."""
    return [mutant for file in core_files(checkout) for mutant in mutants_of(file, (checkout / file).read_bytes())]


def draw(checkout: Path, seed: int, count: int) -> list[Mutant]:
    """Draw `count` mutants that compile, or all; the same seed and code draw the same ones."""
    mutants = all_mutants(checkout)
    random.Random(seed).shuffle(mutants)
    fit = (mutant for mutant in mutants if compiles(mutant, (checkout / mutant.file).read_bytes()))
    return [mutant for _, mutant in zip(range(count), fit, strict=False)]


def _first_flights(trials: Trials) -> str | None:
    """Fly every flight without a mutant; gives the first failure."""
    with Progress() as progress:
        progress.begin("flights without a mutant", len(trials.flights))
        for baseline in trials.baselines():
            progress.step()
            if baseline.landed.wrong is not None:
                return f"'{baseline.flight}' fails ({baseline.landed.wrong})"
    return None


def _tried(checkout: Path, trials: Trials, drawn: Sequence[Mutant], arguments: argparse.Namespace) -> Iterator[Verdict]:
    """Try every mutant, and print each verdict when its trial has ended."""
    for number, verdict in enumerate(trials.verdicts(drawn), start=1):
        if not arguments.json:
            what = verdict.mutant.describe((checkout / verdict.mutant.file).read_bytes())
            fate = "SURVIVED" if verdict.killed_by is None else f"killed by {verdict.killed_by}: {verdict.how}"
            print(f"{number}/{len(drawn)} {fate}  ({verdict.cpu_s:.1f} s)\n    {what}", flush=True)
        yield verdict


def _report(checkout: Path, verdicts: Sequence[Verdict], arguments: argparse.Namespace) -> int:
    survivors = [verdict for verdict in verdicts if verdict.killed_by is None]
    told = [_told(checkout, verdict) for verdict in survivors]
    rate = 1 - len(survivors) / len(verdicts) if verdicts else 1.0
    cpu_s = round(sum(verdict.cpu_s for verdict in verdicts))
    if arguments.json:
        found = {"seed": arguments.seed, "tried": len(verdicts), "killed": rate, "cpu_s": cpu_s, "survivors": told}
        print(json.dumps(found, indent=2))
    else:
        print(
            f"{len(verdicts) - len(survivors)} of {len(verdicts)} killed, {rate:.1%}, in {cpu_s} s of CPU; survivors:"
        )
        print("".join(f"    {one['mutant']}\n        {one['reason']}\n" for one in told), end="")
    return 0 if rate >= arguments.require / 100 else 1


def _told(checkout: Path, verdict: Verdict) -> dict[str, str]:
    source = (checkout / verdict.mutant.file).read_bytes()
    return {"mutant": verdict.mutant.describe(source), "reason": reason(verdict)}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tools/mutate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, required=True, help="which mutants are drawn")
    parser.add_argument("--count", type=int, default=300, metavar="N", help="how many (default: 300)")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="trials at a time (default: 2)")
    parser.add_argument(
        "--require", type=float, default=85.0, metavar="PERCENT", help="share that has to be killed (default: 85)"
    )
    parser.add_argument(
        "--killers",
        default=",".join(KINDS),
        metavar="KINDS",
        help="flights that may kill (default: all kinds)",
    )
    parser.add_argument("--list", action="store_true", help="only list the mutants that are drawn")
    parser.add_argument("--json", action="store_true", help="one JSON object at the end")
    return parser


if __name__ == "__main__":
    sys.exit(exit_code(main, "mutate"))
