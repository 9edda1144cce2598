"""Reports as others read them: SARIF by its schema, JUnit by a parser, GitHub's commands by their grammar."""

import json
import re
from urllib.parse import unquote

import pytest
from hypothesis import given
from hypothesis import strategies as st
from junitparser import Failure, JUnitXml
from pydantic_sarif.model import StaticAnalysisResultsFormatSarifVersion210JsonSchema as Sarif  # from the OASIS schema

from heronry_dg.check.assess import Assessed, assess
from heronry_dg.check.examples import SOUND
from heronry_dg.check.machine_reports import github_report, json_report, junit_report, sarif_report
from heronry_dg.check.text_report import by_code, concise, full, span_end, summary
from heronry_dg.findings import Finding, Place
from heronry_dg.rules.rule import Severity
from heronry_tools.analysis.check.registry import RULES, checks_of

WRONG = SOUND.replace("  speed: {type: FLOAT}\n", "  speed: {type: FLOAT}\n  spare: {type: FLOAT}\n").replace(
    "cpu: 1, ram: 64KiB, flash: 64KiB}\n  tail", 'cpu: 1, ram: "64 kB", flash: 64KiB}\n  tail'
)
WARNED = SOUND.replace("  speed: {type: FLOAT}\n", "  speed: {type: FLOAT}\n  spare: {type: FLOAT}\n")

NASTY = 'a "b" <c> & 100%: \x1b[31m,\n]]>\x00 é 高'


def assessed(text: str, file: str = "specs/my wing.dg.yaml") -> Assessed:
    return assess(text.encode(), file, checks_of(fast=True), RULES)


FILES = [assessed(WRONG), assessed(WARNED, "b.dg.yaml"), assessed(SOUND, "c.dg.yaml")]
NASTY_FILE = Assessed(
    NASTY.replace("\x00", "").replace("\n", ""),
    (Finding("f:,%\n", Place(9, 9), "DG201", Severity.ERROR, NASTY, NASTY),),
)


def test_json_has_all_that_is_known_of_a_finding() -> None:
    first, second = json.loads(json_report(FILES, RULES))
    assert first == {
        "file": "specs/my wing.dg.yaml",
        "line": 4,
        "column": 50,
        "end_column": 57,
        "code": "DG113",
        "name": "bad-memory-size",
        "severity": "error",
        "sentence": "'ram' of pe 'nav' must be a size of memory, not '64 kB'",
        "hint": "write a size such as 64KiB or 2MiB, or a number of bytes",
    }
    assert (second["file"], second["line"], second["severity"]) == ("b.dg.yaml", 11, "warning")


def test_sarif_is_valid_and_shows_where() -> None:
    text = sarif_report(FILES, RULES, "1.2.3")
    Sarif.model_validate_json(text)
    (run,) = json.loads(text)["runs"]
    assert [result["ruleId"] for result in run["results"]] == ["DG113", "DG240"]
    assert [result["level"] for result in run["results"]] == ["error", "warning"]
    place = run["results"][0]["locations"][0]["physicalLocation"]
    assert unquote(place["artifactLocation"]["uri"]) == "specs/my wing.dg.yaml"
    assert place["region"] == {"startLine": 4, "startColumn": 50, "endLine": 4, "endColumn": 57}
    for result in run["results"]:
        assert run["tool"]["driver"]["rules"][result["ruleIndex"]]["id"] == result["ruleId"]


def test_sarif_of_nothing_and_of_nasty_text_is_valid_too() -> None:
    Sarif.model_validate_json(sarif_report([], RULES, "1"))
    Sarif.model_validate_json(sarif_report([NASTY_FILE], RULES, "1"))
    absolute = json.loads(sarif_report([assessed(WRONG, "/a b/c.dg.yaml")], RULES, "1"))
    place = absolute["runs"][0]["results"][0]["locations"][0]["physicalLocation"]
    assert place["artifactLocation"]["uri"] == "file:///a%20b/c.dg.yaml"


def test_junit_fails_for_errors_and_lets_warnings_pass() -> None:
    suites = list(JUnitXml.fromstring(junit_report(FILES).encode()))
    assert [(suite.name, suite.tests, suite.failures) for suite in suites] == [
        ("specs/my wing.dg.yaml", 1, 1),
        ("b.dg.yaml", 1, 0),
        ("c.dg.yaml", 1, 0),
    ]
    (wrong,), (warned,), (clean,) = map(list, suites)
    (failure,) = wrong.result
    assert isinstance(failure, Failure)
    assert failure.type == "DG113"
    assert "write a size such as 64KiB" in (failure.text or "")
    assert wrong.name == "DG113 4:50"
    assert warned.is_passed
    assert "DG240 warning" in warned.system_out
    assert clean.is_passed


def test_junit_of_nasty_text_is_xml() -> None:
    ((case,),) = map(list, JUnitXml.fromstring(junit_report([NASTY_FILE]).encode()))
    assert "100%" in case.result[0].message


