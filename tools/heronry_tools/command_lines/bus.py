"""The command line of `heronry bus`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.output import add_output
from heronry_tools.console.situation_arguments import add_situation
from heronry_tools.console.spec_argument import add_spec_argument

_EPILOG = """\
Without --plan the command shows the best plan for the situation. With --plan it shows that plan, in the situation that
the plan names, unless options give another one. A plan that overloads a bus can be shown; a plan with a module that
runs nowhere, or with a wire between modules that do not run, cannot.

examples:
  heronry bus big_blue                            all that is on its buses while everything works
  heronry bus big_blue --phase glide --bus can0   one bus, in another phase
  heronry bus big_blue --down pe:nav              ... once the navigation computer is gone
  heronry plan big_blue --json >plan.json
  heronry bus big_blue --plan plan.json --json    the same for a saved plan, for other tools
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry bus`."""
    parser = subparsers.add_parser(
        "bus",
        description="Show what a plan puts on each bus: every message with its longest response time, and the totals.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("--plan", metavar="PLAN.json", help="the plan to show (- for standard input)")
    add_situation(parser)
    parser.add_argument("--bus", metavar="NAME", help="show this bus alone")
    parser.add_argument(
        "--every-echo", action="store_true", help="count an echo of every command, as simulated plants ask for it"
    )
    add_output(parser, "write the messages as JSON")
