"""The command line of `heronry cutsets`: arguments, their help, and examples."""

from typing import Any, Final

from heronry_tools.console.output import add_output
from heronry_tools.console.spec_argument import add_spec_argument

_LISTED: Final = 10_000
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
