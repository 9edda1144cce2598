"""Instructions to `heronry check` in the comments of a spec: ignore a finding on a line, or make a warning an error.

There are three forms:

`altitude: {type: FLOAT}  # dg: ignore[DG240] read by the ground station` DG240 is ignored on this line; the text after
    the bracket is the reason `# dg: ignore[DG240, DG241] read by the ground station`, on a line of its own both codes
    are ignored on the next line that is neither empty nor a comment `# dg: error[DG401]`, on a line of its own, above
    the first line of the spec the warning DG401 counts as an error in the whole spec

An instruction begins at the first `# dg:` of a line, even inside a quoted text. Two kinds of findings cannot be
ignored: those that stop a spec from being loaded, and those about the instructions themselves.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from heronry_dg.findings import Finding, Findings, Place, shown
from heronry_dg.rules import file as rules
from heronry_dg.rules.rule import Rule, Severity
from heronry_dg.yaml_syntax import LINE_BREAK

_MAY_HAVE_ONE: Final = re.compile(rb"#[ \t]*dg:")
_COMMENT: Final = re.compile(r"(?:^|(?<=\s))#[ \t]*dg:[ \t]*(?P<said>.*)$")
_SAID: Final = re.compile(r"(?P<verb>ignore|error)\[(?P<codes>[^\]]*)\][ \t]*(?P<reason>.*)")
_HINT: Final = "write # dg: ignore[DG240] reason, or # dg: error[DG240] above the first line of the spec"


@dataclass(frozen=True, slots=True)
class Ignore:
    """A part of a comment in a spec: ignore the findings with the rule code `code` on line `line`."""

    place: Place  # of the comment
    code: str
    line: int


@dataclass(slots=True)
class Instructions:
    """All instructions in the comments of a file: findings to ignore, and codes to report as errors."""

    ignores: list[Ignore] = field(default_factory=list)
    raised: set[str] = field(default_factory=set)

    def ignores_of(self, finding: Finding) -> Iterator[Ignore]:
        """Return the instructions that suppress a finding."""
        return (one for one in self.ignores if one.code == finding.code and one.line == finding.place.line)


def lines_of(data: bytes) -> Iterator[str]:
    """Yield the lines of a file one by one; bytes that are not UTF-8 are replaced."""
    text = data.decode("utf-8-sig", "replace")
    begin = 0
    for line_break in LINE_BREAK.finditer(text):
        yield text[begin : line_break.start()]
        begin = line_break.end()
    yield text[begin:]


def read_instructions(data: bytes, known: Mapping[str, Rule], findings: Findings) -> Instructions:
    """Read the comments of a file that instruct `heronry check`.

    An instruction that cannot be followed gives a finding.
    """
    reader = _Reader(known, findings)
    if _MAY_HAVE_ONE.search(data):
        reader.read(list(lines_of(data)))
    return reader.found


class _Reader:
    def __init__(self, known: Mapping[str, Rule], findings: Findings) -> None:
        self._known = known
        self._findings = findings
        self.found = Instructions()

    def read(self, lines: list[str]) -> None:
        """Read the lines from the last to the first, because a comment on a line of its own is about a line below."""
        content = [number for number, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
        first = following = content[0] if content else len(lines) + 1
        for number in range(len(lines), 0, -1):
            line = lines[number - 1]
            while content and content[-1] > number:
                following = content.pop()
            match = _COMMENT.search(line)
            if match is not None:
                alone = not line[: match.start()].strip()
                place = Place(number, match.start() + 1)
                self._one(place, match["said"], following if alone else number, in_head=alone and number < first)

    def _one(self, place: Place, text: str, line: int, *, in_head: bool) -> None:
        said = _SAID.match(text)
        if said is None:
            self._findings.add(rules.BAD_COMMENT, place, f"{shown(text)} is not an instruction to heronry check", _HINT)
        elif said["verb"] == "error":
            self._raise(place, said["codes"], in_head=in_head)
        else:
            self._ignore(place, said["codes"], said["reason"].strip(), line)

    def _raise(self, place: Place, codes: str, *, in_head: bool) -> None:
        if not in_head:
            sentence = "a warning can be raised to an error only for a whole spec, not for a line"
            hint = f"move # dg: error[{codes}] above the first line of the spec"
            self._findings.add(rules.BAD_COMMENT, place, sentence, hint)
            return
        for rule in self._rules(place, codes):
            if rule.severity is Severity.ERROR:
                sentence = f"findings of {rule.code} are always errors, so error[{rule.code}] changes nothing"
                self._findings.add(rules.UNKNOWN_CODE, place, sentence, f"remove {rule.code} from the comment")
            self.found.raised.add(rule.code)

    def _ignore(self, place: Place, codes: str, reason: str, line: int) -> None:
        if not reason:
            sentence = "a finding is ignored without a reason"
            self._findings.add(rules.NO_REASON, place, sentence, f"write the reason after # dg: ignore[{codes}]")
        for rule in self._rules(place, codes):
            if rule.stops or rule.code in _ABOUT_COMMENTS:
                sentence = f"{rule.code} cannot be ignored"
                hint = f"correct the mistake that {rule.code} reports, and remove the code from the comment"
                self._findings.add(rules.UNKNOWN_CODE, place, sentence, hint)
            else:
                self.found.ignores.append(Ignore(place, rule.code, line))

    def _rules(self, place: Place, codes: str) -> Iterator[Rule]:
        for code in dict.fromkeys(code.strip() for code in codes.split(",")):
            if code in self._known:
                yield self._known[code]
            else:
                hint = self._findings.suggestion(code, self._known.keys()) or "'heronry rules' lists all codes"
                self._findings.add(rules.UNKNOWN_CODE, place, f"no rule has the code {shown(code)}", hint)


_ABOUT_COMMENTS: Final = frozenset(
    rule.code for rule in (rules.BAD_COMMENT, rules.NO_REASON, rules.UNUSED_IGNORE, rules.UNKNOWN_CODE)
)
