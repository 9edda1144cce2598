"""The command line of `heronry scenario`: arguments, their help, and examples."""

import argparse
from pathlib import Path
from typing import Any

from heronry_tools.console.output import JSON, add_output
from heronry_wire.bus_arguments import add_bus_arguments

_LONGEST_PATIENCE = 100
_EPILOG = """\
A scenario file:

  # A processor dies; another one takes its work.    why it exists
  spec elevator_and_chute                            a shipped spec, or a file (path from this folder)
  seed 7
  at 2.0s kill pe:control_pe                         also restore, phase, fail, clear, and every fault of the simulator
  expect function:elevator served within 200ms       evaluated from frames: what is heard on the bus
  at 4.0s restore pe:control_pe
  expect pe:control_pe active within 2s
  end 8s

In the simulator the decisions of the manager are compared with FILE.golden, where there is one.

examples:
  heronry scenario tests/scenarios/*.scenario           in the simulator
  heronry scenario new.scenario --rewrite               keep its decisions as the golden trace
  heronry scenario kill.scenario -i softbus             real processes on software buses of its own
  heronry scenario kill.scenario -i socketcan -c vcan0  real processes, the manager's bus is vcan0
  heronry scenario kill.scenario -i softbus --patience 5  on a busy computer
  heronry scenario *.scenario -o results.xml                  as JUnit XML, for CI
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry scenario`."""
    parser = subparsers.add_parser(
        "scenario",
        description="Fly scenario files, in the simulator or with real processes, and check what they expect.",
        epilog=_EPILOG,
    )
    parser.add_argument("files", metavar="FILE", nargs="+", type=Path, help="scenario files")
    add_output(parser, "write one JSON object per file", {"text": (), "json": JSON, "junit": (".xml",)})
    parser.add_argument(
        "--rewrite", action="store_true", help="write FILE.golden anew, if every expectation holds (simulator only)"
    )
    parser.add_argument(
        "--patience",
        metavar="N",
        type=_patience,
        help="for real processes on a busy computer: 'within 80ms' then means N times 80 ms (N: 1 to 100; default 1)",
    )
    add_bus_arguments(parser, "real processes, with this bus for the manager (default: the simulator)")


def _patience(text: str) -> float:
    """Read the factor, 1 to 100, by which the times after `within` are multiplied; raises ArgumentTypeError."""
    try:
        times = float(text)
    except ValueError:
        times = 0.0
    if not 1 <= times <= _LONGEST_PATIENCE:
        raise argparse.ArgumentTypeError(
            f"the times after 'within' cannot be multiplied by {text}; write a number from 1 to 100"
        )
    return times
