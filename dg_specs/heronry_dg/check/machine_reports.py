"""Reports of findings for programs: JSON, GitHub's workflow commands, SARIF and JUnit.

Lines and columns count from 1. Columns count characters. The end of a range is the column behind its last character.

Sources: SARIF 2.1.0 (OASIS standard, 2020), sections 3.14 to 3.51; workflow commands as GitHub's documentation of
Actions has them; the XML of JUnit in the form that Ant writes and other programs read.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any, Final
from urllib.parse import quote
from xml.sax.saxutils import escape, quoteattr

from heronry_dg.check.assess import Assessed
from heronry_dg.check.text_report import span_end
from heronry_dg.findings import Finding
from heronry_dg.rules.rule import Rule, Severity

SARIF_SCHEMA: Final = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"


def json_report(files: Sequence[Assessed], rules: Mapping[str, Rule]) -> str:
    """Return a JSON list with one object per finding."""
    found = [finding_fields(assessed, finding, rules) for assessed in files for finding in assessed.findings]
    return json.dumps(found, indent=2, ensure_ascii=False) + "\n"


def finding_fields(assessed: Assessed, finding: Finding, rules: Mapping[str, Rule]) -> dict[str, object]:
    """Return a finding as one object of the JSON report."""
    return {
        "file": finding.file,
        "line": finding.place.line,
        "column": finding.place.column,
        "end_column": _end(assessed, finding),
        "code": finding.code,
        "name": rules[finding.code].name,
        "severity": str(finding.severity),
        "sentence": finding.sentence,
        "hint": finding.hint,
    }


def github_report(files: Sequence[Assessed]) -> str:
    """Return one workflow command per finding, by which GitHub shows the finding beside its line."""
    return "".join(_command(assessed, finding) for assessed in files for finding in assessed.findings)


def _command(assessed: Assessed, finding: Finding) -> str:
    line, column = finding.place
    properties = {
        "file": finding.file,
        "line": line,
        "endLine": line,
        "col": column,
        "endColumn": _end(assessed, finding),
        "title": f"heronry {finding.code}",
    }
    written = ",".join(f"{key}={_property(str(value))}" for key, value in properties.items())
    hint = f" ({finding.hint})" if finding.hint else ""
    return f"::{finding.severity} {written}::{_data(finding.sentence + hint)}\n"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")


def sarif_report(files: Sequence[Assessed], rules: Mapping[str, Rule], version: str) -> str:
    """Return one run of SARIF 2.1.0, with all rules, and one result per finding."""
    order = {code: index for index, code in enumerate(rules)}
    run = {
        "tool": {
            "driver": {
                "name": "heronry",
                "version": version,
                "rules": [_sarif_rule(rule) for rule in rules.values()],
            }
        },
        "columnKind": "unicodeCodePoints",
        "artifacts": [{"location": {"uri": _uri(assessed.file)}} for assessed in files],
        "results": [
            _sarif_result(assessed, finding, order[finding.code]) for assessed in files for finding in assessed.findings
        ],
    }
    return json.dumps({"$schema": SARIF_SCHEMA, "version": "2.1.0", "runs": [run]}, indent=2) + "\n"


def _sarif_rule(rule: Rule) -> dict[str, Any]:
    return {
        "id": rule.code,
        "name": rule.name,
        "shortDescription": {"text": rule.what},
        "fullDescription": {"text": f"{rule.what} {rule.why}"},
        "help": {"text": rule.fix},
        "defaultConfiguration": {"level": str(rule.severity)},
    }


def _sarif_result(assessed: Assessed, finding: Finding, index: int) -> dict[str, Any]:
    line, column = finding.place
    region = {"startLine": line, "startColumn": column, "endLine": line, "endColumn": _end(assessed, finding)}
    hint = f" ({finding.hint})" if finding.hint else ""
    return {
        "ruleId": finding.code,
        "ruleIndex": index,
        "level": str(finding.severity),
        "message": {"text": finding.sentence + hint},
        "locations": [{"physicalLocation": {"artifactLocation": {"uri": _uri(finding.file)}, "region": region}}],
    }


def _uri(file: str) -> str:
    path = PurePath(file)
    return path.as_uri() if path.is_absolute() else quote(path.as_posix())


def junit_report(files: Sequence[Assessed]) -> str:
    """Return the report of JUnit, with one suite per file.

    A suite has one case per finding: an error is a failed case, any other finding is a passed case with a text. The
    suite of a file without findings has one passed case.
    """
    suites = "".join(_suite(assessed) for assessed in files)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name="heronry check">\n{suites}</testsuites>\n'


def _suite(assessed: Assessed) -> str:
    failures = sum(finding.severity is Severity.ERROR for finding in assessed.findings)
    cases = (
        "".join(map(_case, assessed.findings))
        or f"    <testcase name={_attribute('all rules')} classname={_attribute(assessed.file)}/>\n"
    )
    count = max(1, len(assessed.findings))
    head = f'name={_attribute(assessed.file)} tests="{count}" failures="{failures}" errors="0" skipped="0"'
    return f"  <testsuite {head}>\n{cases}  </testsuite>\n"


def _case(finding: Finding) -> str:
    name = _attribute(f"{finding.code} {finding.place.line}:{finding.place.column}")
    head = (
        f'name={name} classname={_attribute(finding.file)} file={_attribute(finding.file)} line="{finding.place.line}"'
    )
    text = escape(_xml(str(finding)))
    if finding.severity is Severity.ERROR:
        body = f"<failure type={_attribute(finding.code)} message={_attribute(finding.sentence)}>{text}</failure>"
    else:
        body = f"<system-out>{text}</system-out>"
    return f"    <testcase {head}>{body}</testcase>\n"


def _attribute(text: str) -> str:
    return quoteattr(_xml(text))


def _xml(text: str) -> str:
    """Replace what XML 1.0 forbids, and all else that is not printable, by U+FFFD."""
    return "".join(c if c.isprintable() or c in "\t\n" else "\ufffd" for c in text)


def _end(assessed: Assessed, finding: Finding) -> int:
    return span_end(assessed.line(finding.place.line), finding.place.column)
