"""`heronry diff`: compares two versions of a spec: the elements of the graph, and the consequences of the change.

Exit codes: 0 the specs were compared; 1, with --exit-code only, they differ; 2 the input cannot be used.
"""

import argparse
import sys

from heronry_tools.analysis.diff.difference import difference
from heronry_tools.analysis.diff.elements import element_changes
from heronry_tools.analysis.diff.findings import findings_change
from heronry_tools.analysis.diff.picture import mermaid_difference
from heronry_tools.analysis.diff.report import json_report, text_report
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import spec_text


def run(arguments: argparse.Namespace) -> int:
    """Compare and report; returns the exit code."""
    if arguments.old == arguments.new == "-":
        raise UserError("only one of OLD and NEW can be standard input; name a file for the other")
    with Working(f"comparing {arguments.old} with {arguments.new}"):
        differ, report = _compared(arguments)
    sys.stdout.write(report)
    return int(differ and arguments.exit_code)


def _compared(arguments: argparse.Namespace) -> tuple[bool, str]:
    """Tell whether the specs differ; gives also the report."""
    texts = spec_text(arguments.old), spec_text(arguments.new)
    old, new = texts[0].load(), texts[1].load()
    differ = bool(element_changes(old, new)) or old.digest != new.digest
    if arguments.format == "mermaid":
        return differ, mermaid_difference(old, new)
    findings = findings_change(texts[0].name, texts[0].data, texts[1].name, texts[1].data)
    differ = differ or bool(findings.new.findings or findings.old.findings)
    report = json_report if arguments.json else text_report
    return differ, report(difference(old, new, findings))
