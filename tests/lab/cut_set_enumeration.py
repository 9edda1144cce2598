"""Cut sets against plain enumeration: each fault set has a search of its own, and no result is reused.

    python -m lab.cut_set_enumeration                       every shipped spec, sets of up to two faults
    python -m lab.cut_set_enumeration big_blue --order 1

For every function and both kinds of cut sets a fault set must lose the function exactly if it contains a cut set. A
disagreement is printed, and makes the exit code 1.
"""

import argparse
import sys
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from itertools import islice
from typing import Final

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.shipped import example_specs, shipped_spec_names
from heronry_dg.situation import elements
from heronry_manager.planner.sweep import FaultSet, Scope
from heronry_tools.analysis.campaign.crew import crew
from heronry_tools.analysis.reliability.cut_sets import cut_sets
from heronry_tools.analysis.servable import Planning, without_limits
from heronry_tools.console.errors import exit_code
from heronry_tools.console.processes import in_order
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_files import spec_path

_SETS_IN_A_PART: Final = 64


def lost_by_enumeration(spec: Spec, function: str, downs: list[FaultSet]) -> list[bool]:
    """Tell of each fault set whether it loses a function; each set has a search of its own."""
    return [Planning(spec).all_at_once((function,), down).impossible for down in downs]


def disagreements(spec: Spec, order: int, executor: Executor | None, progress: Progress) -> Iterator[str]:
    """Compare cut sets and enumeration for every function of a spec."""
    scope = Scope(elements(spec), order, (None,))
    downs = list(scope.fault_sets())
    for function in spec.functions:
        found = cut_sets(spec, function, scope)
        for kind, planned, cuts in (
            ("logical", without_limits(spec), found.logical),
            ("resource-aware", spec, found.resources),
        ):
            progress.begin(f"{spec.name}: {function}, {kind}", len(downs))
            for down, lost in _enumerated(planned, function, downs, executor):
                progress.step()
                if lost != any(cut <= down for cut in cuts):
                    says = "is" if lost else "is not"
                    yield f"{spec.name}: {function}, {kind}: it {says} lost with {', '.join(sorted(down))}"


def _enumerated(
    spec: Spec, function: str, downs: list[FaultSet], executor: Executor | None
) -> Iterator[tuple[FaultSet, bool]]:
    rest = iter(downs)
    parts = list(iter(lambda: list(islice(rest, _SETS_IN_A_PART)), []))
    answers: Iterable[list[bool]]
    if executor is None:
        answers = (lost_by_enumeration(spec, function, part) for part in parts)
    else:
        answers = in_order(deque(executor.submit(lost_by_enumeration, spec, function, part) for part in parts))
    for part, lost in zip(parts, answers, strict=True):
        yield from zip(part, lost, strict=True)


def shipped() -> list[str]:
    """Return the names of all shipped specs, the examples among them."""
    return [*shipped_spec_names(), *map(str, example_specs())]


def main(argv: list[str] | None = None) -> int:
    """Compare for the specs on the command line, or for all shipped ones; gives the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specs", metavar="SPEC", nargs="*", help="default: every shipped spec")
    parser.add_argument("--order", type=int, default=2)
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args(argv)
    agree = True
    with crew(arguments.jobs) as executor, Progress() as progress:
        for name in arguments.specs or shipped():
            spec = load(spec_path(name))
            wrong = list(disagreements(spec, arguments.order, executor, progress))
            sets = Scope(elements(spec), arguments.order, (None,)).set_count()
            print(
                f"{spec.name}: {len(spec.functions)} functions, {sets} fault sets: {len(wrong) or 'no'} disagreements"
            )
            print("\n".join(wrong[:20]), end="\n" if wrong else "")
            agree = agree and not wrong
    return 0 if agree else 1


if __name__ == "__main__":
    sys.exit(exit_code(main, "exhaustive"))
