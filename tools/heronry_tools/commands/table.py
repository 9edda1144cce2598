"""`heronry table`: the table from which a PE's agent runs."""

import argparse
import sys

from heronry_tools.analysis.made_ahead import contingencies_of
from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_files import expect_pe, load_spec
from heronry_tools.runtime.table_files import table_texts, write_tables


def run(arguments: argparse.Namespace) -> int:
    """Write one table, or all; returns the exit code."""
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
