"""`heronry dbc`: writes a DBC file (CAN database), with which cantools and other tools decode the bus."""

import argparse
import sys

from heronry_tools.console.spec_files import load_spec
from heronry_tools.reports.dbc import dbc_text


def run(arguments: argparse.Namespace) -> int:
    """Write the DBC; returns the exit code."""
    sys.stdout.write(dbc_text(load_spec(arguments.spec) if arguments.spec else None))
    return 0
