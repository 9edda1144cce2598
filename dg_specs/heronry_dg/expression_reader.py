"""Reads gate expressions: from the tree of the file to `gates.Expression`, with all named gates expanded.

To expand a named gate is to replace its name by its expression. A `Reading` is an expression with facts that the gates
around it need:

- the place of each leaf in the file; for a leaf of a named gate, this is where the gate is named;
- whether the expression holds with nothing wired;
- its DEMUXes and its depth.

*Order.* Each named gate is read before the gates that name it. If no such order exists, the gates name one another in a
cycle, which is reported. Each named gate is read twice, for use below an OR or a XOR and for use elsewhere, since the
default worth of its leaves depends on this. All expressions that name the gate share the two readings. A DEMUX is a
named gate, too: the gate in front of it. Its name is replaced by the expression of this gate, whose leaves all name
the DEMUX. It is read once, since a DEMUX may not stand below an OR or a XOR.

*Limits.* An expression with too many inputs is refused. The inputs are counted before named gates are expanded, so that
a small file cannot take much memory.

*Mistakes.* If a part of an expression has a mistake, its reading is None. The parts around it are still read, to find
their mistakes, too.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, TypeGuard

from heronry_dg import cycles, yaml_source
from heronry_dg.draft import Draft
from heronry_dg.field_types import MOST_POINTS
from heronry_dg.findings import Findings, Place, listed, shown, shown_cycle
from heronry_dg.gates import And, Expression, Leaf, Or, Xor, with_leaves
from heronry_dg.rules import graph as rules
from heronry_dg.yaml_source import Node

MOST_LEAVES: Final = 1_000  # of one mode, with named gates expanded
MOST_LEAVES_OF_ALL: Final = 100_000
DEEPEST: Final = 64

_REFERENCE: Final = re.compile(r"(?P<name>[^@\s]+)(?:@(?P<sign><=)?(?P<version>[0-9]{1,3}))?")
_INPUT_FIELDS: Final = ("var", "worth", "only_in")
_OPERATORS: Final = ("and", "or", "xor")


@dataclass(frozen=True, slots=True)
class Reading:
    """An expression without mistakes, with facts about it that are used when the gates around it are read.

    The facts are: places and DEMUXes of its leaves, whether it holds with nothing wired, and its depth.
    """

    expression: Expression
    places: tuple[Place, ...]  # of the leaves, in the order of `gates.leaves`
    demuxes: tuple[str, ...]  # names of the DEMUXes in the expression, each as often as the expression names it
    holds_unwired: bool  # whether it holds with nothing wired below it
    depth: int


class ExpressionReader:
    """Reads the gate expressions of one draft: the named gates immediately, the `needs` of a mode on request."""

    def __init__(self, draft: Draft, findings: Findings) -> None:
        self._draft = draft
        self._findings = findings
        self._gates: dict[tuple[str, bool], Reading | None] = {}  # by name, and whether below an OR or a XOR
        self._leaves_left = MOST_LEAVES_OF_ALL
        self._names = dict.fromkeys((*draft.variables, *draft.demuxes, *draft.shorthands))
        self._read_named_gates()

    def shorthands(self) -> dict[str, Expression]:
        """Return the expression of every named gate that is no DEMUX and has no mistake, in the order of the file."""
        return self._expressions_of(self._draft.shorthands)

    def demuxes(self) -> dict[str, Expression]:
        """Return the expression in front of every DEMUX without mistake, in the order of the file."""
        return self._expressions_of(self._draft.demuxes)

    def _expressions_of(self, names: Iterable[str]) -> dict[str, Expression]:
        readings = ((name, self._gates[name, False]) for name in names)
        return {name: reading.expression for name, reading in readings if reading is not None}

    def read(self, node: Node) -> Reading | None:
        """Read the `needs` of a mode; gives None where `needs` has a mistake, about which findings are added.

        Gives None, too, once all modes read so far together have more than MOST_LEAVES_OF_ALL inputs; the mode that
        first exceeds this number gets a finding.
        """
        reading = self._expression(node, below_choice=False)
        if reading is None:
            return None
        within_limit = self._leaves_left >= 0
        self._leaves_left -= len(reading.places)
        if within_limit and self._leaves_left < 0:
            sentence = f"all modes together have more than {MOST_LEAVES_OF_ALL} inputs"
            hint = "a named gate counts with all its inputs in each module that names it"
            self._findings.add(rules.GATE_TOO_LARGE, node.place, sentence, hint)
        return reading if self._leaves_left >= 0 else None

    def _read_named_gates(self) -> None:
        nodes = {name: entry.node for name, entry in self._draft.shorthands.items()}
        nodes |= {name: yaml_source.follow(one.node, ("demux",))[0] for name, one in self._draft.demuxes.items()}
        graph = {name: [n for n in _names_in(node) if n in nodes] for name, node in nodes.items()}
        for component in cycles.components(graph):
            cycle = cycles.shortest_cycle(graph, component)
            if cycle:
                self._refuse_cycle(cycle)
            for name in component:
                if name in self._draft.demuxes:
                    self._gates[name, False] = None if cycle else self._demux(name, nodes[name])
                    continue
                for below_choice in (False, True):
                    self._gates[name, below_choice] = None if cycle else self._expression(nodes[name], below_choice)

    def _refuse_cycle(self, cycle: list[str]) -> None:
        name = cycle[0]
        place = (self._draft.demuxes[name] if name in self._draft.demuxes else self._draft.shorthands[name]).place
        sentence = f"gate '{cycle[0]}' contains itself: {shown_cycle(cycle)}"
        hint = f"write variables instead of a gate in '{cycle[0]}', or in another gate of the cycle"
        self._findings.add(rules.GATE_IN_ITSELF, place, sentence, hint)

    def _expression(self, node: Node, below_choice: bool) -> Reading | None:
        match node:
            case yaml_source.Scalar(value=str() as text):
                return self._reference(node.place, text, below_choice)
            case yaml_source.Mapping(entries=entries) if "var" in entries:
                return self._input(entries, below_choice)
            case yaml_source.Mapping(entries=entries) if len(entries) == 1:
                operator, entry = next(iter(entries.items()))
                return self._gate(operator, entry, below_choice)
        hint = "write a variable, a named gate, {and: [...]}, {or: {k: 1, of: [...]}} or {xor: [...]}"
        self._findings.add(rules.BAD_EXPRESSION, node.place, "a gate expression is expected here", hint)
        return None

    # Leaves and named gates

    def _reference(self, place: Place, text: str, below_choice: bool) -> Reading | None:
        """Read a name in an expression: a variable, with versions or without, or a gate.

        below_choice: whether an OR or a XOR is above the name.
        """
        match = self._matched(place, text)
        if match is None:
            return None
        name = match["name"]
        if name in self._draft.variables:
            return self._leaf(place, match, None, below_choice)
        if name not in self._names:
            self._findings.unknown(rules.UNKNOWN_NAME, place, "variable or gate", name, self._names)
            return None
        if match["version"]:
            sentence = f"'{name}' is a gate and has no versions"
            self._findings.add(rules.GATE_VERSION, place, sentence, f"write {name} alone")
            return None
        return self._named_gate(place, name, below_choice and name not in self._draft.demuxes)

    def _matched(self, place: Place, text: str) -> re.Match[str] | None:
        match = _REFERENCE.fullmatch(text)
        if match is None:
            hint = "write NAME, NAME@2 or NAME@<=2, without spaces"
            self._findings.add(rules.BAD_EXPRESSION, place, f"{shown(text)} is neither a variable nor a gate", hint)
        return match

    def _input(self, fields: Mapping[str, yaml_source.Entry], below_choice: bool) -> Reading | None:
        """Read an input in the form `{var: NAME, worth: [...], only_in: [...]}`; None where the input has a mistake.

        below_choice: whether an OR or a XOR is above the input.
        """
        for key in fields.keys() - set(_INPUT_FIELDS):
            hint = self._findings.suggestion(key, _INPUT_FIELDS) or "write {var: NAME, worth: [...], only_in: [...]}"
            self._findings.add(rules.UNKNOWN_GATE, fields[key].place, f"an input has no field {shown(key)}", hint)
        var, worth = fields["var"].node, fields["worth"].node if "worth" in fields else None
        if not (isinstance(var, yaml_source.Scalar) and isinstance(var.value, str)):
            hint = "write {var: NAME, worth: [...]}"
            self._findings.add(rules.BAD_EXPRESSION, var.place, "'var' must be the name of a variable", hint)
            return None
        match = self._matched(var.place, var.value)
        if match is None:
            return None
        if match["name"] not in self._draft.variables:
            self._findings.unknown(
                rules.UNKNOWN_NAME, var.place, "variable", match["name"], self._draft.variables.keys()
            )
            return None
        reading = self._leaf(var.place, match, worth, below_choice)
        if "only_in" not in fields or yaml_source.is_nothing(fields["only_in"].node):
            return reading
        phases = self._phases(fields["only_in"].node)
        if reading is None or phases is None or not isinstance(reading.expression, Leaf):
            return None
        return replace(reading, expression=replace(reading.expression, only_in=phases))

    def _phases(self, node: Node) -> frozenset[str] | None:
        """Read the phases of `only_in`; gives None, and adds findings, where there is a mistake."""
        if yaml_source.has_refused(node):
            return None
        items = node.items if isinstance(node, yaml_source.Sequence) else []
        names = [item.value for item in items if isinstance(item, yaml_source.Scalar) and isinstance(item.value, str)]
        if not items or len(names) < len(items) or len(set(names)) < len(names):
            sentence = "'only_in' must be a list of one or more different phases"
            self._findings.add(rules.BAD_EXPRESSION, node.place, sentence, "write only_in: [PHASE]")
            return None
        known = self._draft.phases.keys()
        for item, name in zip(items, names, strict=True):
            if name not in known:
                self._findings.unknown(rules.UNKNOWN_NAME, item.place, "phase", name, known)
        return frozenset(names) if known >= set(names) else None

    def _leaf(self, place: Place, match: re.Match[str], worth: Node | None, below_choice: bool) -> Reading | None:
        variable = self._draft.variables[match["name"]].form
        if variable is None:
            return None
        best, worst = _accepted(match, variable.versions)
        if not 1 <= best <= worst <= variable.versions:
            there = "version 1 alone" if variable.versions == 1 else f"versions 1 to {variable.versions}"
            sentence, hint = f"{shown(match[0])} is out of range", f"'{match['name']}' has {there}"
            self._findings.add(rules.VERSION_OUT_OF_RANGE, place, sentence, hint)
            return None
        if worth is None or yaml_source.is_nothing(worth):
            points = _default_worth(best, worst, variable.versions, below_choice)
            return _reading_of(Leaf(match["name"], best, worst, points), place)
        given = self._worth(worth, best, worst, variable.versions)
        return _reading_of(Leaf(match["name"], best, worst, given), place) if given is not None else None

    def _worth(self, node: Node, best: int, worst: int, versions: int) -> tuple[int, ...] | None:
        """Read `worth`: the points for each accepted version, best first.

        The list in the file has one number per accepted version, or one per version of the variable.
        """
        if yaml_source.has_refused(node):
            return None
        items = node.items if isinstance(node, yaml_source.Sequence) else []
        points = tuple(item.value for item in items if isinstance(item, yaml_source.Scalar) and _is_points(item.value))
        accepted = worst - best + 1
        if len(points) != len(items) or len(points) not in {accepted, versions}:
            lengths = listed(dict.fromkeys((str(accepted), str(versions))), last="or")
            numbers = "whole number" if lengths == "1" else "whole numbers"
            sentence = f"'worth' must be a list of {lengths} {numbers} from 0 to {MOST_POINTS}"
            self._findings.add(
                rules.BAD_WORTH, node.place, sentence, "write points for each accepted version, best version first"
            )
            return None
        return points if len(points) == accepted else points[best - 1 : worst]

    def _demux(self, name: str, node: Node) -> Reading | None:
        """Read the expression in front of a DEMUX; all its leaves name the DEMUX.

        node: the expression. None: the DEMUX has a mistake.
        """
        reading = self._expression(node, below_choice=False) if self._draft.demuxes[name].form is not None else None
        if reading is None:
            return None
        if reading.demuxes:
            sentence = f"DEMUX '{reading.demuxes[0]}' is named in front of DEMUX '{name}'"
            hint = "write one DEMUX, with a branch for each of the last modules"
            self._findings.add(rules.DEMUX_MISPLACED, node.place, sentence, hint)
            return None
        if reading.holds_unwired:
            sentence = f"the expression in front of DEMUX '{name}' holds with nothing wired below it"
            hint = "let it need an input: give the OR a 'k' of 1 or more"
            self._findings.add(rules.DEMUX_UNWIRED, node.place, sentence, hint)
            return None
        expression = with_leaves(reading.expression, lambda leaf: replace(leaf, demux=name))
        return replace(reading, expression=expression, demuxes=(name,))

    def _named_gate(self, place: Place, name: str, below_choice: bool) -> Reading | None:
        reading = self._gates[name, below_choice]
        return replace(reading, places=(place,) * len(reading.places)) if reading is not None else None

    # Gates

    def _gate(self, operator: str, entry: yaml_source.Entry, below_choice: bool) -> Reading | None:
        match operator:
            case "and":
                return self._and(entry, below_choice)
            case "or":
                return self._or(entry)
            case "xor":
                return self._xor(entry)
            case "demux":
                hint = "declare the DEMUX under gates:, and write its name here"
                self._findings.add(rules.DEMUX_MISPLACED, entry.place, "a DEMUX must have a name", hint)
            case _:
                hint = self._findings.suggestion(operator, _OPERATORS) or f"the kinds are {listed(_OPERATORS)}"
                self._findings.add(rules.UNKNOWN_GATE, entry.place, f"{shown(operator)} is no kind of gate", hint)
        return None

    def _and(self, entry: yaml_source.Entry, below_choice: bool) -> Reading | None:
        inputs = self._inputs(entry.place, "an AND", entry.node, 1, below_choice)
        if inputs is None:
            return None
        return _joined(And(_expressions(inputs)), inputs, all(i.holds_unwired for i in inputs))

    def _or(self, entry: yaml_source.Entry) -> Reading | None:
        fields = entry.node.entries if isinstance(entry.node, yaml_source.Mapping) else {}
        if not {"k", "of"} <= fields.keys():
            hint = "write {or: {k: 1, of: [a, b]}}"
            self._findings.add(rules.BAD_EXPRESSION, entry.node.place, "an OR needs 'k' and 'of'", hint)
        for key in fields.keys() - {"k", "of"}:
            hint = "write {or: {k: 1, of: [a, b]}}"
            self._findings.add(rules.UNKNOWN_GATE, fields[key].place, f"an OR has no field {shown(key)}", hint)
        if "of" not in fields:
            return None
        inputs = self._inputs(entry.place, "an OR", fields["of"].node, 1, below_choice=True)
        k = self._k(fields["k"].node, inputs) if "k" in fields else None
        if inputs is None or k is None:
            return None
        return _joined(Or(k, _expressions(inputs)), inputs, sum(i.holds_unwired for i in inputs) >= k)

    def _k(self, node: Node, inputs: list[Reading] | None) -> int | None:
        k = node.value if isinstance(node, yaml_source.Scalar) else None
        fits = isinstance(k, int) and not isinstance(k, bool) and k >= 0 and (inputs is None or k <= len(inputs))
        if not fits:
            fit = f"from 0 to {len(inputs)}" if inputs is not None else "of 0 or more"
            hint = "at least k of the inputs hold; with 0 all are optional"
            self._findings.add(rules.BAD_K, node.place, f"'k' must be a whole number {fit}", hint)
        return k if fits and isinstance(k, int) else None

    def _xor(self, entry: yaml_source.Entry) -> Reading | None:
        inputs = self._inputs(entry.place, "a XOR", entry.node, 2, below_choice=True)
        if inputs is None or not isinstance(entry.node, yaml_source.Sequence):
            return None
        idle = [item for reading, item in zip(inputs, entry.node.items, strict=True) if reading.holds_unwired]
        for item in idle:
            sentence = "this input of a XOR holds with nothing wired below it"
            self._findings.add(rules.XOR_UNWIRED, item.place, sentence, "give the OR in this input a 'k' of 1 or more")
        return None if idle else _joined(Xor(_expressions(inputs)), inputs, holds_unwired=False)

    def _inputs(self, place: Place, gate: str, node: Node, least: int, below_choice: bool) -> list[Reading] | None:
        """Read all inputs of a gate; gives None if an input, or the combination of inputs, has a mistake.

        gate: the kind of the gate, such as `an OR`, for findings.
        least: the smallest allowed number of inputs.
        below_choice: whether the inputs are below an OR or a XOR.
        """
        items = node.items if isinstance(node, yaml_source.Sequence) else []
        if len(items) < least:
            sentence = f"{gate} takes a list of {least} or more inputs"
            self._findings.add(rules.ARITY, node.place, sentence, "write [a, b]")
            return None
        readings = [self._expression(item, below_choice) for item in items]
        whole = [reading for reading in readings if reading is not None]
        if len(whole) < len(readings) or (gate != "an AND" and self._has_demux(whole, items)):
            return None
        return whole if self._is_small(place, whole) else None

    def _has_demux(self, readings: list[Reading], items: list[Node]) -> bool:
        for reading, item in zip(readings, items, strict=True):
            if reading.demuxes:
                sentence = f"DEMUX '{reading.demuxes[0]}' is named below an OR or a XOR"
                hint = "name it at the root of `needs`, or below ANDs only"
                self._findings.add(rules.DEMUX_MISPLACED, item.place, sentence, hint)
        return any(reading.demuxes for reading in readings)

    def _is_small(self, place: Place, inputs: list[Reading]) -> bool:
        if sum(len(reading.places) for reading in inputs) > MOST_LEAVES:
            sentence = f"this gate has more than {MOST_LEAVES} inputs when named gates are expanded"
            hint = "let a module in between read some of the inputs, and give one variable for them"
            self._findings.add(rules.GATE_TOO_LARGE, place, sentence, hint)
            return False
        if max(reading.depth for reading in inputs) >= DEEPEST:
            sentence = f"this gate has more than {DEEPEST} levels when named gates are expanded"
            self._findings.add(rules.GATE_TOO_LARGE, place, sentence, "replace each gate of one input by that input")
            return False
        return True


def _reading_of(leaf: Leaf, place: Place) -> Reading:
    return Reading(leaf, (place,), (), holds_unwired=False, depth=1)


def _joined(gate: Expression, inputs: list[Reading], holds_unwired: bool) -> Reading:
    return Reading(
        gate,
        tuple(place for reading in inputs for place in reading.places),
        tuple(demux for reading in inputs for demux in reading.demuxes),
        holds_unwired,
        1 + max(reading.depth for reading in inputs),
    )


def _expressions(inputs: list[Reading]) -> tuple[Expression, ...]:
    return tuple(reading.expression for reading in inputs)


def _accepted(match: re.Match[str], versions: int) -> tuple[int, int]:
    """Return the best and the worst of a variable's `versions` that a reference accepts; all, if it names none."""
    if match["version"] is None:
        return 1, versions
    version = int(match["version"])
    return (1 if match["sign"] else version), version


def _default_worth(best: int, worst: int, versions: int, below_choice: bool) -> tuple[int, ...]:
    """Return the points of an input without `worth`, one number per accepted version, best version first.

    versions: how many versions the variable has. below_choice: whether the input is below an OR or a XOR.
    """
    if not below_choice and best == worst:
        # there is nothing to choose between
        return (0,)
    return tuple(versions - version + 1 for version in range(best, worst + 1))


def _is_points(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MOST_POINTS


def _names_in(node: Node) -> Iterator[str]:
    """Return every name in an expression, without versions."""
    return (text.partition("@")[0] for text in yaml_source.texts(node))
