"""`heronry diff`: compares two versions of a spec: the elements of the graph, and the consequences of the change.

Exit codes: 0 the specs were compared; 1, with --exit-code only, they differ; 2 the input cannot be used.
"""

import argparse
import sys
from typing import Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.output import JSON, add_output

_EPILOG = """\
The second line tells whether the digest changes, and what follows from that. A function depends on an element (its
single point of failure) if the loss of that element alone loses the function. Critical functions, classes A to D, are
examined in each phase that wants them. The output ends with the findings of 'heronry check' that only NEW has, and
those that only OLD has.

OLD and NEW are each a *.dg.yaml, a shipped spec, REV:PATH in git (:PATH is what is staged), or - for standard input.

examples:
  heronry diff big_blue my.dg.yaml                          what is different, and what follows from it
  heronry diff HEAD:my.dg.yaml my.dg.yaml                   what was changed since the last commit
  heronry diff main:specs/my.dg.yaml HEAD:specs/my.dg.yaml  what a branch changes
  heronry diff my.dg.yaml <(sed 's/cpu: 0.20/cpu: 0.60/' my.dg.yaml)      what if
  heronry diff old.dg.yaml new.dg.yaml --json               the same for a program
  heronry diff old.dg.yaml new.dg.yaml --format mermaid     what changed as a picture, for a pull request
  heronry diff HEAD:my.dg.yaml my.dg.yaml --exit-code       ends with 1 if anything changed, for CI
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry diff`."""
    parser = subparsers.add_parser(
        "diff",
        description="Compare two specs: elements, functions served, single points of failure, bus and CPU load.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "old", metavar="OLD", help="a *.dg.yaml, a shipped spec, REV:PATH in git, or - (standard input)"
    )
    parser.add_argument("new", metavar="NEW", help="the changed spec")
    parser.add_argument(
        "--exit-code", action="store_true", help="end with exit code 1 if the specs differ, as git diff does"
    )
    add_output(parser, forms={"text": (), "json": JSON, "mermaid": (".mmd", ".mermaid")})
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compare and report; returns the exit code."""
    from heronry_tools.analysis.diff.difference import difference  # noqa: PLC0415 - slow to import
    from heronry_tools.analysis.diff.elements import element_changes  # noqa: PLC0415
    from heronry_tools.analysis.diff.findings import findings_change  # noqa: PLC0415
    from heronry_tools.analysis.diff.picture import mermaid_difference  # noqa: PLC0415
    from heronry_tools.analysis.diff.report import json_report, text_report  # noqa: PLC0415
    from heronry_tools.console.spec_argument import spec_text  # noqa: PLC0415

    if arguments.old == arguments.new == "-":
        raise UserError("only one of OLD and NEW can be standard input; name a file for the other")
    texts = spec_text(arguments.old), spec_text(arguments.new)
    old, new = texts[0].load(), texts[1].load()
    differ = bool(element_changes(old, new)) or old.digest != new.digest
    if arguments.format == "mermaid":
        sys.stdout.write(mermaid_difference(old, new))
    else:
        findings = findings_change(texts[0].name, texts[0].data, texts[1].name, texts[1].data)
        differ = differ or bool(findings.new.findings or findings.old.findings)
        report = json_report if arguments.json else text_report
        sys.stdout.write(report(difference(old, new, findings)))
    return int(differ and arguments.exit_code)
