"""Reads a fault tree in the Open-PSA Model Exchange Format into a formula.

Understood are gates of `and`, `or`, `atleast`, of one input, and constants; house events; basic events with a number,
an exponential law, or none; parameters; common causes by the beta factor. A tree with a negation has no minimal cut
sets, so gates such as `not` and `xor` are refused. Trees may be divided into components; then names must be unique in
the whole model.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from heronry_tools.analysis.reliability.formula import FALSE, TRUE, Formula
from heronry_tools.console.errors import UserError

_NEGATING: Final = ("not", "xor", "nand", "nor", "iff", "imply", "cardinality")
_REFERENCES: Final = ("gate", "basic-event", "house-event", "event")
_ABOUT: Final = ("label", "attributes")


@dataclass(frozen=True, slots=True)
class Tree:
    """A fault tree: its gates as nodes of a formula, and how likely its basic events are.

    tops: the gates that no other gate reads. gates: the node of each gate.
    without: basic events of which the file says how likely they are in a way that is not understood, or not at all.
    common: groups of basic events with their beta.
    """

    formula: Formula
    tops: tuple[str, ...]
    gates: Mapping[str, int]
    rates: Mapping[str, float]
    demands: Mapping[str, float]
    without: tuple[str, ...]
    common: tuple[tuple[tuple[str, ...], float], ...]


def read_tree(file: Path) -> Tree:
    """Read a model; raises UserError with the place and the remedy if the file is no model or is not understood."""
    try:
        text = file.read_bytes()
    except OSError as error:
        raise UserError(f"{file}: {error.strerror}; name an Open-PSA file") from error
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise UserError(f"{file}: a document type is not read; remove the line with <!DOCTYPE")
    try:
        root = ET.fromstring(text)  # noqa: S314 - without a document type no entity can grow
    except ET.ParseError as error:
        raise UserError(f"{file}: this is no XML: {error}; name an Open-PSA file") from error
    if root.tag != "opsa-mef":
        raise UserError(f"{file}: the root is <{root.tag}>; an Open-PSA file begins with <opsa-mef>")
    return _Reader(file, root).tree()


class _Reader:
    def __init__(self, file: Path, root: ET.Element) -> None:
        self._file, self._root = file, root
        self._formula = Formula()
        self._definitions = dict(self._defined("define-gate"))
        self._houses = {
            name: (one.find("constant") is not None and one.find("constant").get("value") == "true")  # type: ignore[union-attr]
            for name, one in self._defined("define-house-event")
        }
        self._parameters = dict(self._defined("define-parameter"))
        self._events = dict(self._defined("define-basic-event"))
        if not self._definitions:
            raise self._wrong("it defines no gate", "name a file with <define-gate>")

    def _wrong(self, sentence: str, remedy: str) -> UserError:
        return UserError(f"{self._file}: {sentence}; {remedy}")

    def _defined(self, tag: str) -> Iterator[tuple[str, ET.Element]]:
        seen: set[str] = set()
        for one in self._root.iter(tag):
            name = one.get("name")
            if not name:
                raise self._wrong(f"a <{tag}> has no name", "give it one")
            if name.lower() in seen:
                raise self._wrong(f"<{tag}> {name} is defined twice", "rename one of them")
            seen.add(name.lower())
            yield name, one

    def tree(self) -> Tree:
        read = {name: set(self._reads(one)) for name, one in self._definitions.items()}
        gates = self._gates(read)
        below = {gate for gates_read in read.values() for gate in gates_read}
        tops = tuple(name for name in self._definitions if name not in below)
        rates, demands, without = dict[str, float](), dict[str, float](), list[str]()
        for name in self._formula.events:
            kind, value = self._chance(name)
            if kind == "rate":
                rates[name] = value
            elif kind == "demand":
                demands[name] = value
            else:
                without.append(name)
        return Tree(self._formula, tops, gates, rates, demands, tuple(without), tuple(self._common()))

    def _reads(self, one: ET.Element) -> Iterator[str]:
        for reference in one.iter():
            name = self._name(reference)
            if reference.tag in ("gate", "event") and name in self._definitions:
                yield name

    def _name(self, one: ET.Element) -> str:
        return (one.get("name") or "").rpartition(".")[2]

    def _gates(self, read: Mapping[str, set[str]]) -> dict[str, int]:
        """Build the gates, each after those that it reads."""
        values: dict[str, int] = {}
        for start in self._definitions:
            path = [start]
            while path:
                name = path[-1]
                if name in values:
                    path.pop()
                    continue
                unknown = [one for one in sorted(read[name]) if one not in values]
                if unknown:
                    if unknown[0] in path:
                        raise self._wrong(f"gate {unknown[0]} depends on itself", "break the circle")
                    path.append(unknown[0])
                    continue
                values[name] = self._formula_of(name, self._definitions[name], values)
        return values

    def _formula_of(self, gate: str, one: ET.Element, values: Mapping[str, int]) -> int:
        inside = [child for child in one if child.tag not in _ABOUT]
        if len(inside) != 1:
            raise self._wrong(f"gate {gate} has {len(inside)} formulas", "give it one")
        return self._value(gate, inside[0], values)

    def _value(self, gate: str, one: ET.Element, values: Mapping[str, int]) -> int:
        if one.tag == "constant":
            return TRUE if one.get("value") == "true" else FALSE
        if one.tag in _REFERENCES:
            return self._reference(gate, one, values)
        inputs = [self._value(gate, child, values) for child in one]
        match one.tag:
            case "or":
                return self._formula.any_of(inputs)
            case "and":
                return self._formula.all_of(inputs)
            case "atleast":
                return self._formula.at_least(self._least(gate, one, len(inputs)), inputs)
            case _:
                if one.tag in _NEGATING:
                    raise self._wrong(
                        f"gate {gate} has a <{one.tag}>",
                        "only 'or', 'and' and 'atleast' are read: a failure more must never repair the system",
                    )
                raise self._wrong(f"gate {gate} has a <{one.tag}>, which is no formula", "write or, and, or atleast")

    def _least(self, gate: str, one: ET.Element, inputs: int) -> int:
        text = one.get("min") or ""
        if not text.isdecimal() or not 0 <= int(text) <= inputs:
            raise self._wrong(f"gate {gate}: 'min' is {text or 'missing'}", f"write a number from 0 to {inputs}")
        return int(text)

    def _reference(self, gate: str, one: ET.Element, values: Mapping[str, int]) -> int:
        name = self._name(one)
        kind = one.get("type") or one.tag
        if kind in ("gate", "event") and name in values:
            return values[name]
        if kind in ("house-event", "event") and name in self._houses:
            return TRUE if self._houses[name] else FALSE
        if kind in ("basic-event", "event") and name:
            return self._formula.event(name)
        raise self._wrong(f"gate {gate} reads {kind} '{name}', which is not defined", "define it")

    # How likely.

    def _chance(self, name: str) -> tuple[str, float]:
        one = self._events.get(name)
        laws = [child for child in one if child.tag not in _ABOUT] if one is not None else []
        if not laws:
            return "none", 0.0
        if laws[0].tag == "exponential" and len(laws[0]):
            rate = self._number(laws[0][0])
            return ("none", 0.0) if rate is None else ("rate", self._checked(name, rate, None))
        value = self._number(laws[0])
        return ("none", 0.0) if value is None else ("demand", self._checked(name, value, 1.0))

    def _checked(self, name: str, value: float, most: float | None) -> float:
        if not value >= 0.0 or value == float("inf") or (most is not None and value > most):
            what = "a rate is 0 or more" if most is None else "a probability is from 0 to 1"
            raise self._wrong(f"basic event {name} has the value {value:g}", what)
        return value

    def _number(self, one: ET.Element, depth: int = 0) -> float | None:
        """Return a number, directly or by a parameter; None for any other expression."""
        if one.tag in ("float", "int"):
            try:
                return float(one.get("value") or "")
            except ValueError as error:
                raise self._wrong(f"'{one.get('value')}' is no number", "write one") from error
        if one.tag == "parameter" and depth < 100:
            defined = self._parameters.get(self._name(one))
            inside = [child for child in defined if child.tag not in _ABOUT] if defined is not None else []
            return self._number(inside[0], depth + 1) if inside else None
        return None

    def _common(self) -> Iterator[tuple[tuple[str, ...], float]]:
        for name, group in self._defined("define-CCF-group"):
            members = tuple(self._name(one) for one in group.iterfind("members/basic-event"))
            factors = [value for one in group.iter("factor") for child in one if (value := self._number(child))]
            if group.get("model") != "beta-factor" or len(factors) != 1 or not 0.0 < factors[0] <= 1.0:
                raise self._wrong(
                    f"common cause group {name} is no beta factor", 'write model="beta-factor" with one factor'
                )
            yield members, factors[0]
