"""Every rule has a code, its texts, and two examples: one with this finding alone, and one without findings.

The first finding stands where the two examples differ, or else at the line that `ELSEWHERE` names.
"""

from difflib import SequenceMatcher
from pathlib import Path

import pytest

from heronry_dg.check.assess import assess
from heronry_dg.check.examples import whole_spec
from heronry_dg.findings import Finding, Findings
from heronry_dg.loader import read_file
from heronry_dg.rules import file
from heronry_dg.rules.rule import Rule, Severity
from heronry_dg.yaml_source import MOST_BYTES
from heronry_tools.analysis.check.registry import CHECKS, FAMILIES, RULES, checks_of
from heronry_tools.cli import main

GOOD = whole_spec(file.SYNTAX.good)
SHOWN = [rule for rule in RULES.values() if not rule.bad.startswith("(")]


def found_in(data: bytes) -> tuple[Finding, ...]:
    return assess(data, "x.dg.yaml", checks_of(fast=False), RULES).findings


ELSEWHERE = {  # how the line begins that a finding names
    "DG203": "driver: {device: gps, needs: echo",
    "DG206": "gates: {light: {demux",
    "DG225": "cruise: {when: {variable: speed",
    "DG230": "display: {device: lamp, needs: {and:",
    "DG241": "logger: {needs: speed",
    "DG242": "showing: {output: display}",
    "DG243": "gates: {any_speed: speed}",
    "DG248": "blinking: {output: blinker",
    "DG251": "common_cause:",
    "DG303": "functions: {warning:",
    "DG304": "showing: {output: display}",
    "DG305": "buses: {can0:",
    "DG308": "buses: {can0:",
    "DG310": "functions: {showing:",
    "DG311": "functions: {showing:",
    "DG401": "nav: {node_id: 92",
    "DG402": "nav: {node_id: 92",
    "DG403": "smoother: {needs: speed",
    "DG404": "smoother: {needs: speed",
    "DG405": "nav: {node_id: 92",
    "DG410": "gates: {light: {demux: speed}}",
    "DG411": "display: {device: lamp, needs: {xor:",
    "DG412": "display: {needs: {or: {k: 2",
    "DG420": "separate: [[one, two]]",
    "DG421": "separate: [[driver, other_driver]]",
    "DG506": "speed: {type: FLOAT, versions: 2}",
    "DG508": "tail: {node_id: 93",
}


@pytest.mark.parametrize("rule", SHOWN, ids=lambda rule: rule.code)
def test_the_bad_example_earns_its_code_alone_in_its_place_and_the_good_one_nothing(rule: Rule) -> None:
    bad, good = whole_spec(rule.bad), whole_spec(rule.good)
    found = found_in(bad)
    assert {finding.code for finding in found} == {rule.code}
    lines, line = bad.splitlines(), found[0].place.line
    if rule.code in ELSEWHERE:
        assert lines[line - 1].lstrip().startswith(ELSEWHERE[rule.code].encode())
    else:
        opcodes = SequenceMatcher(None, lines, good.splitlines(), autojunk=False).get_opcodes()
        assert any(kind != "equal" and begin < line <= end for kind, begin, end, *_ in opcodes)
    assert found_in(good) == ()


def test_what_cannot_be_shown_earns_its_code_too(tmp_path: Path) -> None:
    findings = Findings("x")
    assert read_file(tmp_path / "missing.dg.yaml", findings) is None
    assert [finding.code for finding in findings] == [file.UNREADABLE.code]
    assert [finding.code for finding in found_in(GOOD.ljust(MOST_BYTES + 1))] == [file.TOO_LARGE.code]
    assert found_in(GOOD.ljust(MOST_BYTES)) == ()
    assert RULES.keys() - {rule.code for rule in SHOWN} == {file.UNREADABLE.code, file.TOO_LARGE.code}


@pytest.mark.parametrize("rule", RULES.values(), ids=lambda rule: rule.code)
def test_every_rule_says_what_it_is_why_it_matters_and_how_it_is_fixed(rule: Rule) -> None:
    for text in (rule.what, rule.why, rule.fix):
        assert text[0].isupper() or text[0] in "`'"
        assert text.endswith((".", ")"))
    assert rule.bad != rule.good
    assert not (rule.stops and rule.severity is Severity.WARNING)


def test_a_file_that_leads_nowhere_and_then_to_a_spec(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, target = tmp_path / "x.dg.yaml", tmp_path / "target"
    path.symlink_to(target)
    assert main(["check", str(tmp_path)]) == 1
    assert f"{path}:1:1: DG001 error: " in capsys.readouterr().out
    target.write_bytes(GOOD)
    assert main(["check", str(tmp_path)]) == 0


@pytest.mark.parametrize("code", RULES)
def test_every_code_is_explained_and_has_its_place_in_the_documentation(
    code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", code]) == 0
    assert capsys.readouterr().out.startswith(f"{code} ")
    assert f"\n### {code} {RULES[code].name}\n" in Path("docs/rules.md").read_text()


def test_names_of_rules_differ_and_families_are_in_order() -> None:
    assert len({rule.name for rule in RULES.values()}) == len(RULES)
    assert list(RULES) == sorted(RULES)
    assert CHECKS.keys() <= {family.prefix for family in FAMILIES}
    for family in FAMILIES:
        assert all(code.startswith(family.prefix) for code in family.rules)
