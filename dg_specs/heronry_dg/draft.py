"""The draft of a spec, between file and model: each element with its position and, if it has no mistake, its fields.

Elements are read one by one, so that a mistake in one element does not affect the others. An element with a mistake is
called *broken*: it stays in the draft under its name, with `form` None. So a reference to a broken element is not an
unknown name, and code that needs the fields of a broken element skips the element without a finding.

A file with MOST_FINDINGS findings is read no further, and is not readable: what it declares below would look unknown.

This file also translates each error of pydantic into a finding about the field, at the place of its value.
"""

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Generic, TypeVar

from pydantic import ValidationError

from heronry_dg import yaml_source
from heronry_dg.field_types import NAME_PATTERN
from heronry_dg.findings import Findings, Place, listed, shown
from heronry_dg.keys import element_at, key_names
from heronry_dg.model import (
    Bus,
    Contingency,
    Demux,
    Device,
    Function,
    Header,
    Manager,
    Mode,
    Module,
    Pe,
    Phase,
    Plant,
    Spec,
    Variable,
)
from heronry_dg.quantities import UnfitError
from heronry_dg.rules import file as file_rules
from heronry_dg.rules import schema as rules
from heronry_dg.rules.rule import Rule
from heronry_dg.schema import ONLY_MODE, read
from heronry_dg.yaml_source import Node

E_co = TypeVar("E_co", covariant=True)

MOST_FINDINGS: Final = 10_000
"""With so many a file is read no further: only a program writes that many mistakes, and a list of all does not help."""

_NAME: Final = re.compile(NAME_PATTERN)
_SECTIONS: Final = tuple(name for name in key_names(Spec) if name not in key_names(Header))
_MODE_FIELDS: Final = key_names(Mode)

_OTHER_KINDS: Final = (  # kinds of files that are no spec: fields by which one is recognized, a sentence, a hint
    (
        frozenset(("objective", "modules", "functions")),
        "it is a plan, as 'heronry plan --json' writes it",
        "name the *.dg.yaml, or check the plan with: heronry verify SPEC PLAN.json",
    ),
    (frozenset(("spec_digest", "node_id")), "it is the table of a PE", "name the *.dg.yaml from which it was compiled"),
    (
        frozenset(("pcs",)),
        "it is a component graph",
        "the name of such a file ends in .pcs.yaml or .pcs.json; see: heronry pcs --help",
    ),
)

_NAME_HINT: Final = "use a letter, then letters, digits and '_', at most 64 in all"
_PRINTABLE: Final = (
    rules.BAD_TEXT,
    "1 to 64 printable characters without quotes and backslashes",
    "leave out quotes, backslashes and invisible characters",
)
_WANTED: Final = {  # by type of pydantic error: the rule, the value that was expected, and a hint
    "bool_type": (rules.WRONG_TYPE, "true or false", "write true or false, without quotes"),
    "dict_type": (rules.NOT_A_MAP, "a map", "write {{key: value}}"),
    "greater_than": (rules.OUT_OF_RANGE, "more than {gt}", "write a number above {gt}"),
    "greater_than_equal": (rules.OUT_OF_RANGE, "at least {ge}", "write {ge} or more"),
    "int_parsing_size": (rules.OUT_OF_RANGE, "a smaller number", "write 1"),  # of `dg`, beyond 64 bits
    "int_type": (rules.WRONG_TYPE, "a whole number", "write only digits, for example 1"),
    "less_than_equal": (rules.OUT_OF_RANGE, "at most {le}", "write {le} or less"),
    "list_type": (rules.WRONG_TYPE, "a list", "write [a, b]"),
    "literal_error": (rules.NOT_A_CHOICE, "{expected}", "write one of these, as it is spelt here"),
    "model_type": (rules.NOT_A_MAP, "a map", "write {{key: value}}"),
    "string_pattern_mismatch": _PRINTABLE,
    "string_too_long": _PRINTABLE,
    "string_too_short": _PRINTABLE,
    "string_type": (rules.WRONG_TYPE, "text", "put it in quotes if it is meant as text"),
    "too_short": (rules.SHORT_LIST, "a list of {min_length} or more", "add items, or remove the list"),
}


@dataclass(frozen=True, slots=True)
class Element(Generic[E_co]):
    """One named element of the file.

    `form` is the element of the model with the keys that the file gives. It is None where a key has a mistake. What
    other elements decide is still missing in it, as `keys` tells.
    """

    name: str
    place: Place  # of its name
    node: Node
    form: E_co | None


