"""Instructions to the check in a spec's comments: findings ignored and raised, and findings about the comments."""

import pytest

from heronry_dg.check.assess import Choice, assess
from heronry_dg.check.examples import SOUND
from heronry_tools.analysis.check.registry import RULES, checks_of

EVERYTHING = Choice()


def told(text: str, choice: Choice = EVERYTHING) -> list[str]:
    assessed = assess(text.encode(), "x", checks_of(fast=True), RULES, choice)
    return [f"{finding.place.line} {finding.code} {finding.severity}" for finding in assessed.findings]


def spec(variable: str, head: str = "") -> str:
    return head + SOUND.replace("  speed: {type: FLOAT}\n", f"  speed: {{type: FLOAT}}\n{variable}\n")


def test_a_comment_behind_a_line_ignores_what_is_found_on_it() -> None:
    assert told(spec("  spare: {type: FLOAT}")) == ["11 DG240 warning"]
    assert told(spec("  spare: {type: FLOAT}  # dg: ignore[DG240] for the ground")) == []
    assert told(spec("  spare: {type: FLOAT}  #dg:ignore[DG241, DG240] for the ground")) == ["11 DG092 warning"]


def test_a_comment_that_stands_alone_speaks_of_the_next_line_that_says_something() -> None:
    assert told(spec("  # dg: ignore[DG240] for the ground\n\n  # and more\n  spare: {type: FLOAT}")) == []
    assert told(spec("  spare: {type: FLOAT}\n  # dg: ignore[DG240] too late")) == [
        "11 DG240 warning",
        "12 DG092 warning",
    ]


def test_an_ignore_wants_a_reason() -> None:
    assert told(spec("  spare: {type: FLOAT}  # dg: ignore[DG240]")) == ["11 DG091 error"]


@pytest.mark.parametrize(
    ("comment", "code"),
    [
        ("# dg: ignore DG240 because", "DG090"),
        ("# dg: disable[DG240] because", "DG090"),
        ("# dg: error[DG240]", "DG090"),
        ("# dg:", "DG090"),
        ("# dg: ignore[] because", "DG093"),
        ("# dg: ignore[DG24] because", "DG093"),
        ("# dg: ignore[DG201] because", "DG093"),
        ("# dg: ignore[DG092] because", "DG093"),
    ],
)
def test_a_comment_that_means_nothing_is_reported(comment: str, code: str) -> None:
    assert told(spec(f"  spare: {{type: FLOAT}}  {comment}")) == [f"11 {code} error", "11 DG240 warning"]


def test_the_head_of_a_spec_raises_a_warning_to_an_error() -> None:
    assert told(spec("  spare: {type: FLOAT}", "# my wing\n# dg: error[DG240]\n\n")) == ["14 DG240 error"]
    assert told(spec("  spare: {type: FLOAT}", "# dg: error[DG230, DG240]\n")) == ["1 DG093 error", "12 DG240 error"]


def test_a_raised_warning_can_still_be_ignored_on_its_line() -> None:
    assert told(spec("  spare: {type: FLOAT}  # dg: ignore[DG240] for the ground", "# dg: error[DG240]\n")) == []


def test_an_ignore_is_unused_only_where_its_rule_was_looked_for() -> None:
    text = spec("  other: {type: FLOAT, initial: 1}  # dg: ignore[DG240, DG243] later")
    assert told(text) == ["11 DG092 warning"]
    assert told(text, Choice(selected=("DG1",))) == []
    assert told(text, Choice(ignored=("DG243",))) == []
    assert told(text, Choice(ignored=("DG092",))) == []


def test_a_spec_that_does_not_load_still_hears_about_its_comments_but_not_that_they_are_unused() -> None:
    broken = spec("  spare: {type: FLOAT}  # dg: ignore[DG240] later\n  odd: {type: X}  # dg: ignore[DG1] x")
    assert told(broken) == ["12 DG093 error", "12 DG117 error"] or told(broken) == ["12 DG117 error", "12 DG093 error"]


def test_lines_are_counted_as_yaml_counts_them() -> None:
    text = spec("  spare: {type: FLOAT}  # dg: ignore[DG240] for the ground")
    for line_break in ("\r\n", "\r"):
        assert told(text.replace("\n", line_break)) == []
