"""The command line of `heronry contingencies`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

from heronry_tools.console.output import add_json
from heronry_tools.console.scope_arguments import add_scope_arguments
from heronry_tools.console.spec_argument import add_spec_argument

_EPILOG = """\
Faults are counted in elements: pe:NAME, device:NAME, module:NAME, bus:NAME, channel:BUS.1. Every plan assumes that the
phase's fault-free plan runs when the faults occur. A run that is stopped or killed leaves FILE.partial, and the same
command continues from it.

examples:
  heronry contingencies elevator_and_chute -o chute.contingencies
  heronry contingencies big_blue -o big_blue.contingencies --faults 1 --phase glide
  heronry contingencies big_blue -o big_blue.contingencies --kinds pe,bus --jobs 1
  heronry contingencies big_blue -o big_blue.contingencies --scheduler tcp://10.0.0.5:8786
  heronry contingencies --check big_blue.contingencies big_blue      verify every entry
  heronry manager big_blue --contingencies big_blue.contingencies -i socketcan -c can0
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry contingencies`."""
    parser = subparsers.add_parser(
        "contingencies",
        description="Plan for every set of faults in every phase, and keep the plans in one file.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("-o", "--output", metavar="FILE", type=Path, help="write the plans here")
    what.add_argument("--check", metavar="FILE", type=Path, help="make no plans; verify every entry of this file")
    add_scope_arguments(parser)
    add_json(parser, "write what was made, or what is wrong, as JSON")
