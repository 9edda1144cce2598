"""Reports on flown scenarios, as text, as JSON and as JUnit."""

from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree as ET

from heronry_tools.sim.scenario.evaluation import Verdict
from heronry_tools.sim.scenario.flown import Flown


def text_report(flown: Flown) -> list[str]:
    """Return one line; if anything fails, further lines say what was expected and what was heard instead."""
    file, count = flown.script.file, len(flown.verdicts)
    head = f"{file}: {'holds' if flown.holds else 'FAILS'} ({flown.seconds:g} s in {flown.where}, {count} expected)"
    lines = [f"  {_failed(flown, verdict)}" for verdict in flown.verdicts if not verdict.holds]
    lines += [f"  violated: {violation}" for violation in flown.violations]
    if flown.differences:
        lines.append("  decisions differ from the golden trace; if they are right, --rewrite records them:")
        lines += [f"    {line}" for line in flown.differences]
    return [head, *lines]


def document(flown: Flown) -> dict[str, Any]:
    """Return the result of one flight as JSON data."""
    return {
        "file": str(flown.script.file),
        "why": flown.script.why,
        "where": flown.where,
        "holds": flown.holds,
        "expectations": [
            {
                "line": verdict.expectation.line,
                "expected": verdict.expectation.text,
                "from_ns": verdict.expectation.from_ns,
                "holds": verdict.holds,
                "seen": verdict.seen,
            }
            for verdict in flown.verdicts
        ],
        "violations": list(flown.violations),
        "trace": list(flown.trace),
        "differences": list(flown.differences or ()),
    }


def junit(flights: Iterable[Flown]) -> str:
    """Return a JUnit document with one suite per file.

    A suite has a case for each expectation, one case for violations, and one for the trace.
    """
    suites = ET.Element("testsuites", name="heronry scenario")
    for flown in flights:
        suites.append(_suite(flown))
    ET.indent(suites)
    return ET.tostring(suites, encoding="unicode", xml_declaration=True) + "\n"


def _suite(flown: Flown) -> ET.Element:
    failures = [
        (f"{v.expectation.line}: {v.expectation.text}", "" if v.holds else _failed(flown, v)) for v in flown.verdicts
    ]
    failures.append(("what must never be", "\n".join(flown.violations)))
    if flown.differences is not None:
        failures.append(("decided as before", "\n".join(flown.differences)))
    file, failed = str(flown.script.file), sum(bool(words) for _, words in failures)
    counts = {"tests": str(len(failures)), "failures": str(failed), "errors": "0", "skipped": "0"}
    suite = ET.Element("testsuite", {"name": file, **counts})
    for name, words in failures:
        case = ET.SubElement(suite, "testcase", name=name, classname=file)
        if words:
            failure = ET.SubElement(case, "failure", type="scenario", message=words.splitlines()[0])
            failure.text = words
    return suite


def _failed(flown: Flown, verdict: Verdict) -> str:
    one = verdict.expectation
    place = f"{flown.script.file}:{one.line}: from {one.from_ns / 1e9:g} s on"
    return f"{place}: expected {one.text}; {verdict.seen}"
