"""The command line of `heronry dbc`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.output import add_output_file
from heronry_tools.console.spec_argument import add_spec_argument

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
