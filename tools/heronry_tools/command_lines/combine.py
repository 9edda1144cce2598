"""The command line of `heronry combine`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

_EPILOG = """\
FIRST is the vehicle that flies on: its names stay, and its manager remains. SECOND joins it. Each is a *.dg.yaml, a
shipped spec, REV:PATH in git, or - for standard input.

What has one name in both:
  the bus of --over     is one bus, with the same properties in both specs; the PEs on it are the gateways
  a variable            is one if at most one vehicle gives it: declare it alike in both, and it crosses the link
  anything else         is two things: that of SECOND gets a prefix
Node-IDs must differ, or --renumber gives SECOND other ones. A standard identifier that FIRST uses is taken from SECOND;
all others are allocated anew, as in any spec. A module stays on its own vehicle unless --roams names it.

The combined spec is checked by every rule of 'heronry check', and nothing is written if it has an error. The head of
the file tells what was decided. Two managers that meet in flight are not reconciled: stop that of SECOND first.

examples:
  heronry combine uav.dg.yaml rover.dg.yaml --over radio -o both.dg.yaml
  heronry combine uav.dg.yaml rover.dg.yaml --over radio --roams tracked_position     print it instead
  heronry combine uav.dg.yaml rover.dg.yaml --over radio=link --renumber -o both.dg.yaml
  heronry diff uav.dg.yaml both.dg.yaml                           what joins the aircraft, and what follows from it
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry combine`."""
    parser = subparsers.add_parser(
        "combine", description="Make one spec of the specs of two vehicles that share a radio.", epilog=_EPILOG
    )
    parser.add_argument("first", metavar="FIRST", help="the spec of the vehicle whose manager flies on")
    parser.add_argument("second", metavar="SECOND", help="the spec of the vehicle that joins it")
    parser.add_argument(
        "--over", metavar="BUS[=BUS]", required=True, help="the bus that both specs have; what FIRST and SECOND name it"
    )
    parser.add_argument("--name", metavar="NAME", help="name of the combined spec (default: both names)")
    parser.add_argument(
        "--prefix", metavar="NAME", help="prefix for names of SECOND that clash (default: the name of SECOND)"
    )
    parser.add_argument("--manager", metavar="NAME", help="the spec whose 'manager' counts, where both say something")
    parser.add_argument("--renumber", action="store_true", help="give PEs of SECOND whose node-ID is taken another one")
    parser.add_argument(
        "--roams", metavar="MODULE", action="append", default=[], help="let this module run on both vehicles (repeat)"
    )
    parser.add_argument(
        "-o",
        "--output",
        dest="spec_file",
        metavar="FILE",
        type=Path,
        help="write to this *.dg.yaml instead of standard output; only a file that combine wrote is replaced",
    )
