"""Findings: the mistakes in a spec, each with its place, and the error that carries all of them.

The code that reads a spec does not stop at the first mistake. It adds a finding and goes on with the parts that it can
still read, so that one run shows every independent mistake. Two conventions avoid follow-up findings:

- If several findings at one place each stop the spec from being loaded, only the first of them is kept.
- When a part has a finding, code that uses this part adds no further finding about it.

The files in rules/ define every kind of mistake, with its code.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from heronry_dg.rules.rule import Rule, Severity
from heronry_wire.errors import HeronryError, on_one_line
from heronry_wire.spelling import close, kind_word

_LONGEST_SHOWN = 60
_LONGEST_CYCLE_SHOWN = 24
_MOST_TOLD = 5  # findings in the text of an error
_MOST_COMPARISONS = 20_000  # names compared for "did you mean", per file: a hostile file must not take minutes


class Place(NamedTuple):
    """A position in a file; lines and columns count from 1."""

    line: int
    column: int


class Use(NamedTuple):
    """A use of an undeclared name: its place, the kind of element expected there, and the most similar known name."""

    place: Place
    kind: str
    closest: str | None


@dataclass(frozen=True, slots=True, order=True)
class Finding:
    """One mistake in a file: its place, its rule, a sentence about it, and often a hint what to write instead."""

    file: str
    place: Place
    code: str
    severity: Severity
    sentence: str
    hint: str = ""

    def __str__(self) -> str:
        hint = f" ({self.hint})" if self.hint else ""
        where = f"{self.file}:{self.place.line}:{self.place.column}"
        return f"{where}: {self.code} {self.severity}: {self.sentence}{hint}"


class SpecError(HeronryError, ValueError):
    """A spec cannot be loaded; `findings` says why, in the order of the file.

    The text of the error has one line for each of the first five findings. If there are more, a last line gives the
    number of the others, since a file that is no spec may have hundreds of findings.
    """

    def __init__(self, findings: Iterable[Finding]) -> None:
        self.findings = tuple(sorted(findings))
        lines = [str(finding) for finding in self.findings[:_MOST_TOLD]]
        more = len(self.findings) - len(lines)
        if more:
            lines.append(f"and {more} more; is this the right file? 'heronry check {self.findings[0].file}' lists all")
        super().__init__("\n".join(lines))


class Findings:
    """Collects the findings of one file while the file is being read."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._found: dict[tuple[Place, str, str], Finding] = {}
        self._comparisons_left = _MOST_COMPARISONS
        self.unknown_names: dict[str, list[Use]] = {}

    def __len__(self) -> int:
        return len(self._found)

    def __iter__(self) -> Iterator[Finding]:
        return iter(sorted(self._found.values()))

    def add(self, rule: Rule, place: Place, sentence: str, hint: str = "") -> None:
        """Add a finding; `hint` tells the author what to write instead.

        Of several findings at one place that stop the spec from being loaded, only the first is kept.
        """
        key = (place, "", "") if rule.stops else (place, rule.code, sentence)
        self._found.setdefault(key, Finding(self._file, place, rule.code, rule.severity, sentence, hint))

    def unknown(self, rule: Rule, place: Place, kind: str, name: str, known: Collection[str]) -> None:
        """Add a finding about an undeclared name, unless its place has a finding that stops the spec from being loaded.

        kind: the kind of element expected there, such as `bus`. known: the names that could have been meant.
        """
        closest, uses = self.closest(name, known), self.unknown_names.setdefault(name, [])
        if not any(one.place == place for one in uses):
            uses.append(Use(place, kind, closest))
        hint = f"did you mean '{closest}'?" if closest is not None else _there_is(known)
        self.add(rule, place, f"no {kind_word(kind)} is named {shown(name)}", hint)

    def suggestion(self, name: str, known: Collection[str]) -> str:
        """Return the hint "did you mean ...?" with the most similar known name; empty where none is similar."""
        closest = self.closest(name, known)
        return f"did you mean '{closest}'?" if closest is not None else ""

    def withdraw(self, place: Place) -> None:
        """Remove the finding at `place` that stops the spec from being loaded, so that a better one can follow."""
        self._found.pop((place, "", ""), None)

    def closest(self, name: str, known: Collection[str]) -> str | None:
        """Return the known name that the author may have meant; upper and lower case count as equal.

        None: no known name is similar, `name` is too long, or there are too many names to compare.
        """
        if len(known) > self._comparisons_left or len(name) > _LONGEST_SHOWN:
            return None
        self._comparisons_left -= len(known)
        spelt = {one.lower(): one for one in known}
        found = close(name.lower(), spelt)
        return None if found is None else spelt[found]

    def error(self) -> SpecError:
        """Return one error that carries all findings."""
        return SpecError(self._found.values())


def shown(value: object) -> str:
    """Return a value of the file as a message shows it: quoted, escaped, and shortened."""
    match value:
        case None:
            return "nothing"
        case bool():
            return "true" if value else "false"
        case dict():
            return "a map"
        case list():
            return "a list"
        case str():
            text = value if len(value) <= _LONGEST_SHOWN else value[: _LONGEST_SHOWN - 3] + "..."
            return f"'{on_one_line(text)}'"
        case _:
            return str(value)


def listed(words: Iterable[str], last: str = "and") -> str:
    """Write words as a list: `a`, `a and b`, `a, b and c`.

    last: the word before the last item, `and` in these examples.
    """
    *most, final = words
    return f"{', '.join(most)} {last} {final}" if most else final


def shown_cycle(names: Sequence[str]) -> str:
    """Write a cycle as `a -> b -> a`; a long one is cut in the middle."""
    whole = [*names, names[0]]
    if len(whole) > _LONGEST_CYCLE_SHOWN:
        half = _LONGEST_CYCLE_SHOWN // 2
        whole = [*whole[:half], f"... ({len(whole) - 2 * half} more)", *whole[-half:]]
    return " -> ".join(whole)


def _there_is(known: Collection[str]) -> str:
    if not known:
        return "there is none"
    if len(known) > 8:
        return "declare it, or use a declared name"
    return f"there is {listed(known)}"
