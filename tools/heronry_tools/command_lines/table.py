"""The command line of `heronry table`: arguments, their help, and examples."""

from pathlib import Path
from typing import Any

from heronry_tools.console.contingencies_argument import CARRIED, add_contingencies_argument
from heronry_tools.console.output import add_output_file
from heronry_tools.console.spec_argument import add_spec_argument

_EPILOG = """\
examples:
  heronry table big_blue nav -o nav.table
  pe-agent --table nav.table -i socketcan -c can0
  heronry table big_blue --all tables/           one file per PE, named PE.table
  heronry table big_blue --all tables/ --contingencies big_blue.contingencies     with plans made ahead on board
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry table`."""
    parser = subparsers.add_parser(
        "table",
        description="Compile what one PE needs of a spec: modules, modes, identifiers, ports.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("pe", metavar="PE", nargs="?", help="name of the PE")
    add_output_file(parser, "table", ".table")
    parser.add_argument("--all", metavar="DIR", type=Path, help="write the tables of all PEs into this folder")
    add_contingencies_argument(parser, CARRIED)
