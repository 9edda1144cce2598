"""`heronry plan` and `heronry verify`: find the best configuration in a situation; verify a given one.

Exit codes: 0 a plan was made, or a configuration is legal; 1 it is not legal; 2 the input cannot be used.
"""

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.output import add_output
from heronry_tools.console.plan_argument import errors_name, evaluated_in, read_text
from heronry_tools.console.situation_arguments import add_situation, situation_of
from heronry_tools.console.spec_argument import add_spec_argument, load_spec

if TYPE_CHECKING:
    from heronry_dg.configuration import Configuration
    from heronry_dg.model import Spec
    from heronry_dg.objective import Placement
    from heronry_dg.plan import Plan
    from heronry_dg.situation import Situation
    from heronry_dg.transition import Transition

_SITUATIONS = """\
An element that can be down is pe:NAME, device:NAME, module:NAME, bus:NAME or channel:BUS.1 (of a replicated bus).
A reduced capacity is written bus:NAME=40% or pe:NAME=50%: so much of it is left.
A changed priority is written FUNCTION=N: it replaces the spec's in every phase that wants the function.
"""

_PLAN_EPILOG = f"""\
{_SITUATIONS}
examples:
  heronry plan elevator_and_chute                            everything works
  heronry plan elevator_and_chute --down device:gps          ... but the GPS
  heronry plan big_blue --down pe:nav --down bus:radio       a computer and the radio are down
  heronry plan big_blue --limit bus:radio=40% --phase glide  a bad radio link, while gliding
  heronry plan big_blue --priority imaging=90                if the priority of the imaging were 90
  heronry plan big_blue -o now.json                          the plan as JSON, to keep and to compare
  heronry plan big_blue --down pe:nav --running now.json     ... and the next one, with few changes against it,
                                                             and the way there: which modules stop before which start
"""

_VERIFY_EPILOG = f"""\
{_SITUATIONS}
PLAN is JSON as 'heronry plan --json' writes it; its "modules" suffice, so that a plan may come from any planner.
The situation is the one that the plan names, where no option gives another one.

examples:
  heronry plan big_blue --json >plan.json
  heronry verify big_blue plan.json                   exit code 0: legal
  heronry verify big_blue plan.json --down pe:nav     is it legal without pe:nav? 1: no, and which rules it breaks
  heronry plan my.dg.yaml --json | heronry verify my.dg.yaml -
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parsers of `heronry plan` and `heronry verify`."""
    plan = subparsers.add_parser(
        "plan",
        description="Find the best legal configuration of a spec in a situation, and prove that it is the best.",
        epilog=_PLAN_EPILOG,
    )
    add_spec_argument(plan)
    add_situation(plan)
    plan.add_argument(
        "--running",
        metavar="PLAN.json",
        help="the plan that runs now; the new plan changes as little of it as possible (- for stdin)",
    )
    plan.add_argument(
        "--planner",
        choices=("exact", "greedy"),
        default="exact",
        help="exact: the best plan, with proof (default); greedy: a legal plan without a search",
    )
    plan.add_argument(
        "--effort",
        type=_effort,
        metavar="E",
        help="limit of the search, in units of work (default 60); a unit is the same work on every computer, and takes "
        "about a second",
    )
    add_output(plan, "write the plan as JSON")
    plan.set_defaults(run=run_plan)

    verify = subparsers.add_parser(
        "verify",
        description="Verify a plan against every rule, without a planner.",
        epilog=_VERIFY_EPILOG,
    )
    add_spec_argument(verify)
    verify.add_argument("plan", metavar="PLAN.json", help="the plan to verify (- for standard input)")
    add_situation(verify)
    add_output(verify, "write the broken rules as JSON")
    verify.set_defaults(run=run_verify)


def run_plan(arguments: argparse.Namespace) -> int:
    """Make a plan, and print it as text or as JSON; returns the exit code."""
    from heronry_dg.plan import read_running  # noqa: PLC0415 - slow to import; `--help` does not need it
    from heronry_tools.reports.plan import print_plan  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    now = situation_of(spec, arguments)
    text = read_text(arguments.running) if arguments.running else None
    with errors_name(arguments.running):
        running = read_running(text, spec) if text is not None else None
    if arguments.planner == "greedy":
        found = _greedy(spec, now, running)
    else:
        found = _best(spec, now, running, arguments.effort)
    way = _way(spec, text, found, now) if text is not None else None
    if not arguments.json:
        print_plan(spec, found, arguments.planner, way)
    elif way is None:
        sys.stdout.write(found.to_json())
    else:
        document = {**found.document(), "transition": way.document()}
        sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=False) + "\n")
    return 0


def _effort(text: str) -> float:
    effort = float(text)
    if not 0 <= effort < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a limit of the search; write a number of 0 or more")
    return effort


def _greedy(spec: "Spec", now: "Situation", running: "Placement | None") -> "Plan":
    from heronry_manager.planner.greedy.planner import Greedy  # noqa: PLC0415

    return Greedy(spec).plan(now, running)


def _best(spec: "Spec", now: "Situation", running: "Placement | None", effort: float | None) -> "Plan":
    try:
        from heronry_manager.planner.exact import DEFAULT_EFFORT, plan  # noqa: PLC0415
        from heronry_manager.planner.explain import explained  # noqa: PLC0415
    except ModuleNotFoundError as error:
        if str(error.name).partition(".")[0] != "ortools":
            raise
        how = 'add it with: pip install "heronry[manager]", or use --planner greedy'
        raise UserError(f"the exact planner needs ortools, which is not installed; {how}") from error
    return explained(spec, plan(spec, now, running, effort=DEFAULT_EFFORT if effort is None else effort))


def _way(spec: "Spec", text: str, found: "Plan", now: "Situation") -> "Transition":
    """Give the transition from the running configuration to a plan; raises InvariantError if it is illegal."""
    from heronry_dg.transition import transition  # noqa: PLC0415
    from heronry_dg.verify_transition import verify_transition  # noqa: PLC0415
    from heronry_wire.sansio import require  # noqa: PLC0415

    before, after = _as_known(spec, text), found.configuration
    way = transition(spec, before, after, now)
    refusals = verify_transition(spec, before, after, now, way)
    require(not refusals, "the transition to this plan is not legal: {}", refusals)
    return way


def _as_known(spec: "Spec", text: str) -> "Configuration | Placement":
    """Read the running configuration from a plan; if the plan lacks wires, read only the modules' PEs and modes."""
    from heronry_dg.plan import PlanError, read_configuration, read_running  # noqa: PLC0415

    try:
        return read_configuration(text)
    except PlanError:
        return read_running(text, spec)


def run_verify(arguments: argparse.Namespace) -> int:
    """Verify a plan; returns 0 if the plan is legal, and 1 if it is not."""
    from heronry_dg.plan import read_configuration  # noqa: PLC0415
    from heronry_dg.verify import verify  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    text = read_text(arguments.plan)
    with errors_name(arguments.plan):
        now, configuration = evaluated_in(spec, text, arguments), read_configuration(text)
    violations = verify(spec, now, configuration)
    if arguments.json:
        broken = [{"rule": one.rule, "where": one.where, "sentence": one.sentence} for one in violations]
        print(json.dumps({"legal": not violations, "violations": broken}, indent=2, ensure_ascii=False))
    else:
        print("\n".join(map(str, violations)) or "legal: no rule is broken")
    return 1 if violations else 0
