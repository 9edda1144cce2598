"""The command lines of `heronry export` and `heronry import`: arguments, their help, and examples."""

import argparse
from pathlib import Path
from typing import Any

from heronry_tools.console.output import add_output_file
from heronry_tools.console.spec_argument import add_spec_argument

_EXPORT_EPILOG = """\
The fault tree has the logic of the function, every element that can fail as a basic event, and the probabilities of the
spec over its mission_h. Resources are no part of it.

examples:
  heronry export openpsa big_blue elevator -o elevator.xml
  scram --probability true --limit-order 100 elevator.xml
"""
_IMPORT_EPILOG = """\
The spec has one device for each basic event, and one module for each gate. It is printed.

examples:
  heronry import openpsa elevator.xml > elevator.dg.yaml
  heronry cutsets elevator.dg.yaml elevator --logical --kinds device
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parsers of `heronry export` and `heronry import`."""
    export = subparsers.add_parser(
        "export", description="Write when a function is lost as a fault tree for other tools.", epilog=_EXPORT_EPILOG
    )
    formats = export.add_subparsers(metavar="FORMAT", required=True)
    writer = formats.add_parser(
        "openpsa",
        help="the Open-PSA Model Exchange Format (MEF), which scram reads",
        description="Write the fault tree of a function in the Open-PSA Model Exchange Format.",
        epilog=_EXPORT_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_spec_argument(writer)
    writer.add_argument("function", metavar="FUNCTION", help="a function of the spec")
    writer.add_argument("--phase", metavar="NAME", help="the phase (default: the first one of the spec)")
    writer.add_argument(
        "--mission", metavar="HOURS", type=float, help="length of the mission (default: mission_h, or 1)"
    )
    writer.add_argument("--kinds", metavar="KINDS", help="let only these kinds of elements fail (default: all)")
    add_output_file(writer, "Open-PSA", ".xml")
    writer.set_defaults(run="run_export")

    importer = subparsers.add_parser(
        "import", description="Make a spec of a fault tree of another tool, and print it.", epilog=_IMPORT_EPILOG
    )
    formats = importer.add_subparsers(metavar="FORMAT", required=True)
    reader = formats.add_parser(
        "openpsa",
        help="the Open-PSA Model Exchange Format (MEF)",
        description="Make a spec of a fault tree in the Open-PSA Model Exchange Format, and print it.",
        epilog=_IMPORT_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    reader.add_argument("file", metavar="FILE", type=Path, help="an Open-PSA file")
    reader.set_defaults(run="run_import")
