"""The command line of `heronry log convert`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

from heronry_tools.console.spec_argument import add_spec_argument

_EPILOG = """\
examples:
  heronry log convert flight.log big_blue -o flight.mcap       for Foxglove, Lichtblick and PlotJuggler
  heronry log convert flight.log big_blue -o flight.mf4        for asammdf and other tools that read ASAM MDF 4
  heronry log convert FOLDER -o flight.mcap                    a folder of 'heronry record' holds its spec

Every variable of the spec is a signal MODULE.VARIABLE with its unit. PEs, buses and functions have signals, too; events
and reconfigurations are channels of their own. Needs: pip install "heronry[export]"
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry log`."""
    parser = subparsers.add_parser("log", description="Convert recorded flights.", epilog=_EPILOG)
    convert = parser.add_subparsers(metavar="convert", required=True).add_parser(
        "convert", description="Write a recorded flight as MCAP or MDF 4.", epilog=_EPILOG
    )
    convert.add_argument(
        "recording", metavar="FILE.log", type=Path, help="a candump log, a folder of 'heronry record', or a *.scenario"
    )
    add_spec_argument(convert, optional=True)
    convert.add_argument(
        "-o", "--output", dest="file", metavar="FILE", type=Path, required=True, help="*.mcap or *.mf4"
    )
    convert.add_argument(
        "--key", type=Path, metavar="FILE", help="key file that verifies the frames, if the flight has a key"
    )
