"""`heronry export` and `heronry import`: fault trees for other tools of reliability, and from them.

Exit codes: 0 done; 2 the input cannot be used.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

from heronry_tools.console.output import add_output_file
from heronry_tools.console.spec_argument import add_spec_argument, load_spec, named_function

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
    writer.set_defaults(run=run_export)

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
    reader.set_defaults(run=run_import)


def run_export(arguments: argparse.Namespace) -> int:
    """Write the fault tree of a function; returns the exit code."""
    from heronry_dg.situation import elements, situation  # noqa: PLC0415 - slow to import, as are all here
    from heronry_tools.analysis.campaign.scope import kinds_of  # noqa: PLC0415
    from heronry_tools.analysis.reliability.failure import failure  # noqa: PLC0415
    from heronry_tools.analysis.reliability.open_psa.writing import fault_tree  # noqa: PLC0415
    from heronry_tools.analysis.reliability.spec_hazards import hazards, mission_hours  # noqa: PLC0415
    from heronry_tools.console.errors import UserError  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    function = named_function(spec, arguments.function).name
    phase = situation(spec, phase=arguments.phase).phase
    hours = mission_hours(spec) if arguments.mission is None else float(arguments.mission)
    if not 0.0 < hours < float("inf"):
        raise UserError(f"--mission {hours:g}: write the hours of the mission, a number above 0")
    kinds = kinds_of(arguments.kinds)
    may_fail = [one for one in elements(spec) if one.partition(":")[0] in kinds]
    found = failure(spec.in_phase(phase), function, may_fail)
    sys.stdout.write(fault_tree(function, found.formula, found.root, hazards(spec).among(may_fail), hours))
    return 0


def run_import(arguments: argparse.Namespace) -> int:
    """Print the spec of a fault tree; returns the exit code."""
    from heronry_tools.analysis.reliability.open_psa.reading import read_tree  # noqa: PLC0415
    from heronry_tools.analysis.reliability.open_psa.spec_text import spec_text  # noqa: PLC0415

    tree = read_tree(arguments.file)
    text = spec_text(tree, arguments.file.stem)
    if tree.without:
        some = ", ".join(tree.without[:4]) + (" ..." if len(tree.without) > 4 else "")
        print(f"heronry: no rate and no probability is read of {len(tree.without)} events: {some}", file=sys.stderr)
    sys.stdout.write(text)
    return 0
