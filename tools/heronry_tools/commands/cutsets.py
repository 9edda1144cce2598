"""`heronry cutsets`: the smallest sets of faults after which a function cannot be served.

Exit codes: 0 done, whatever was found; 2 the input cannot be used.
"""

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from heronry_tools.analysis.campaign.scope import feasible, jobs_of, kinds_of
from heronry_tools.console.output import add_output
from heronry_tools.console.spec_argument import add_spec_argument, load_spec, named_function

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_manager.planner.sweep import FaultSet, Scope
    from heronry_tools.analysis.campaign.cut_sets import CutSets

_EPILOG = """\
logical: without these elements the graph cannot serve the function, even with unlimited resources. resource-aware: the
function does not fit on the PEs and buses that are left. A set that is both is listed once, as logical (--json: in both
lists). These sets do not depend on the phase, and every larger set loses the function, too. --given-up adds sets after
which the best plan of the phase leaves the function out for something more important, though the function could be
served; a larger set of faults may bring the function back.

examples:
  heronry cutsets elevator_and_chute parachute
  heronry cutsets big_blue elevator --order 1 --kinds pe,device,bus
  heronry cutsets big_blue flight_log --order 1 --given-up --phase glide
  heronry cutsets big_blue rudder --order 1 --json
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
        "--order", metavar="N", type=int, help="find sets of up to N faults (default: the spec's contingency.faults)"
    )
    parser.add_argument(
        "--kinds", metavar="KINDS", help="let only these kinds of elements fail, for example pe,bus (default: all)"
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
    from heronry_tools.analysis.campaign.cut_sets import cut_sets, given_up  # noqa: PLC0415 - loads the solver
    from heronry_tools.console.progress import Progress  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    function = named_function(spec, arguments.function)
    scope, jobs = _scope(spec, arguments), jobs_of(arguments)
    phase = scope.phases[0]
    with Progress() as progress:
        progress.begin("fault sets", 2 * scope.set_count())
        found = cut_sets(spec, function.name, scope, progress.step)
    left_out = None
    if arguments.given_up:
        left_out = given_up(function, found, phase, _swept(spec, scope, jobs))
    report = _json if arguments.json else _text
    sys.stdout.write(report(spec, found, scope, left_out))
    return 0


def _scope(spec: "Spec", arguments: argparse.Namespace) -> "Scope":
    from heronry_dg.situation import elements, situation  # noqa: PLC0415
    from heronry_manager.planner.sweep import Scope  # noqa: PLC0415
    from heronry_tools.console.errors import UserError  # noqa: PLC0415

    order = spec.contingency.faults if arguments.order is None else arguments.order
    if order < 1:
        raise UserError(f"--order {order}: a set has at least one fault; write 1 or more")
    kinds = kinds_of(arguments.kinds)
    chosen = tuple(one for one in elements(spec) if one.partition(":")[0] in kinds)
    return feasible(Scope(chosen, order, (situation(spec, phase=arguments.phase).phase,)))


def _swept(spec: "Spec", scope: "Scope", jobs: int) -> Any:
    from heronry_tools.analysis.campaign.crew import crew  # noqa: PLC0415
    from heronry_tools.analysis.campaign.sweeping import sweep  # noqa: PLC0415

    with crew(jobs) as executor:
        return sweep(spec, scope, executor).outcomes


def _text(spec: "Spec", found: "CutSets", scope: "Scope", left_out: "list[FaultSet] | None") -> str:
    lines = [f"{found.function} of {spec.name}: sets of up to {found.order} faults"]
    lines += ["", f"logical: {_counted(spec, found.logical, scope)}", *map(_set_line, found.logical)]
    more = [down for down in found.resources if down not in found.logical]
    lines += ["", f"resource-aware: {_beyond_logic(spec, found, len(more), scope)}", *map(_set_line, more)]
    if left_out is not None:
        (phase,) = scope.phases
        where = f" in {phase}" if phase is not None else ""
        lines += ["", f"given up by the best plan{where}: {_counted(spec, left_out, scope)}", *map(_set_line, left_out)]
    return "\n".join(lines) + "\n"


def _beyond_logic(spec: "Spec", found: "CutSets", more: int, scope: "Scope") -> str:
    from heronry_tools.analysis.campaign.rates import likelihood  # noqa: PLC0415

    if not found.logical or frozenset() in found.resources:
        return _counted(spec, found.resources, scope)
    if not more:
        return "the same sets"
    chance = likelihood(spec, found.resources, scope)
    return f"{more} more set{'s' * (more != 1)}" + (f", with the logical ones {chance}" if chance is not None else "")


def _counted(spec: "Spec", sets: "tuple[FaultSet, ...] | list[FaultSet]", scope: "Scope") -> str:
    from heronry_tools.analysis.campaign.rates import likelihood  # noqa: PLC0415

    if frozenset() in sets:
        return "with nothing down at all"
    chance = likelihood(spec, sets, scope)
    return f"{len(sets) or 'no'} set{'s' * (len(sets) != 1)}" + (f", {chance}" if chance is not None else "")


def _set_line(down: "FaultSet") -> str:
    return f"  {', '.join(sorted(down)) or 'nothing down'}"


def _json(spec: "Spec", found: "CutSets", scope: "Scope", left_out: "list[FaultSet] | None") -> str:
    document: dict[str, Any] = {
        "spec": spec.name,
        "digest": spec.digest,
        "function": found.function,
        "order": found.order,
        "logical": _sets_json(spec, found.logical, scope),
        "resources": _sets_json(spec, found.resources, scope),
    }
    if left_out is not None:
        document["given_up"] = {"phase": scope.phases[0], **_sets_json(spec, left_out, scope)}
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _sets_json(spec: "Spec", sets: "tuple[FaultSet, ...] | list[FaultSet]", scope: "Scope") -> dict[str, Any]:
    from heronry_tools.analysis.campaign.rates import likelihood  # noqa: PLC0415

    chance = likelihood(spec, sets, scope)
    return {
        "sets": [sorted(down) for down in sets],
        "per_h": None if chance is None else chance.per_h,
        "at_most_per_h": None if chance is None else chance.at_most_per_h,
        "complete": None if chance is None else chance.complete,
    }
