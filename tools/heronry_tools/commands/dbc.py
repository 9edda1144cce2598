"""`heronry dbc`: writes a DBC file (CAN database), with which cantools and other tools decode the bus."""

import argparse
import sys
from typing import Any

from heronry_tools.console.output import add_output_file
from heronry_tools.console.spec_argument import add_spec_argument, load_spec

_EPILOG = """\
examples:
  heronry dbc big_blue -o big_blue.dbc
  heronry demo --record flight.log && cantools decode big_blue.dbc <flight.log
  heronry dbc -o management.dbc                  the management protocol alone, for any spec
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry dbc`."""
    parser = subparsers.add_parser(
        "dbc",
        description="Write a DBC file. With it other tools decode frames of a spec and of the management protocol.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser, optional=True)
    add_output_file(parser, "DBC", ".dbc")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the DBC; returns the exit code."""
    from heronry_tools.reports.dbc import dbc_text  # noqa: PLC0415 - cantools is slow to import

    sys.stdout.write(dbc_text(load_spec(arguments.spec) if arguments.spec else None))
    return 0
