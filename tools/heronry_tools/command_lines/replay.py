"""The command line of `heronry replay`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

from heronry_tools.console.contingencies_argument import add_contingencies_argument
from heronry_tools.console.output import add_output
from heronry_tools.console.spec_argument import SHIPPED

_EPILOG = """\
Each PREPARE and each step of ACTIVATE that the manager sent is a decision. The manager's core gets the frames that the
manager heard, at the same times. The replay shows what led to each decision, and whether the decision is the recorded
one. The channels of the log name its buses, as in a log of 'heronry demo --record'.

The operator's orders are not on the bus, so they are not replayed. SPEC must be the spec with which the manager flew,
and the recording must begin before the manager starts.

Exit codes: 0 all as recorded; 1 something differs; 2 the input cannot be used.

examples:
  heronry demo big_blue --kill pe:nav@3 --for 8 --record flight.log
  heronry replay flight.log big_blue
  heronry replay FOLDER                          a folder of 'heronry record' has its spec
  heronry replay flight.log big_blue --json | jq '.masterships[].entries[] | select(.differs)'
  heronry replay can0.log my.dg.yaml --contingencies my.contingencies
  heronry replay can0.log my.dg.yaml --key fleet.key
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry replay`."""
    parser = subparsers.add_parser(
        "replay",
        description="Run a recorded bus through the manager's core again, explain its decisions, and compare them.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "recording", metavar="FILE.log", type=Path, help="a candump log, or a folder of 'heronry record'"
    )
    parser.add_argument(
        "spec",
        metavar="SPEC",
        nargs="?",
        help=f"a *.dg.yaml file, or a shipped spec: {', '.join(SHIPPED)} (default: the spec in the folder)",
    )
    parser.add_argument(
        "--channel",
        metavar="NAME",
        help="CAN interface of the manager's bus, as the log names it; A,B if that bus has two channels",
    )
    single = "the plans for every single fault, if a PREPARE names a contingency by its number"
    add_contingencies_argument(parser, "with which the manager flew", single)
    parser.add_argument("--key", type=Path, metavar="FILE", help="key file with which the manager flew")
    add_output(parser, "write everything as JSON")
