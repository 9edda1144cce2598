"""`heronry diff`: what a change of a spec changes, in the graph and in consequence.

Exit codes: 0 with any change, or none; 2 the input cannot be used.
"""

import argparse
import sys
from typing import Any

_EPILOG = """\
A function depends on an element (its single point of failure) if the loss of that element alone loses
the function. Critical functions, classes A to D, are examined in each phase that wants them.

examples:
  heronry diff big_blue my.dg.yaml                          what is different, and what follows from it
  heronry diff old.dg.yaml new.dg.yaml --format json        the same for a program
  heronry diff old.dg.yaml new.dg.yaml --format mermaid     what changed as a picture, for a pull request
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry diff`."""
    parser = subparsers.add_parser(
        "diff",
        help="tell what a change of a spec changes, and what follows from it",
        description="Compare two specs: elements, functions served, single points of failure, bus and CPU load.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("old", metavar="OLD", help="a *.dg.yaml file, or a shipped spec")
    parser.add_argument("new", metavar="NEW", help="the changed spec")
    parser.add_argument("--format", choices=("text", "json", "mermaid"), default="text", help="default: text")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compare and report; returns the exit code."""
    from heronry_tools.analysis.diff.difference import difference  # noqa: PLC0415 - slow to import
    from heronry_tools.analysis.diff.picture import mermaid_difference  # noqa: PLC0415
    from heronry_tools.analysis.diff.report import json_report, text_report  # noqa: PLC0415
    from heronry_tools.console.spec_argument import load_spec  # noqa: PLC0415

    old, new = load_spec(arguments.old), load_spec(arguments.new)
    match arguments.format:
        case "mermaid":
            sys.stdout.write(mermaid_difference(old, new))
        case "json":
            sys.stdout.write(json_report(difference(old, new)))
        case _:
            sys.stdout.write(text_report(difference(old, new)))
    return 0