@dataclass(frozen=True, slots=True)
class ModuleElement(Element[Module]):
    """A module with its modes, best first; a mode with a mistake is among them, with `form` None."""

    modes: Mapping[str, Element[Mode]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Draft:
    """Everything that could be read from a file."""

    root: Node
    readable: bool  # no section is unreadable because its name is misspelt or its value is not a map
    header: Header | None
    manager: Element[Manager]
    contingency: Element[Contingency]
    buses: Mapping[str, Element[Bus]]
    pes: Mapping[str, Element[Pe]]
    devices: Mapping[str, Element[Device]]
    variables: Mapping[str, Element[Variable]]
    demuxes: Mapping[str, Element[Demux]]
    shorthands: Mapping[str, yaml_source.Entry]
    modules: Mapping[str, ModuleElement]
    functions: Mapping[str, Element[Function]]
    phases: Mapping[str, Element[Phase]]
    plants: Mapping[str, Element[Plant]]


def read_draft(root: Node, findings: Findings) -> Draft | None:
    """Read all elements of a file; None, with a finding, if the file is not a map, or is a map but no spec."""
    if not isinstance(root, yaml_source.Mapping):
        hint = "begin with dg: 1, then buses:, pes:, modules: ..."
        findings.add(rules.NOT_A_MAP, root.place, "a spec must be a map of sections", hint)
        return None
    other = _other_kind(root.entries)
    if other is not None:
        findings.add(rules.MISSING_FIELD, root.place, f"the file is no spec: {other[0]}", other[1])
        return None
    return _DraftReader(root, findings).read()


def _other_kind(keys: Collection[str]) -> tuple[str, str] | None:
    """Return two sentences about a file that is no spec: what it is, and what to do; None if it may be a spec.

    keys: the keys of the file. If `dg` is one of them, the file may be a spec.

    Without these sentences every field of a file that is no spec would give a finding, and no finding would help.
    """
    if "dg" in keys:
        return None
    for marks, sentence, hint in _OTHER_KINDS:
        if marks <= frozenset(keys):
            return sentence, hint
    if any(key in keys for key in key_names(Spec)):
        return None
    return "no field of the file is a field of a spec", "a spec begins with dg: 1; is this the right file?"


class _DraftReader:
    def __init__(self, root: yaml_source.Mapping, findings: Findings) -> None:
        self._root = root
        self._findings = findings
        self._has_ended = False  # there are too many findings: the rest of the file is not read

    def read(self) -> Draft:
        gates = dict(self._entries("gates"))
        demuxes = {name: entry for name, entry in gates.items() if _is_demux(entry.node)}
        draft = Draft(
            root=self._root,
            readable=all(self._is_readable(section) for section in _SECTIONS) and not self._misspelt_sections(),
            header=self._header(),
            manager=self._single("manager", Manager),
            contingency=self._single("contingency", Contingency),
            buses=self._section("buses", "bus", Bus),
            pes=self._section("pes", "pe", Pe),
            devices=self._section("devices", "device", Device),
            variables=self._section("variables", "variable", Variable),
            demuxes={name: self._element("gate", name, entry, Demux) for name, entry in demuxes.items()},
            shorthands={name: entry for name, entry in gates.items() if name not in demuxes},
            modules={name: self._module(name, entry) for name, entry in self._entries("modules")},
            functions=self._section("functions", "function", Function),
            phases=self._section("phases", "phase", Phase),
            plants=self._section("plants", "plant", Plant),
        )
        return replace(draft, readable=draft.readable and not self._has_ended)

    def _header(self) -> Header | None:
        header = {key: entry for key, entry in self._root.entries.items() if key not in _SECTIONS}
        entry = yaml_source.Entry(self._root.place, yaml_source.Mapping(self._root.place, header))
        return self._form("the spec", entry, Header, {}, key_names(Spec))

    def _single(self, key: str, kind: type[E_co]) -> Element[E_co]:
        """Read an element that a file has at most once; a missing one is read as one without content."""
        entry = self._root.entries.get(key, yaml_source.Entry(self._root.place, _nothing_at(self._root.place)))
        return Element(key, entry.place, entry.node, self._form(key, entry, kind, {}))

    def _is_readable(self, section: str) -> bool:
        entry = self._root.entries.get(section)
        return entry is None or isinstance(entry.node, yaml_source.Mapping) or yaml_source.is_nothing(entry.node)

    def _misspelt_sections(self) -> set[str]:
        known = key_names(Spec)
        meant = _meant(self._findings, self._root.entries.keys() - set(known), known)
        return meant.intersection(_SECTIONS) - self._root.entries.keys()

    def _section(self, section: str, noun: str, kind: type[E_co]) -> dict[str, Element[E_co]]:
        return {name: self._element(noun, name, entry, kind) for name, entry in self._entries(section)}

    def _element(self, noun: str, name: str, entry: yaml_source.Entry, kind: type[E_co]) -> Element[E_co]:
        form = self._form(f"{noun} {shown(name)}", entry, kind, {"name": name})
        return Element(name, entry.place, entry.node, form)

    def _entries(self, section: str) -> Iterator[tuple[str, yaml_source.Entry]]:
        entry = self._root.entries.get(section)
        if entry is not None:
            yield from self._named(entry.node, f"'{section}'")

    def _named(self, node: Node, subject: str) -> Iterator[tuple[str, yaml_source.Entry]]:
        """Yield the entries of a map whose keys are names.

        A node that is not a map gives a finding and no entries. A name that is not valid gives a finding, and its
        entry is given, too.
        """
        if yaml_source.is_nothing(node):
            return
        if not isinstance(node, yaml_source.Mapping):
            sentence = f"{subject} must be a map, not {_kind_of(node)}"
            self._findings.add(rules.NOT_A_MAP, node.place, sentence, "write NAME: {...}")
            return
        for name, entry in node.entries.items():
            if self._ends_at(entry.place):
                return
            if _NAME.fullmatch(name) is None:
                self._findings.add(rules.BAD_NAME, entry.place, f"{shown(name)} cannot be a name", _NAME_HINT)
            yield name, entry

    def _ends_at(self, place: Place) -> bool:
        """Tell whether the file is read no further than this place, because it has too many findings."""
        if len(self._findings) >= MOST_FINDINGS and not self._has_ended:
            self._has_ended = True
            sentence = f"the file has {MOST_FINDINGS} mistakes up to here, and is read no further"
            self._findings.add(file_rules.TOO_LARGE, place, sentence, "check the program that wrote the file")
        return self._has_ended

    def _module(self, name: str, entry: yaml_source.Entry) -> ModuleElement:
        subject = f"module {shown(name)}"
        body = entry.node
        if not isinstance(body, yaml_source.Mapping) and not yaml_source.is_nothing(body):
            sentence = f"{subject} must be a map, not {_kind_of(body)}"
            self._findings.add(rules.NOT_A_MAP, body.place, sentence, "write {device: ..., cpu: ..., ...}")
            return ModuleElement(name, entry.place, body, None)
        fields = body.entries if isinstance(body, yaml_source.Mapping) else {}
        modes = fields["modes"] if "modes" in fields and not yaml_source.is_nothing(fields["modes"].node) else None
        own = {key: value for key, value in fields.items() if key != "modes" and key not in _MODE_FIELDS}
        mode_fields = {key: value for key, value in fields.items() if key in _MODE_FIELDS}
        known = (*key_names(Module), *_MODE_FIELDS, "modes")
        keys = yaml_source.Entry(entry.place, yaml_source.Mapping(body.place, own))
        form = self._form(subject, keys, Module, {"name": name}, known)
        if modes is None:
            only = yaml_source.Entry(entry.place, yaml_source.Mapping(body.place, mode_fields))
            misspelt = _meant(self._findings, own.keys() - set(known), known)
            mode = self._mode(subject, ONLY_MODE, only, misspelt)
            return ModuleElement(name, entry.place, body, form, {mode.name: mode})
        self._refuse_both_ways(subject, mode_fields)
        return ModuleElement(name, entry.place, body, form, self._modes(subject, modes))

    def _refuse_both_ways(self, subject: str, mode_fields: Mapping[str, yaml_source.Entry]) -> None:
        for key, entry in mode_fields.items():
            sentence = f"{subject} has both 'modes' and a '{key}' of its own"
            self._findings.add(rules.MODES_AND_FIELDS, entry.place, sentence, f"move '{key}' into the modes")

    def _modes(self, subject: str, modes: yaml_source.Entry) -> dict[str, Element[Mode]]:
        found = {
            name: self._mode(f"mode {shown(name)} of {subject}", name, entry)
            for name, entry in self._named(modes.node, f"'modes' of {subject}")
        }
        if not found:
            hint = "write modes: {NAME: {cpu: ..., ...}}"
            self._findings.add(rules.NO_MODE, modes.node.place, f"{subject} lists no mode", hint)
        return found

    def _mode(self, subject: str, name: str, entry: yaml_source.Entry, misspelt: Collection[str] = ()) -> Element[Mode]:
        form = self._form(subject, entry, Mode, {"name": name}, misspelt=misspelt)
        return Element(name, entry.place, entry.node, form)

    def _form(
        self,
        subject: str,
        entry: yaml_source.Entry,
        kind: type[E_co],
        found: Mapping[str, object],
        known: Collection[str] = (),
        *,
        misspelt: Collection[str] = (),
    ) -> E_co | None:
        """Read the fields of an element; if a field has a mistake, gives None and adds findings.

        found: fields that are no keys, such as the name.
        known: names of fields to suggest for an unknown field; empty: the keys of `kind`.
        misspelt: fields that the file has under a wrong name, so that they are not reported as missing.
        """
        fields = {} if yaml_source.is_nothing(entry.node) else yaml_source.plain(entry.node)
        try:
            return read(kind, fields, found)
        except ValidationError as failure:
            _FormFindings(self._findings, subject, entry, kind, known).add(failure, misspelt)
            return None


class _FormFindings:
    """Turns pydantic's errors about one element into findings."""

    def __init__(
        self, findings: Findings, subject: str, entry: yaml_source.Entry, kind: type, known: Collection[str]
    ) -> None:
        self._findings = findings
        self._subject = subject
        self._place = entry.place
        self._node = entry.node
        self._kind = kind
        self._known = known or key_names(kind)

    def add(self, failure: ValidationError, misspelt: Collection[str]) -> None:
        errors: list[Any] = failure.errors(include_url=False)
        meant = {(field,) for field in misspelt}
        for error in errors:
            if error["type"] == "extra_forbidden":
                *parent, name = error["loc"]
                meant |= {(*parent, field) for field in _meant(self._findings, [name], self._known_at(error["loc"]))}
        missing = [error["loc"] for error in errors if error["type"] == "missing" and error["loc"] not in meant]
        for parent in dict.fromkeys(loc[:-1] for loc in missing):
            lacking = [f"'{loc[-1]}'" for loc in missing if loc[:-1] == parent]
            inside = f"{self._subject} ({parent[0]})" if parent else self._subject
            place = yaml_source.place_at(self._node, parent) if parent else self._place
            hint = f"add {listed([f'{loc[-1]}: ...' for loc in missing if loc[:-1] == parent])}"
            self._findings.add(rules.MISSING_FIELD, place, f"{inside} lacks {listed(lacking)}", hint)
        for error in errors:
            if error["type"] != "missing":
                self._one(error)

    def _one(self, error: Any) -> None:
        loc: tuple[int | str, ...] = error["loc"]
        if error["type"] == "extra_forbidden":
            self._unknown_field(loc)
            return
        node, steps = yaml_source.follow(self._node, loc)
        field = ".".join(step for step in loc[:steps] if isinstance(step, str))
        subject = f"'{field}' of {self._subject}" if field else self._subject
        reason = error.get("ctx", {}).get("error")
        if isinstance(reason, UnfitError):
            self._findings.add(reason.rule, node.place, reason.said_of(subject), reason.hint)
        else:
            rule, sentence, hint = _translated(error)
            self._findings.add(rule, node.place, f"{subject} {sentence}", hint)

    def _known_at(self, loc: tuple[int | str, ...]) -> Collection[str]:
        return key_names(element_at(self._kind, loc[:-1])) if len(loc) > 1 else self._known

    def _unknown_field(self, loc: tuple[int | str, ...]) -> None:
        name = str(loc[-1])
        parent, _ = yaml_source.follow(self._node, loc[:-1])
        known = self._known_at(loc)
        hint = self._findings.suggestion(name, known) or f"its fields are {listed(sorted(known))}"
        sentence = f"{self._subject} has no field {shown(name)}"
        self._findings.add(rules.UNKNOWN_FIELD, yaml_source.key_place(parent, name), sentence, hint)


def _meant(findings: Findings, names: Collection[str], known: Collection[str]) -> set[str]:
    """Return the fields of `known` that the author probably meant when writing the misspelt `names`."""
    return {closest for name in names if (closest := findings.closest(str(name), known)) is not None}


def _translated(error: Any) -> tuple[Rule, str, str]:
    """Return rule, sentence and hint for an error that pydantic itself raises."""
    rule, wanted, hint = _WANTED.get(
        error["type"], (rules.WRONG_TYPE, "something else", "heronry schema tells what each field may be")
    )
    bounds = error.get("ctx", {})
    wanted, hint = wanted.format_map(bounds), hint.format_map(bounds)
    if error["type"] == "string_pattern_mismatch" and error["ctx"]["pattern"] == f"^{NAME_PATTERN}$":
        rule, wanted, hint = rules.BAD_NAME, "a name", _NAME_HINT
    return rule, f"must be {wanted}, not {shown(error['input'])}", hint


def _is_demux(node: Node) -> bool:
    return isinstance(node, yaml_source.Mapping) and "demux" in node.entries


def _kind_of(node: yaml_source.Scalar | yaml_source.Sequence) -> str:
    return shown(node.value) if isinstance(node, yaml_source.Scalar) else "a list"


def _nothing_at(place: Place) -> Node:
    return yaml_source.Scalar(place, None)
