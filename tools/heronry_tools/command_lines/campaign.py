"""The command line of `heronry campaign`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

from heronry_tools.console.output import JSON, add_output
from heronry_tools.console.scope_arguments import add_scope_arguments
from heronry_tools.console.spec_argument import add_spec_argument

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
