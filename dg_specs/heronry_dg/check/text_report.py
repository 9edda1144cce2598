"""Reports of findings for people: in full, with the source line and a caret, or in one line each."""

import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from heronry_dg.check.assess import Assessed
from heronry_dg.findings import Finding
from heronry_dg.rules.rule import Rule, Severity

_Paint = Callable[[str, str], str]  # (text, name of its style) -> text with escape codes

MOST_SHOWN: Final = 100  # findings of a file; a file that is no spec may have hundreds of thousands
_FEW: Final = 5  # findings that need no summary before them
_WIDEST_SOURCE: Final = 100  # characters of a source line that are shown
_WORD: Final = re.compile(r'"(?:[^"\\]|\\.)*"|\'(?:[^\']|\'\')*\'|[^\s,\[\]{}:#]+|.')
_STYLES: Final[Mapping[str, str]] = {
    "error": "\x1b[1;31m",
    "warning": "\x1b[1;33m",
    "place": "\x1b[1m",
    "quiet": "\x1b[36m",
}


def span_end(line: str, column: int) -> int:
    """Return the column behind the quoted text, name or mark that begins at `column`; columns count from 1."""
    match = _WORD.match(line, column - 1)
    return match.end() + 1 if match else column


def concise(files: Sequence[Assessed]) -> str:
    """Return one line per finding: `file:line:col: CODE severity: sentence (hint)`."""
    return "".join(f"{finding}\n" for assessed in files for finding in assessed.findings)


def by_code(files: Sequence[Assessed], rules: Mapping[str, Rule], *, colour: bool = False) -> str:
    """Return a list with the number of findings of each code, which is shown above the findings.

    With `_FEW` findings or fewer, the result is an empty text.
    """
    counts = Counter((finding.severity, finding.code) for assessed in files for finding in assessed.findings)
    if counts.total() <= _FEW:
        return ""
    paint = _painted if colour else _plain
    lines = [
        f"{count:4} {paint(f'{code} {severity}', severity)}  {rules[code].what}"
        for (severity, code), count in sorted(counts.items(), key=lambda one: (one[0][0] is not Severity.ERROR, one[0]))
    ]
    return "\n".join([*lines, "'heronry explain CODE' explains one, '--format concise' gives each a line.", "", ""])


def full(files: Sequence[Assessed], *, colour: bool = False) -> str:
    """Write the first MOST_SHOWN findings of each file with source line, caret and hint, and count the others."""
    paint = _painted if colour else _plain
    return "".join(
        "".join(f"{_one(assessed, finding, paint)}\n" for finding in assessed.findings[:MOST_SHOWN]) + _others(assessed)
        for assessed in files
    )


def digests(files: Sequence[Assessed]) -> str:
    """Return a line with the digest of each spec that could be loaded."""
    return "".join(f"{assessed.file}: digest {assessed.digest}\n" for assessed in files if assessed.digest)


def summary(files: Sequence[Assessed]) -> str:
    """Return the last line of a report for people: how many findings there are in how many files."""
    findings = [finding for assessed in files for finding in assessed.findings]
    errors = sum(finding.severity is Severity.ERROR for finding in findings)
    counts = [(errors, "error"), (len(findings) - errors, "warning")]
    said = " and ".join(_counted(count, noun) for count, noun in counts if count) or "nothing wrong"
    return f"{_counted(len(files), 'spec')} checked: {said}"


def _others(assessed: Assessed) -> str:
    others = len(assessed.findings) - MOST_SHOWN
    return f"{assessed.file}: and {others} more; '--format concise' shows all\n\n" if others > 0 else ""


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _plain(text: str, _style: str) -> str:
    return text


def _painted(text: str, style: str) -> str:
    return f"{_STYLES[style]}{text}\x1b[0m"


def _one(assessed: Assessed, finding: Finding, paint: _Paint) -> str:
    place = f"{finding.file}:{finding.place.line}:{finding.place.column}:"
    said = paint(f"{finding.code} {finding.severity}:", finding.severity)
    lines = [f"{paint(place, 'place')} {said} {finding.sentence}"]
    source = assessed.line(finding.place.line)
    if source.strip():
        number = str(finding.place.line)
        margin = " " * len(number)
        shown, mark = _excerpt(source, finding.place.column)
        bar = paint("|", "quiet")
        lines += [f"{paint(number, 'quiet')} {bar} {shown}", f"{margin} {bar} {paint(mark, finding.severity)}"]
    if finding.hint:
        lines.append(f"  {paint('= hint:', 'quiet')} {finding.hint}")
    return "\n".join([*lines, ""])


def _excerpt(line: str, column: int) -> tuple[str, str]:
    """Return a source line, and the line below it that has the caret; a long line is cut around the place."""
    begin = max(0, column - 1 - _WIDEST_SOURCE // 2) if len(line) > _WIDEST_SOURCE else 0
    end = min(len(line), begin + _WIDEST_SOURCE)
    cut = "..." if begin else ""
    last = min(span_end(line, column) - 1, end)
    before = "".join(" " * _cells(character) for character in line[begin : column - 1])
    mark = "^" * max(1, sum(map(_cells, line[column - 1 : last])))
    shown = "".join(map(_visible, line[begin:end]))
    return f"{cut}{shown}{'...' if end < len(line) else ''}", f"{' ' * len(cut)}{before}{mark}"


def _visible(character: str) -> str:
    if character == "\t":
        return " "
    return character if character.isprintable() or unicodedata.combining(character) else "\ufffd"


def _cells(character: str) -> int:
    """Number of columns that a character takes on a terminal."""
    if unicodedata.combining(character):
        return 0
    return 2 if unicodedata.east_asian_width(character) in {"W", "F"} else 1
