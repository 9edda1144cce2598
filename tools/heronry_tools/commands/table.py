"""`heronry table`: the table from which a PE's agent runs."""

import argparse
import sys
from pathlib import Path
from typing import Any

from heronry_tools.analysis.made_ahead import CARRIED, add_contingencies_argument, contingencies_of
from heronry_tools.console.output import add_output_file
from heronry_tools.console.spec_argument import add_spec_argument, expect_pe, load_spec
from heronry_tools.runtime.table_files import table_texts, write_tables

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
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write one table, or all; returns the exit code."""
    from heronry_tools.console.errors import UserError  # noqa: PLC0415 - keeps `--help` quick

    spec = load_spec(arguments.spec)
    if (arguments.pe is None) == (arguments.all is None):
        what = "neither a PE nor --all is given" if arguments.all is None else "both a PE and --all are given"
        raise UserError(f"{what}: either name one PE, or write --all DIR for the tables of all PEs")
    if arguments.pe is not None:
        expect_pe(spec, arguments.pe)
    made = contingencies_of(spec, arguments.contingencies)
    if arguments.all is not None:
        write_tables(spec, spec.pes, arguments.all, made)
        return 0
    sys.stdout.write(table_texts(spec, [arguments.pe], made)[arguments.pe] + "\n")
    return 0
