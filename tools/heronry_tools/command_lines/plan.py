"""The command lines of `heronry plan` and `heronry verify`: arguments, their help, and examples."""

import argparse
from typing import Any

from heronry_tools.console.output import add_output
from heronry_tools.console.situation_arguments import add_situation
from heronry_tools.console.spec_argument import add_spec_argument

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
    plan.set_defaults(run="run_plan")

    verify = subparsers.add_parser(
        "verify",
        description="Verify a plan against every rule, without a planner.",
        epilog=_VERIFY_EPILOG,
    )
    add_spec_argument(verify)
    verify.add_argument("plan", metavar="PLAN.json", help="the plan to verify (- for standard input)")
    add_situation(verify)
    add_output(verify, "write the broken rules as JSON")
    verify.set_defaults(run="run_verify")


def _effort(text: str) -> float:
    effort = float(text)
    if not 0 <= effort < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a limit of the search; write a number of 0 or more")
    return effort
