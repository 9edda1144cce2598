"""`heronry cutsets`: the smallest sets of faults after which a function cannot be served.

Exit codes: 0 done, whatever was found; 2 the input cannot be used.
"""

import argparse
import sys
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any, Final

from heronry_tools.analysis.campaign.scope import feasible, jobs_of, kinds_of
from heronry_tools.console.output import add_output
from heronry_tools.console.spec_argument import add_spec_argument, load_spec, named_function

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_manager.planner.sweep import FaultSet, Scope
    from heronry_tools.analysis.reliability.cut_sets import CutSets
    from heronry_tools.analysis.reliability.mission import Reliability

_LISTED: Final = 10_000
_EVERY_ORDER: Final = 1_000_000

_EPILOG = """\
logical: without these elements the graph cannot serve the function, even with unlimited resources; sets of every order
are counted. resource-aware: the function does not fit on the PEs and buses that are left. A set that is both is listed
once, as logical (--json: in both lists). Every larger set loses the function, too. --given-up adds sets after which the
best plan of the phase leaves the function out for something more important, though the function could be served; a
larger set of faults may bring the function back. With -o FILE a search that was stopped goes on where it ended.

Probabilities come from rate_per_h and probability of the spec, over its mission_h, without repair.

examples:
  heronry cutsets elevator_and_chute parachute
  heronry cutsets big_blue elevator --order 1 --kinds pe,device,bus
  heronry cutsets big_blue flight_log --order 1 --given-up --phase glide
  heronry cutsets big_blue rudder --order 1 --json
  heronry cutsets big_blue telemetry --logical --by likelihood --list 10
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry cutsets`."""
    parser = subparsers.add_parser(
        "cutsets",
        description="Find the smallest sets of faults that lose a function: because its inputs are lost (logical), "
        "or because what is left of PEs and buses has no room for it (resource-aware).",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("function", metavar="FUNCTION", help="a function of the spec")
    parser.add_argument(
        "--order",
        metavar="N",
        type=int,
        help="find and list sets of up to N faults (default: contingency.faults of the spec; with --logical: all)",
    )
    parser.add_argument("--logical", action="store_true", help="only logical sets: no planning, so any order is fast")
    parser.add_argument(
        "--list", metavar="N", type=int, default=_LISTED, help=f"list at most N logical sets (default: {_LISTED})"
    )
    parser.add_argument(
        "--by",
        choices=("order", "likelihood"),
        default="order",
        help="list the smallest logical sets first, or the likeliest of every order (default: order)",
    )
    parser.add_argument(
        "--mission", metavar="HOURS", type=float, help="length of the mission (default: mission_h of the spec, or 1)"
    )
    parser.add_argument(
        "--kinds",
        metavar="KINDS",
        help="let only these kinds of elements fail, for example pe,bus (default: all but place, a module on one PE)",
    )
    parser.add_argument(
        "--given-up",
        action="store_true",
        help="also list sets after which the best plan of a phase leaves the function out",
    )
    parser.add_argument("--phase", metavar="NAME", help="the phase for --given-up (default: the first one of the spec)")
    parser.add_argument("--jobs", metavar="N", type=int, help="how many processes plan (default: one for each CPU)")
    add_output(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Find the cut sets of a function, and print them; returns the exit code."""
    from heronry_tools.analysis.reliability.cut_sets import logic_of  # noqa: PLC0415 - loads the solver
    from heronry_tools.analysis.reliability.report import Findings, json_report, text_report  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    function = named_function(spec, arguments.function)
    hours = _mission(spec, arguments)
    scope, jobs = _scope(spec, arguments), jobs_of(arguments)
    logic = logic_of(spec, function.name, scope)
    cuts, left_out = None, None
    if not arguments.logical:
        cuts = _with_resources(spec, scope, logic, function.name, arguments)
        if arguments.given_up:
            left_out = _given_up(spec, scope, cuts, jobs)
    order = scope.faults if scope.faults < _EVERY_ORDER and arguments.by == "order" else None
    found = Findings(
        spec, function.name, scope, logic, cuts, left_out, hours, order, arguments.list, arguments.by == "likelihood"
    )
    sys.stdout.write((json_report if arguments.json else text_report)(found))
    return 0


def _mission(spec: "Spec", arguments: argparse.Namespace) -> float:
    from heronry_tools.analysis.reliability.spec_hazards import mission_hours  # noqa: PLC0415
    from heronry_tools.console.errors import UserError  # noqa: PLC0415

    hours = mission_hours(spec) if arguments.mission is None else float(arguments.mission)
    if not 0.0 < hours < float("inf"):
        raise UserError(f"--mission {hours:g}: write the hours of the mission, a number above 0")
    if arguments.list < 0:
        raise UserError(f"--list {arguments.list}: write how many logical sets to list, 0 or more")
    return hours


def _scope(spec: "Spec", arguments: argparse.Namespace) -> "Scope":
    from heronry_dg.situation import elements, places, situation  # noqa: PLC0415
    from heronry_manager.planner.sweep import Scope  # noqa: PLC0415
    from heronry_tools.console.errors import UserError  # noqa: PLC0415

    usual = _EVERY_ORDER if arguments.logical else spec.contingency.faults
    order = usual if arguments.order is None else arguments.order
    if order < 1:
        raise UserError(f"--order {order}: a set has at least one fault; write 1 or more")
    if arguments.logical and arguments.given_up:
        raise UserError("--logical plans nothing, and --given-up needs plans; leave one of them out")
    kinds = kinds_of(arguments.kinds, also=("place",))
    chosen = [one for one in elements(spec) if one.partition(":")[0] in kinds]
    if "place" in kinds:
        chosen += [place for module in spec.modules for place in places(spec, module)]
    scope = Scope(tuple(chosen), order, (situation(spec, phase=arguments.phase).phase,))
    return scope if arguments.logical else feasible(scope)


def _with_resources(
    spec: "Spec", scope: "Scope", logic: "Reliability", function: str, arguments: argparse.Namespace
) -> "CutSets":
    """Search resource-aware sets; with -o FILE, the journal FILE.partial keeps what is done."""
    from heronry_tools.analysis.campaign.crew import crew  # noqa: PLC0415
    from heronry_tools.analysis.campaign.sweeping import partial_of  # noqa: PLC0415
    from heronry_tools.analysis.reliability.cut_sets import (  # noqa: PLC0415
        cut_sets,
        elements_searched,
        sets_searched,
    )
    from heronry_tools.analysis.reliability.resource_sets import Journal, most_useful_jobs  # noqa: PLC0415
    from heronry_tools.console.progress import Progress  # noqa: PLC0415

    number = sets_searched(logic, scope)
    about = ["cut sets", spec.digest, function, scope.phases[0], scope.faults, list(elements_searched(logic, scope))]
    file = arguments.report_file
    kept = nullcontext() if file is None else Journal(partial_of(file), about)
    jobs = min(jobs_of(arguments), most_useful_jobs(number))
    with kept as journal, crew(jobs) as executor, Progress() as progress:
        if journal is not None and journal.known:
            print(f"heronry: continuing {journal.file}, which has {journal.sets} fault sets", file=sys.stderr)
        progress.begin("fault sets", number)
        try:
            found = cut_sets(spec, function, scope, logic, executor=executor, journal=journal, advance=progress.step)
        except KeyboardInterrupt:
            if journal is not None:
                print(f"heronry: stopped; the same command continues from {journal.file}", file=sys.stderr)
            raise
        if journal is not None:
            journal.remove()
    return found


def _given_up(spec: "Spec", scope: "Scope", cuts: "CutSets", jobs: int) -> "list[FaultSet]":
    from heronry_tools.analysis.campaign.crew import crew  # noqa: PLC0415
    from heronry_tools.analysis.campaign.given_up import given_up  # noqa: PLC0415
    from heronry_tools.analysis.campaign.sweeping import sweep  # noqa: PLC0415

    with crew(jobs) as executor:
        outcomes = sweep(spec, scope, executor).outcomes
    return given_up(spec.functions[cuts.function], cuts.resources, scope.phases[0], outcomes)
