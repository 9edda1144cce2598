"""`heronry campaign`: plans for every set of faults, and reports which functions survive.

Exit codes: 0 done, and every requirement holds; 1 a requirement is broken; 2 the input cannot be used.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heronry_tools.analysis.campaign.scope import add_scope_arguments, feasible, jobs_of, scope_of
from heronry_tools.console.errors import UserError
from heronry_tools.console.output import JSON, add_output
from heronry_tools.console.spec_argument import add_spec_argument, load_spec

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from heronry_dg.model import Spec
    from heronry_manager.planner.sweep import FaultSet, Outcome, Phase, Scope
    from heronry_tools.analysis.campaign.requirements import Requirement

    Examined = tuple[Scope, Mapping[tuple[Phase, FaultSet], Outcome]]

_EPILOG = """\
A function is lost when the best plan does not serve it: because no plan can, or because the remaining
resources go to a more important function. Probabilities come from rate_per_h and probability of the spec, over its
mission_h, without repair: exact for the sets that are planned, and bounds for the rest.

examples:
  heronry campaign elevator_and_chute                             what survives one fault, and two
  heronry campaign big_blue --faults 1 --phase glide              single points of failure, while gliding
  heronry campaign big_blue --faults 1 -o degradation.html        the same as a page with pictures
  heronry campaign elevator_and_chute --require "B after 1" --kinds device      exit code 1: broken, and by what
  heronry campaign big_blue --contingencies big_blue.contingencies       the same from plans that were made ahead
  heronry campaign my.dg.yaml --require "A after 2" --require "B after 1 in landing" -o campaign.json
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry campaign`."""
    parser = subparsers.add_parser(
        "campaign",
        description="Plan for every set of faults, and tell which functions survive: how gracefully a system degrades.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    add_scope_arguments(parser)
    parser.add_argument(
        "--contingencies",
        metavar="FILE",
        type=Path,
        help="take the plans from this contingency file, with its faults and phases, and make none",
    )
    parser.add_argument(
        "--require",
        metavar="'WHAT after N [in PHASE]'",
        action="append",
        default=[],
        help="a class or function that must survive any N faults; may be repeated; exit code 1 if it does not survive",
    )
    add_output(parser, forms={"text": (), "json": JSON, "html": (".html", ".htm")})
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Plan for every set of faults, and report; returns the exit code."""
    from heronry_tools.analysis.campaign.page import html_page  # noqa: PLC0415 - slow to import
    from heronry_tools.analysis.campaign.report import json_report, text_report  # noqa: PLC0415
    from heronry_tools.analysis.campaign.requirements import offences, read_requirement  # noqa: PLC0415
    from heronry_tools.analysis.campaign.survey import survey  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    required = [read_requirement(spec, text) for text in arguments.require]
    examined = _made_now if arguments.contingencies is None else _made_ahead
    scope, outcomes = examined(spec, arguments, required)
    surveys = survey(spec, scope, outcomes)
    assessed = [(one, offences(spec, one, outcomes)) for one in required]
    report = {"text": text_report, "json": json_report, "html": html_page}[arguments.format]
    sys.stdout.write(report(spec, scope, surveys, assessed))
    return 1 if any(broken for _, broken in assessed) else 0


def _made_now(spec: "Spec", arguments: argparse.Namespace, required: "Sequence[Requirement]") -> "Examined":
    """Make the plans of the scope on the command line, of more faults where a requirement names more."""
    from heronry_tools.analysis.campaign.crew import crew  # noqa: PLC0415 - loads the solver
    from heronry_tools.analysis.campaign.sweeping import sweep  # noqa: PLC0415

    named = scope_of(spec, arguments)
    scope = feasible(replace(named, faults=max([named.faults, *(one.faults for one in required)])))
    for one in required:
        if one.phase is not None and one.phase not in scope.phases:
            raise UserError(f"--require '{one.text}': phase {one.phase} is not examined; add --phase {one.phase}")
    with crew(jobs_of(arguments), arguments.scheduler) as executor:
        return scope, sweep(spec, scope, executor).outcomes


def _made_ahead(spec: "Spec", arguments: argparse.Namespace, required: "Sequence[Requirement]") -> "Examined":
    """Read the plans of a contingency file, and leave out its places."""
    from heronry_manager.contingency.file_format import read_contingencies  # noqa: PLC0415
    from heronry_manager.planner.sweep import Outcome  # noqa: PLC0415

    file = arguments.contingencies
    for option in ("faults", "phase", "kinds", "scheduler"):
        if getattr(arguments, option) is not None:
            raise UserError(f"--{option}: with --contingencies the file says what is examined; leave --{option} out")
    made = read_contingencies(file, spec)
    scope = replace(made.scope, places=False)
    for one in required:
        if one.faults > scope.faults:
            raise UserError(f"--require '{one.text}': {file} has plans for up to {scope.faults} faults; make it anew")
        if one.phase is not None and one.phase not in scope.phases:
            raise UserError(f"--require '{one.text}': {file} has no plans for phase {one.phase}; make it anew")
    every = set(scope.fault_sets())
    outcomes = {
        (phase, down): Outcome(made.configuration(plan.number), plan.objective, plan.optimal)
        for phase, down, plan in made.entries()
        if down in every
    }
    return scope, outcomes
