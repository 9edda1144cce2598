"""The command line of `heronry bound`: arguments, their help, and examples."""

import argparse
from typing import Any

from heronry_tools.console.output import add_output
from heronry_tools.console.situation_arguments import add_phase
from heronry_tools.console.spec_argument import add_spec_argument

_EPILOG = """\
The sum runs from the fault, or from the report of a module, to the moment at which every PE on a wired bus does what
the new plan wants. Each single fault is planned as the manager would plan it. The table has the worst element of each
class of faults, once for each bus on which PEs report, since each bus has its own heartbeat period.

detect, distribute and activate are bounds. They follow from the response times that 'heronry bus' shows, the slices of
each plan, and the spec's heartbeat_ms and misses. They hold for one fault at a time and without lost frames, and leave
out delays by the operating system. decide is measured: the longest time that one of these plans took on this computer,
since the planner has no deadline. A plan made ahead is looked up in microseconds: --decide 0.1 stands for that.

examples:
  heronry bound elevator_and_chute                every class of faults, with its worst element
  heronry bound big_blue --phase glide --json     every element, for other tools
  heronry bound big_blue --decide 0.1             if the plans are made ahead
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry bound`."""
    parser = subparsers.add_parser(
        "bound",
        description="Bound the time from a fault to the new configuration, in four parts: "
        "detect, decide, distribute, activate.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    add_phase(parser)
    parser.add_argument(
        "--decide",
        type=_milliseconds,
        metavar="MS",
        help="assume that making a plan takes MS milliseconds; without this option the time is measured",
    )
    add_output(parser, "write every element as JSON")


def _milliseconds(text: str) -> int:
    """Read a time in milliseconds, 0 to 3 600 000; gives ns. Raises ArgumentTypeError for any other time."""
    duration = float(text)
    if not 0 <= duration <= 3_600_000:
        raise argparse.ArgumentTypeError(
            f"{text} is not a planning time; write a number of milliseconds from 0 to 3600000"
        )
    return round(duration * 1_000_000)
