"""Makes one spec of two, and checks it as `heronry check` does, by every rule.

The file of one vehicle may say why a finding about it is ignored: nothing gives a datum, for example, which the other
vehicle gives. Where the combined spec has no such finding any more, the comment goes.
"""

import re
from dataclasses import dataclass
from typing import Final

from heronry_dg.check.assess import Assessed, assess
from heronry_dg.loader import load_bytes
from heronry_dg.rules.file import UNUSED_IGNORE
from heronry_dg.rules.rule import Severity
from heronry_tools.analysis.check.registry import RULES, checks_of
from heronry_tools.analysis.combine.joining import Choices, CombineError, join
from heronry_tools.analysis.combine.spec_text import Document, fields
from heronry_tools.analysis.combine.writing import Half, combined_text, told

_IGNORE: Final = re.compile(r"[ \t]*#[ \t]*dg:[ \t]*ignore\[(?P<codes>[^\]]*)\].*$")
_CODE: Final = re.compile(r"there is no (DG[0-9]+) ")
_MOST_TOLD: Final = 3


@dataclass(frozen=True, slots=True)
class Combined:
    """The combined spec as text, what was decided in sentences, and how many warnings 'heronry check' has."""

    text: str
    told: tuple[str, ...]
    warnings: int


def combine(first: tuple[bytes, str], second: tuple[bytes, str], choices: Choices, file: str) -> Combined:
    """Make one spec of two, each given as its bytes and the name of its file.

    file: stands for the combined spec's file in findings. Raises SpecError if one of both specs cannot be loaded, and
    CombineError if they cannot become one, or if the combined spec has errors.
    """
    text, sentences = joined(first, second, choices)
    assessed = _assessed(text, file)
    text = _without_idle_comments(text, assessed)
    findings = [finding for finding in assessed.findings if finding.code != UNUSED_IGNORE.code]
    errors = [finding for finding in findings if finding.severity is Severity.ERROR]
    if errors:
        said = "; ".join(f"{one.code} {one.sentence}" for one in errors[:_MOST_TOLD])
        more = f"; and {len(errors) - _MOST_TOLD} more" if len(errors) > _MOST_TOLD else ""
        raise CombineError(
            f"{first[1]} and {second[1]} become a spec that 'heronry check' refuses: {said}{more}; "
            "correct this in the two specs"
        )
    return Combined(text, sentences, len(findings))


def joined(first: tuple[bytes, str], second: tuple[bytes, str], choices: Choices) -> tuple[str, tuple[str, ...]]:
    """Make one spec of two, as `combine` does, but unchecked: its text, and what was decided in sentences."""
    ours, theirs = (Half(load_bytes(*one), Document(one[0].decode("utf-8-sig"))) for one in (first, second))
    joint = join(ours.spec, theirs.spec, choices, both_name_a_bus=_names_a_bus(ours) and _names_a_bus(theirs))
    return combined_text(ours, theirs, joint), tuple(told(ours.spec, theirs.spec, joint))


def _assessed(text: str, file: str) -> Assessed:
    return assess(text.encode(), file, checks_of(fast=False), RULES)


def _names_a_bus(half: Half) -> bool:
    sections = half.document.sections()
    return "manager" in sections and "bus" in fields(sections["manager"][1])


def _without_idle_comments(text: str, assessed: Assessed) -> str:
    """Return the text without the instructions to ignore findings that it does not have."""
    idle: dict[int, set[str]] = {}
    for finding in assessed.findings:
        said = _CODE.match(finding.sentence)
        if finding.code == UNUSED_IGNORE.code and said is not None:
            idle.setdefault(finding.place.line, set()).add(said[1])
    lines = []
    for number, line in enumerate(text.split("\n"), 1):
        kept = _without(line, idle[number]) if number in idle else line
        if kept or not line:
            lines.append(kept)
    return "\n".join(lines)


def _without(line: str, codes: set[str]) -> str:
    said = _IGNORE.search(line)
    if said is None:
        return line
    left = [code for code in (one.strip() for one in said["codes"].split(",")) if code not in codes]
    if not left:
        return line[: said.start()]
    return line[: said.start("codes")] + ", ".join(left) + line[said.end("codes") :]
