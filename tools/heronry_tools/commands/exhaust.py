"""`heronry exhaust`: flies a small aircraft through each reconfiguration, with a fault at one of its messages.

There is one flight for every fault at every message of every reconfiguration. With --sample only some of these
flights are flown, drawn at random; --pairs adds flights with two faults; with --case only given cases are
flown. A *story* is one event that makes the aircraft reconfigure; the help lists the stories.

Exit codes: 0 every flight was without a violation; 1 an oracle was violated (the command that replays the flight is
printed), or a fault of a case that the user gave with --case was not injected; 2 the input cannot be used.
"""

import argparse
import json
import shlex
from collections import Counter
from random import Random

from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_files import load_spec_file, spec_path
from heronry_tools.sim.compiled.machine_code import go_on_compiled
from heronry_tools.sim.flight.campaign import fly_all
from heronry_tools.sim.flight.exhaustive import Case, Setup, drawn_pairs, fly_case, read_case, single_cases, stories
from heronry_tools.sim.flight.flyable import check_images, reload_file
from heronry_tools.sim.oracles.violation import Violation


def run(arguments: argparse.Namespace) -> int:
    """Fly the cases and print the violations, or with `--count` only print the number of cases.

    Returns the exit code: 1 if in any case an oracle was violated, or a fault of `--case` was not injected;
    otherwise 0.
    """
    if arguments.compiled:
        go_on_compiled(arguments.argv)

    spec = load_spec_file(arguments.spec)
    check_images(spec)
    if arguments.count:
        counts = _counts(spec, arguments)
        print(json.dumps({"stories": counts, "flights": sum(counts.values())}) if arguments.json else _counted(counts))
        return 0
    cases = _cases(spec, arguments)
    failed: list[tuple[Case, list[Violation]]] = []
    with Progress() as progress:
        progress.begin("flights", len(cases))
        flown = fly_all(spec_path(arguments.spec), cases, arguments.jobs, fly_case)
        for case, violations in zip(cases, flown, strict=True):
            progress.step()
            if violations:
                failed.append((case, violations))
                if not arguments.json:
                    print("\n".join(_told(arguments, case, violations)), flush=True)
    print(json.dumps(_document(arguments, cases, failed)) if arguments.json else _summary(cases, len(failed)))
    return 1 if failed else 0


def _counts(spec: Spec, arguments: argparse.Namespace) -> dict[str, int]:
    """Return for each story how many single faults can be injected into it."""
    setup = _setup(spec, arguments)
    return {story: len(single_cases(spec, story, setup)) for story in stories(spec, setup)}


def _counted(counts: dict[str, int]) -> str:
    """Write one line with the number of single faults for each story, and a last line with the sum."""
    return "\n".join([*(f"{count:7} {story}" for story, count in counts.items()), f"{sum(counts.values()):7} flights"])


def _setup(spec: Spec, arguments: argparse.Namespace) -> Setup:
    reload = reload_file(spec, arguments.reload)
    return Setup(arguments.foreseen, arguments.keyed, arguments.standby, arguments.tables, reload)


def _cases(spec: Spec, arguments: argparse.Namespace) -> list[Case]:
    setup = _setup(spec, arguments)
    if arguments.case:
        return [read_case(spec, text, setup) for text in arguments.case]
    if arguments.sample == arguments.pairs == 0:
        raise UserError("--sample 0: there is nothing to fly; write 1 or more, or add --pairs N")
    every = [case for story in stories(spec, setup) for case in single_cases(spec, story, setup)]
    pairs = drawn_pairs(every, arguments.pairs, arguments.seed)
    if arguments.sample is not None and arguments.sample < len(every):
        every = Random(f"singles of {arguments.seed}").sample(every, arguments.sample)
    return [*every, *pairs]


def _told(arguments: argparse.Namespace, case: Case, violations: list[Violation]) -> list[str]:
    return [
        str(case),
        *(f"  VIOLATION {violation}" for violation in violations),
        f"  replay with: {_replay(arguments, case)}",
    ]


def _summary(cases: list[Case], failed: int) -> str:
    kinds = Counter(fault.kind for case in cases for fault in case.faults)
    stories = len({case.story for case in cases})
    faults = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    return f"{stories} stories, {len(cases)} flights ({faults or 'no fault'}), {failed} failed"


def _document(
    arguments: argparse.Namespace, cases: list[Case], failed: list[tuple[Case, list[Violation]]]
) -> dict[str, object]:
    return {
        "flights": len(cases),
        "blows": dict(Counter(fault.kind for case in cases for fault in case.faults)),
        "failed": [
            {
                "case": str(case),
                "violations": [{"t_ns": v.t_ns, "rule": v.rule, "story": v.story} for v in violations],
                "replay": _replay(arguments, case),
            }
            for case, violations in failed
        ],
    }


def _replay(arguments: argparse.Namespace, case: Case) -> str:
    words = ["heronry", "exhaust", shlex.quote(arguments.spec)]
    words += [f"--{name}" for name in ("standby", "keyed", "tables") if getattr(arguments, name)]
    words += [] if arguments.foreseen is None else ["--foreseen", str(arguments.foreseen)]
    words += [] if arguments.reload is None else ["--reload", shlex.quote(arguments.reload)]
    return " ".join([*words, "--case", shlex.quote(str(case))])
