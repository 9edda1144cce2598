"""Every rule has a code, its texts, and two examples: one with this finding alone, and a twin without findings."""

from pathlib import Path

import pytest

from heronry_dg.check.assess import assess
from heronry_dg.check.examples import whole_spec
from heronry_dg.findings import Findings
from heronry_dg.loader import read_file
from heronry_dg.rules import file
from heronry_dg.rules.rule import Rule, Severity
from heronry_dg.yaml_source import MOST_BYTES
from heronry_tools.analysis.check.registry import CHECKS, FAMILIES, RULES, checks_of

SHOWN = [rule for rule in RULES.values() if not rule.bad.startswith("(")]


def codes_in(data: bytes) -> set[str]:
    return {finding.code for finding in assess(data, "x.dg.yaml", checks_of(fast=False), RULES).findings}


@pytest.mark.parametrize("rule", SHOWN, ids=lambda rule: rule.code)
def test_the_bad_example_earns_its_code_alone_and_the_good_one_nothing(rule: Rule) -> None:
    assert codes_in(whole_spec(rule.bad)) == {rule.code}
    assert codes_in(whole_spec(rule.good)) == set()


def test_what_cannot_be_shown_earns_its_code_too(tmp_path: Path) -> None:
    findings = Findings("x")
    assert read_file(tmp_path / "missing.dg.yaml", findings) is None
    assert [finding.code for finding in findings] == [file.UNREADABLE.code]
    assert codes_in(b" " * (MOST_BYTES + 1)) == {file.TOO_LARGE.code}
    assert RULES.keys() - {rule.code for rule in SHOWN} == {file.UNREADABLE.code, file.TOO_LARGE.code}


@pytest.mark.parametrize("rule", RULES.values(), ids=lambda rule: rule.code)
def test_every_rule_says_what_it_is_why_it_matters_and_how_it_is_fixed(rule: Rule) -> None:
    for text in (rule.what, rule.why, rule.fix):
        assert text[0].isupper() or text[0] in "`'"
        assert text.endswith((".", ")"))
    assert rule.bad != rule.good
    assert not (rule.stops and rule.severity is Severity.WARNING)


def test_names_of_rules_differ_and_families_are_in_order() -> None:
    assert len({rule.name for rule in RULES.values()}) == len(RULES)
    assert list(RULES) == sorted(RULES)
    assert CHECKS.keys() <= {family.prefix for family in FAMILIES}
    for family in FAMILIES:
        assert all(code.startswith(family.prefix) for code in family.rules)
