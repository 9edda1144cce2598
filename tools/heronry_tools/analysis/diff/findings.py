"""Findings that `heronry check` has for one spec and not for the other.

Two findings are the same when their codes and sentences are the same. Lines are not compared, since they move with
every change.
"""

from collections import Counter
from dataclasses import dataclass

from heronry_dg.check.assess import Assessed, assess
from heronry_dg.findings import Finding
from heronry_tools.analysis.check.registry import RULES, checks_of


@dataclass(frozen=True, slots=True)
class FindingsChange:
    """The change in the findings of two specs.

    old, new: findings that only the old spec has, and findings that only the new spec has.
    stay: the number of findings that both have.
    """

    old: Assessed
    new: Assessed
    stay: int


def findings_change(old_name: str, old: bytes, new_name: str, new: bytes) -> FindingsChange:
    """Check two specs by every rule, and compare their findings."""
    before, after = _assessed(old_name, old), _assessed(new_name, new)
    old_alone, new_alone = _beyond(before, after), _beyond(after, before)
    return FindingsChange(old_alone, new_alone, len(after.findings) - len(new_alone.findings))


def _assessed(name: str, data: bytes) -> Assessed:
    return assess(data, name, checks_of(fast=False), RULES)


def _beyond(one: Assessed, other: Assessed) -> Assessed:
    """Return the findings of `one` that `other` does not have."""
    left = Counter(map(_said, other.findings))
    alone: list[Finding] = []
    for finding in one.findings:
        if left[_said(finding)]:
            left[_said(finding)] -= 1
        else:
            alone.append(finding)
    return Assessed(one.file, tuple(alone), one.lines)


def _said(finding: Finding) -> tuple[str, str]:
    return finding.code, finding.sentence
