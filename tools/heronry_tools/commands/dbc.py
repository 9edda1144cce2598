"""`heronry dbc`: a DBC with which cantools reads the bus."""

import argparse
import sys
from pathlib import Path
from typing import Any

_EPILOG = """\
examples:
  heronry dbc big_blue -o big_blue.dbc
  heronry demo --record flight.log && cantools decode big_blue.dbc <flight.log
  heronry dbc >management.dbc                    the management protocol alone, for any spec
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry dbc`."""
    parser = subparsers.add_parser(
        "dbc",
        help="write a DBC of a spec's data and of the management protocol",
        description="Write a DBC: data by variable name and unit, management by field.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("spec", metavar="SPEC", nargs="?", help="a *.dg.yaml file, or a shipped spec")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="write here instead of to standard output")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the DBC; returns the exit code."""
    from heronry_tools.console.spec_argument import load_spec  # noqa: PLC0415
    from heronry_tools.reports.dbc import dbc_text  # noqa: PLC0415 - cantools is slow to import

    text = dbc_text(load_spec(arguments.spec) if arguments.spec else None)
    if arguments.output is None:
        sys.stdout.write(text)
    else:
        arguments.output.write_text(text)
    return 0
