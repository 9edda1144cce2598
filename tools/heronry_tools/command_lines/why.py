"""The command line of `heronry why`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.output import add_output
from heronry_tools.console.situation_arguments import add_situation
from heronry_tools.console.spec_argument import add_spec_argument

_EPILOG = """\
The reasons are irreducible: without any one of them the function could be served beside all the others. Repairs are the
smallest ones: an element that comes back, or so much more of a capacity.

examples:
  heronry why elevator_and_chute elevator --down pe:tail_pe
  heronry why big_blue experiment --phase landing
  heronry why big_blue imaging --down pe:nav --down pe:payload --phase glide
  heronry why big_blue guidance --down device:gps --phase glide --json
  heronry why big_blue imaging --limit bus:radio=10%
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry why`."""
    parser = subparsers.add_parser(
        "why",
        description="Tell why a function is not served, or is served only in a worse mode, and what the smallest "
        "repair is.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("function", metavar="FUNCTION", help="a function of the spec")
    add_situation(parser)
    add_output(parser, "write the answer as JSON")
