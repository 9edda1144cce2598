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
from typing import TYPE_CHECKING, Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.number_arguments import processors, whole_number
from heronry_tools.console.output import add_output
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_argument import add_spec_argument, load_spec_file, spec_path
from heronry_tools.sim.compiled.option import add_compiled_argument, go_on_compiled_if_asked

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_tools.sim.flight.exhaustive import Case, Setup
    from heronry_tools.sim.oracles.violation import Violation

_EPILOG = """\
A story is one event that makes the aircraft reconfigure: its start, each PE's loss, return and reboot, each module that
raises, each sensor that dies, each element that the operator fails and clears, each phase, requested by the operator or
by a module; with --standby also the death of the active manager. Each story is flown once for each fault: one of its
management frames, from the first to the last, is lost, doubled or late, for one node or for all nodes, or a node dies
at that frame. Use a spec with three PEs: it has some 37000 flights, half an hour on one processor.

Exit codes: 0 all is well; 1 an oracle was violated, or a fault of a given case was not injected; 2 the input cannot be
used; 130 and 143 ended by Ctrl-C and by SIGTERM.

examples:
  heronry exhaust dg_specs/examples/demux_actuators.dg.yaml --sample 200      drawn from all of them, by --seed
  heronry exhaust dg_specs/examples/demux_actuators.dg.yaml --jobs 0          all of them
  heronry exhaust dg_specs/examples/demux_actuators.dg.yaml --count           only tell how many there are
  heronry exhaust my.dg.yaml --pairs 5000 --sample 0                          two at a time, drawn
  heronry exhaust my.dg.yaml --case 'crash pe:nav: 17 lost pe:tail, 20 crash manager'
  heronry exhaust my.dg.yaml --standby --keyed --foreseen 1 --sample 500      two managers, a key, plans on board
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry exhaust`."""
    parser = subparsers.add_parser(
        "exhaust",
        description=(
            "Inject every fault at every message of every reconfiguration, one fault in each flight, and check the "
            "flights."
        ),
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("--sample", type=whole_number, metavar="N", help="fly only N single faults, drawn at random")
    parser.add_argument(
        "--pairs",
        type=whole_number,
        default=0,
        metavar="N",
        help="also fly N pairs of faults, drawn at random (default: 0)",
    )
    parser.add_argument(
        "--seed", type=whole_number, default=0, metavar="N", help="seed from which faults are drawn (default: 0)"
    )
    parser.add_argument("--standby", action="store_true", help="fly with two managers")
    parser.add_argument("--keyed", action="store_true", help="give managers and PEs a key")
    parser.add_argument(
        "--foreseen",
        type=whole_number,
        metavar="N",
        help="make plans ahead for up to N faults, and put the plans on board (default: no plans are made ahead)",
    )
    parser.add_argument("--count", action="store_true", help="fly nothing: count the single faults of each story")
    parser.add_argument(
        "--case", action="append", default=[], metavar="CASE", help="fly only this case, 'STORY: FAULT, ..'; see below"
    )
    parser.add_argument(
        "--jobs", type=processors, default=1, metavar="N", help="flights at a time (default: 1; 0: one per processor)"
    )
    add_compiled_argument(parser)
    add_output(parser, "write the flights and their failures, or the counts of --count, as JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fly the cases and print the violations, or with `--count` only print the number of cases.

    Returns the exit code: 1 if in any case an oracle was violated, or a fault of `--case` was not injected;
    otherwise 0.
    """
    go_on_compiled_if_asked(arguments)
    from heronry_tools.sim.flight.campaign import fly_all  # noqa: PLC0415 - the solver is slow to import
    from heronry_tools.sim.flight.exhaustive import fly_case  # noqa: PLC0415
    from heronry_tools.sim.flight.flyable import check_images  # noqa: PLC0415

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


def _counts(spec: "Spec", arguments: argparse.Namespace) -> dict[str, int]:
    """Give for each story how many single faults can be injected into it."""
    from heronry_tools.sim.flight.exhaustive import single_cases, stories  # noqa: PLC0415

    setup = _setup(arguments)
    return {story: len(single_cases(spec, story, setup)) for story in stories(spec, setup)}


def _counted(counts: dict[str, int]) -> str:
    """Write one line with the number of single faults for each story, and a last line with the sum."""
    return "\n".join([*(f"{count:7} {story}" for story, count in counts.items()), f"{sum(counts.values()):7} flights"])


def _setup(arguments: argparse.Namespace) -> "Setup":
    from heronry_tools.sim.flight.exhaustive import Setup  # noqa: PLC0415

    return Setup(arguments.foreseen, arguments.keyed, arguments.standby)


def _cases(spec: "Spec", arguments: argparse.Namespace) -> "list[Case]":
    from heronry_tools.sim.flight.exhaustive import drawn_pairs, read_case, single_cases, stories  # noqa: PLC0415

    setup = _setup(arguments)
    if arguments.case:
        return [read_case(spec, text, setup) for text in arguments.case]
    if arguments.sample == arguments.pairs == 0:
        raise UserError("--sample 0: there is nothing to fly; write 1 or more, or add --pairs N")
    every = [case for story in stories(spec, setup) for case in single_cases(spec, story, setup)]
    pairs = drawn_pairs(every, arguments.pairs, arguments.seed)
    if arguments.sample is not None and arguments.sample < len(every):
        every = Random(f"singles of {arguments.seed}").sample(every, arguments.sample)
    return [*every, *pairs]


def _told(arguments: argparse.Namespace, case: "Case", violations: "list[Violation]") -> list[str]:
    return [
        str(case),
        *(f"  VIOLATION {violation}" for violation in violations),
        f"  replay with: {_replay(arguments, case)}",
    ]


def _summary(cases: "list[Case]", failed: int) -> str:
    kinds = Counter(fault.kind for case in cases for fault in case.faults)
    stories = len({case.story for case in cases})
    faults = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    return f"{stories} stories, {len(cases)} flights ({faults or 'no fault'}), {failed} failed"


def _document(
    arguments: argparse.Namespace, cases: "list[Case]", failed: "list[tuple[Case, list[Violation]]]"
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


def _replay(arguments: argparse.Namespace, case: "Case") -> str:
    words = ["heronry", "exhaust", shlex.quote(arguments.spec)]
    words += [f"--{name}" for name in ("standby", "keyed") if getattr(arguments, name)]
    words += [] if arguments.foreseen is None else ["--foreseen", str(arguments.foreseen)]
    return " ".join([*words, "--case", shlex.quote(str(case))])
