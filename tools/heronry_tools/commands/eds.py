"""`heronry eds`: the electronic data sheet with which CANopen tools read a PE."""

import argparse
import sys
from pathlib import Path
from typing import Any

_EPILOG = """\
examples:
  heronry eds -o heronry_pe.eds                  network.add_node(92, "heronry_pe.eds") in the canopen package
  heronry eds | grep ParameterName               every object by name

All PEs have the same objects, whatever their spec, so there is one file; a PE also gives it by SDO (object 1021h).
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry eds`."""
    parser = subparsers.add_parser(
        "eds",
        help="write the EDS of a PE, for CANopen tools",
        description="Write the object dictionary of a PE as an electronic data sheet (CiA 306).",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="write here instead of to standard output")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the EDS; returns the exit code."""
    from heronry_wire.eds import eds_text  # noqa: PLC0415 - as in every command: imported only when it runs

    if arguments.output is None:
        sys.stdout.write(eds_text())
    else:
        arguments.output.write_text(eds_text(), encoding="ascii")
    return 0
