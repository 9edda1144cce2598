"""Reports text that is not YAML at the place where it should be fixed.

The parser often stops a line or more below the mistake. For example, it reads on after a bracket that is not closed.
If the parser's error, or the lines around it, show where the mistake begins, the report names that place. Its sentence
then also says where the parser stopped.
"""

import re
from dataclasses import dataclass
from typing import Final

import yaml

from heronry_dg.findings import Place

LINE_BREAK: Final = re.compile("\r\n|[\r\n\x85\u2028\u2029]")  # YAML 1.1, section 4.1.4

_CLOSING: Final = {"{": "}", "[": "]", '"': '"', "'": "'"}
_KEY: Final = re.compile(r":(?:\s|$)")
_LOOK: Final = "look for a missing quote, comma, colon or bracket"


@dataclass(frozen=True, slots=True)
class Mistake:
    """The place where a text is not YAML, a sentence, and a hint."""

    place: Place
    sentence: str
    hint: str


def split_lines(text: str) -> list[str]:
    """Split a text into lines, as YAML counts them."""
    return LINE_BREAK.split(text)


def mistake_of(error: yaml.MarkedYAMLError, text: str) -> Mistake:
    """Convert an error of the parser to a mistake."""
    lines = split_lines(text)
    stopped = _place(error.problem_mark or error.context_mark)
    begun = _place(error.context_mark) if error.context_mark is not None else stopped
    if "tab character" in str(error.problem) or "\\t" in str(error.problem):  # the messages of libyaml, and of PyYAML
        return Mistake(stopped, f"this is not YAML: {error.problem}", "indent with spaces")
    if "cannot start any token" in str(error.problem):
        return _unfit(stopped, lines)
    match error.context:
        case "while parsing a flow mapping" | "while parsing a flow sequence" | "while scanning a quoted scalar":
            if begun.line < stopped.line:
                return _not_closed(begun, stopped, lines)
        case "while scanning a simple key":
            where = f"{stopped.line}:{stopped.column}"
            return Mistake(begun, f"this is not YAML: ':' is missing between here and {where}", _LOOK)
        case None | "while parsing a block mapping":
            odd = _odd_line(error, stopped, lines)
            if odd is not None:
                return odd
    sentence = f"this is not YAML: {error.problem}"
    if error.context_mark is not None:
        sentence += f", {error.context} that begins at {begun.line}:{begun.column}"
    return Mistake(stopped, sentence, _LOOK)


def _unfit(place: Place, lines: list[str]) -> Mistake:
    character = lines[place.line - 1][place.column - 1 : place.column]
    if character == "\t":
        return Mistake(place, "this is not YAML: found a tab character", "indent with spaces")
    return Mistake(place, f"this is not YAML: no value begins with {character}", "remove it, or put the text in quotes")


def _not_closed(begun: Place, stopped: Place, lines: list[str]) -> Mistake:
    mark = lines[begun.line - 1][begun.column - 1 : begun.column]
    closing = _CLOSING.get(mark, "its end")
    sentence = f"this is not YAML: the {mark} here is not closed before {stopped.line}:{stopped.column}"
    return Mistake(begun, sentence, f"write {closing} where it ends")


def _odd_line(error: yaml.MarkedYAMLError, stopped: Place, lines: list[str]) -> Mistake | None:
    """Return the mistake on the line above the line at which the parser stopped; None if the line above has none."""
    above = _line_above(stopped.line, lines)
    if above is None:
        return None
    line, here = lines[above - 1], lines[stopped.line - 1]
    if _KEY.search(line) is None:
        sentence = "this is not YAML: there is no key on this line"
        return Mistake(_beginning(above, lines), sentence, "write key: value, with a space behind the colon")
    if error.problem == "did not find expected <document start>":
        first = next(number for number, text in enumerate(lines, 1) if _is_content(text))
        return _indented_oddly(first, stopped, lines)
    if error.context is not None and _is_rarer(line, here, lines):
        return _indented_oddly(above, stopped, lines)
    return None


def _indented_oddly(number: int, stopped: Place, lines: list[str]) -> Mistake | None:
    if _indentation(lines[number - 1]) == 0:
        return None
    sentence = f"this is not YAML: the line is indented unlike line {stopped.line}"
    return Mistake(_beginning(number, lines), sentence, "indent the keys of one map alike")


def _line_above(number: int, lines: list[str]) -> int | None:
    """Number of the last line above line `number` that is neither empty nor a comment; None if there is none."""
    for above in range(number - 1, 0, -1):
        if _is_content(lines[above - 1]):
            return above
    return None


def _is_content(line: str) -> bool:
    text = line.strip()
    return bool(text) and not text.startswith("#")


def _is_rarer(line: str, other: str, lines: list[str]) -> bool:
    """Tell whether fewer lines of the file are indented like `line` than like `other`."""
    found = [_indentation(text) for text in lines]
    return found.count(_indentation(line)) < found.count(_indentation(other))


def _beginning(number: int, lines: list[str]) -> Place:
    return Place(number, _indentation(lines[number - 1]) + 1)


def _indentation(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _place(mark: yaml.Mark | None) -> Place:
    return Place(1, 1) if mark is None else Place(mark.line + 1, mark.column + 1)