def commands(text: str) -> list[tuple[str, dict[str, str], str]]:
    """Workflow commands as a runner reads them: `::name key=value,...::data`, percent-escaped."""

    def plain(escaped: str) -> str:
        for code, character in (("%0D", "\r"), ("%0A", "\n"), ("%3A", ":"), ("%2C", ","), ("%25", "%")):
            escaped = escaped.replace(code, character)
        return escaped

    found = []
    for line in text.splitlines():
        match = re.fullmatch(r"::(\w+) ([^:]*)::(.*)", line)
        assert match is not None, line
        properties = dict(pair.split("=", 1) for pair in match[2].split(","))
        found.append((match[1], {key: plain(value) for key, value in properties.items()}, plain(match[3])))
    return found


def test_github_shows_each_finding_beside_its_line() -> None:
    (name, properties, data), second = commands(github_report(FILES))
    assert name == "error"
    assert properties == {
        "file": "specs/my wing.dg.yaml",
        "line": "4",
        "endLine": "4",
        "col": "50",
        "endColumn": "57",
        "title": "heronry DG113",
    }
    assert data.startswith("'ram' of pe 'nav' must be a size of memory")
    assert second[0] == "warning"


def test_github_escapes_what_would_end_a_command() -> None:
    ((_, properties, data),) = commands(github_report([NASTY_FILE]))
    assert properties["file"] == "f:,%\n"
    assert data == f"{NASTY} ({NASTY})"


@pytest.mark.parametrize(
    ("line", "column", "end"),
    [("a: bcd, e", 4, 7), ('a: "b c"', 4, 9), ("a: 'it''s'", 4, 11), ("{a: 1}", 1, 2), ("ab", 3, 3), ("", 7, 7)],
)
def test_a_finding_ends_with_its_word(line: str, column: int, end: int) -> None:
    assert span_end(line, column) == end


def caret(line: str, column: int) -> tuple[str, str]:
    found = Finding("f", Place(1, column), "DG201", Severity.ERROR, "no")
    _, shown, mark, *_ = full([Assessed("f", (found,), {1: line})]).split("\n")
    return shown.removeprefix("1 | "), mark.removeprefix("  | ")


def test_the_caret_stands_below_wide_and_narrow_characters() -> None:
    assert caret("高度: {x: 1}", 6) == ("高度: {x: 1}", " " * 7 + "^")
    assert caret("e\u0301: bc", 5) == ("e\u0301: bc", "   ^^")
    assert caret("\ta: bc", 5) == (" a: bc", "    ^^")


def test_of_a_long_line_the_part_around_the_place_is_shown() -> None:
    shown, mark = caret("x" * 5000 + " name " + "y" * 5000, 5002)
    assert len(shown) < 110
    assert shown[mark.index("^") : mark.rindex("^") + 1] == "name"


@given(st.text(max_size=300), st.integers(1, 320))
def test_any_line_can_be_shown(line: str, column: int) -> None:
    text = line.replace("\n", "").replace("\r", "")
    found = Finding("f", Place(1, column), "DG201", Severity.ERROR, "no", "hint")
    report = full([Assessed("f", (found,), {1: text})])
    assert all(c.isprintable() or c == "\n" or not c.isspace() for c in report)


def test_of_very_many_findings_the_first_are_shown_and_the_others_counted() -> None:
    found = tuple(Finding("f", Place(line, 1), "DG201", Severity.ERROR, "no") for line in range(1, 5001))
    report = full([Assessed("f", found), *FILES])
    assert report.count("f:") < 110
    assert "\nf: and 4900 more; '--format concise' shows all\n" in report
    assert report.endswith(full(FILES))


def test_colours_change_nothing_but_the_colour() -> None:
    assert re.sub(r"\x1b\[[0-9;]*m", "", full(FILES, colour=True)) == full(FILES)
    assert concise(FILES).count("\n") == 2
    assert summary(FILES) == "3 specs checked: 1 error and 1 warning"


def test_many_findings_begin_with_how_many_there_are_of_each_code() -> None:
    place = Place(1, 1)
    codes = [("DG401", Severity.WARNING)] * 4 + [("DG302", Severity.ERROR)] + [("DG201", Severity.ERROR)] * 2
    found = tuple(Finding("f", place, code, severity, "no") for code, severity in codes)
    lines = by_code([Assessed("f", found[:3]), Assessed("g", found[3:])], RULES).splitlines()
    assert lines == [
        f"   2 DG201 error  {RULES['DG201'].what}",
        f"   1 DG302 error  {RULES['DG302'].what}",
        f"   4 DG401 warning  {RULES['DG401'].what}",
        "'heronry explain CODE' explains one, '--format concise' gives each a line.",
        "",
    ]
    coloured = by_code([Assessed("f", found)], RULES, colour=True)
    assert coloured != re.sub(r"\x1b\[[0-9;]*m", "", coloured)


def test_few_findings_need_no_summary_before_them() -> None:
    assert by_code(FILES, RULES) == ""
