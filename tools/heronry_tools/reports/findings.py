"""One result of a check, in one sentence; if something is wrong, also the command line or sentence that helps.

`doctor`, `preflight` and `status --exit-code` give such findings; a list of findings is printed here.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One result of a check.

    check: one word that names the check; the user may filter findings by it.
    says: the result in a sentence.
    remedy: a command line or a sentence that helps; None if nothing is wrong.
    """

    check: str
    says: str
    remedy: str | None = None

    @property
    def is_right(self) -> bool:
        """Tell whether no remedy is needed."""
        return self.remedy is None


def all_right(findings: Sequence[Finding]) -> bool:
    """Tell whether no finding needs a remedy."""
    return all(finding.is_right for finding in findings)


def as_text(findings: Sequence[Finding], if_right: str, if_not: str = "") -> Iterator[str]:
    """Write findings as lines of text: the checks, what to type where one is not right, and a verdict.

    if_right: the verdict if every finding is right. if_not: stands before the other verdict.
    """
    for finding in findings:
        yield f"{'ok ' if finding.is_right else 'NOT'} {finding.check:<13} {finding.says}"
        if finding.remedy is not None:
            yield f"    {'':<13} type: {finding.remedy}"
    wrong = sum(not finding.is_right for finding in findings)
    yield if_right if not wrong else f"{if_not}{wrong} of {len(findings)} things are not right"


def as_json(findings: Sequence[Finding]) -> str:
    """Write findings as one JSON object for programs."""
    told = [{"check": f.check, "ok": f.is_right, "says": f.says, "type": f.remedy} for f in findings]
    return json.dumps({"v": 1, "ok": all_right(findings), "findings": told}, indent=2)
