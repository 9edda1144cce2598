"""Reads the bytes of a spec into a tree of nodes, with the place of each key and value.

Only plain YAML is accepted: maps, lists and scalars, in one document. Anchors, aliases, tags, merge keys, directives
and duplicate keys are refused, because with them a file may have another meaning than it seems to have. Scalars that
YAML programs read in different ways are refused as well (plain_scalars.py). A refused value becomes `REFUSED` in the
tree, and code that reads the tree adds no finding about this value.

A spec may come from anywhere, so no tree is built before the file is known to be small. First the bytes are counted.
Then the marks `:`, `,` and `- ` are counted, since almost every value has one before or behind it; this needs no
parser. Then the parser's events are read one by one, and depth, number of nodes and repeated keys are checked at each
event. So a file beyond a limit takes no more time than a file at the limit. Aliases are not followed, so a small file
cannot become a large tree. The limits leave room for 10 000 modules.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Final

import yaml

from heronry_dg.findings import Findings, Place, shown
from heronry_dg.plain_scalars import Surprise, Value, resolve
from heronry_dg.rules import file as rules
from heronry_dg.rules.rule import Rule
from heronry_dg.yaml_syntax import mistake_of, split_lines

MOST_BYTES: Final = 4 << 20
MOST_NODES: Final = 500_000
MOST_LEVELS: Final = 64
_TOO_DEEP: Final = f"this is nested deeper than {MOST_LEVELS} levels"
_TOO_MANY: Final = f"the file has more than {MOST_NODES} values"
_MAKE_SMALLER: Final = "remove data that is no part of a spec, or divide the system into two specs"
_KEEP_FLAT: Final = "give a part of `needs` a name under gates:, and write that name"
MOST_REPEATED_KEYS: Final = 100  # a file with more was hardly written by hand, and a longer list does not help

_PARSER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # without libyaml: the same events, ten times slower
_UNPRINTABLE: Final = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]")


class Refused:
    """Stands for a part of the file that already has a finding."""


REFUSED: Final = Refused()


@dataclass(slots=True)
class Scalar:
    """A single value."""

    place: Place
    value: Value | Refused


@dataclass(slots=True)
class Sequence:
    """A list in the file."""

    place: Place
    items: list["Node"]


@dataclass(slots=True)
class Entry:
    """One `key: value` of a map; `place` is the key's."""

    place: Place
    node: "Node"


@dataclass(slots=True)
class Mapping:
    """A map with keys of text, in the order of the file."""

    place: Place
    entries: dict[str, Entry]


Node = Scalar | Sequence | Mapping


def read_tree(data: bytes, findings: Findings) -> Node | None:
    """Read the one document in `data`; if the document cannot be read, add a finding and return None."""
    if len(data) > MOST_BYTES:
        findings.add(rules.TOO_LARGE, Place(1, 1), f"the file has more than {MOST_BYTES} bytes", _MAKE_SMALLER)
        return None
    if data.count(b":") + data.count(b",") + data.count(b"- ") > MOST_NODES:
        findings.add(rules.TOO_LARGE, Place(1, 1), _TOO_MANY, _MAKE_SMALLER)
        return None
    text = _decoded(data, findings)
    if text is None:
        return None
    try:
        return _Builder(_PARSER(text).get_event, findings).document()
    except _LimitError as limit:
        findings.add(limit.rule, limit.place, str(limit), limit.hint)
    except yaml.MarkedYAMLError as error:
        mistake = mistake_of(error, text)
        if "nesting depth" in (error.problem or ""):  # libyaml reads ahead, and has its own limit
            findings.add(rules.TOO_DEEP, mistake.place, _TOO_DEEP, _KEEP_FLAT)
        else:
            findings.add(rules.SYNTAX, mistake.place, mistake.sentence, mistake.hint)
    return None


def plain(node: Node) -> object:
    """Convert a tree of nodes to dicts, lists and values, without the positions in the file."""
    match node:
        case Scalar():
            return node.value
        case Sequence():
            return [plain(item) for item in node.items]
        case Mapping():
            return {key: plain(entry.node) for key, entry in node.entries.items()}


def is_nothing(node: Node) -> bool:
    """Tell whether a node is null: its key was written without a value, or with `null` or `~`."""
    return isinstance(node, Scalar) and node.value is None


def follow(node: Node, path: tuple[int | str, ...]) -> tuple[Node, int]:
    """Follow a path of keys and indices through the tree; give the node, and how many steps of the path were possible.

    If the path leaves the tree, the node is the last node that the path reached.
    """
    for taken, step in enumerate(path):
        match node:
            case Mapping() if isinstance(step, str) and step in node.entries:
                node = node.entries[step].node
            case Sequence() if isinstance(step, int) and step < len(node.items):
                node = node.items[step]
            case _:
                return node, taken
    return node, len(path)


def place_at(node: Node, path: tuple[int | str, ...]) -> Place:
    """Return the place in the file of the value at a path.

    If the path leaves the tree, give the place of the last value that the path reaches.
    """
    return follow(node, path)[0].place


def texts(node: Node) -> Iterator[str]:
    """Yield every text among the values of a tree, in the order of the file."""
    match node:
        case Scalar(value=str() as text):
            yield text
        case Sequence(items=items):
            for item in items:
                yield from texts(item)
        case Mapping(entries=entries):
            for entry in entries.values():
                yield from texts(entry.node)


def has_refused(node: Node) -> bool:
    """Tell whether some value of the tree was refused, and so has a finding."""
    match node:
        case Scalar():
            return node.value is REFUSED
        case Sequence():
            return any(has_refused(item) for item in node.items)
        case Mapping():
            return any(has_refused(entry.node) for entry in node.entries.values())


def _is_number(node: Node | None) -> bool:
    return isinstance(node, Scalar) and isinstance(node.value, int | Decimal) and not isinstance(node.value, bool)


def key_place(node: Node, key: str) -> Place:
    """Return where in the file a key of a map is written; if the map lacks the key, where the map is written."""
    if isinstance(node, Mapping) and key in node.entries:
        return node.entries[key].place
    return node.place


class _LimitError(Exception):
    """A file exceeds a limit; reading stops at once."""

    def __init__(self, rule: Rule, place: Place, sentence: str, hint: str) -> None:
        super().__init__(sentence)
        self.rule, self.place, self.hint = rule, place, hint


class _Builder:
    """Builds the tree of nodes of one YAML file from the events of the YAML parser."""

    def __init__(self, next_event: Callable[[], Any], findings: Findings) -> None:
        self._next = next_event
        self._findings = findings
        self._nodes = self._repeated_keys = 0

    def document(self) -> Node | None:
        """Build the tree of the file's only document from all events of the parser; None if the file is empty."""
        self._next()  # the stream's start
        start = self._next()
        if isinstance(start, yaml.StreamEndEvent):
            self._findings.add(rules.EMPTY, Place(1, 1), "the file is empty", "a spec begins with dg: 1")
            return None
        if isinstance(start, yaml.DocumentStartEvent) and (start.version or start.tags):
            self._refuse(rules.DIRECTIVE, start, "a YAML directive (%...) is not allowed", "leave it out")
        root = self._node(self._next(), 1)
        self._next()  # the document's end
        after = self._next()
        if not isinstance(after, yaml.StreamEndEvent):
            hint = "one file holds one spec; remove the '---'"
            self._refuse(rules.SECOND_DOCUMENT, after, "a second document begins here", hint)
        return root

    def _node(self, event: Any, level: int) -> Node:
        mark = event.start_mark
        place = Place(mark.line + 1, mark.column + 1)
        self._nodes += 1
        if self._nodes > MOST_NODES or level > MOST_LEVELS:
            raise self._beyond(place, level)
        if isinstance(event, yaml.AliasEvent):
            hint = "write the value out; a named gate can shorten `needs`"
            self._refuse(rules.ALIAS, event, "an alias (*) is not allowed", hint)
            return Scalar(place, REFUSED)
        if event.anchor is not None or event.tag is not None:
            self._refuse_properties(event)
        if isinstance(event, yaml.ScalarEvent):
            return Scalar(place, self._value(event, place))
        if isinstance(event, yaml.SequenceStartEvent):
            return Sequence(place, self._items(level))
        return Mapping(place, self._entries(level))

    def _beyond(self, place: Place, level: int) -> "_LimitError":
        if level > MOST_LEVELS:
            return _LimitError(rules.TOO_DEEP, place, _TOO_DEEP, _KEEP_FLAT)
        return _LimitError(rules.TOO_LARGE, place, _TOO_MANY, _MAKE_SMALLER)

    def _count_repeated(self, place: Place) -> None:
        self._repeated_keys += 1
        if self._repeated_keys > MOST_REPEATED_KEYS:
            sentence = f"the file has more than {MOST_REPEATED_KEYS} repeated keys, and is read no further"
            raise _LimitError(rules.TOO_LARGE, place, sentence, "check the program that wrote the file")

    def _items(self, level: int) -> list[Node]:
        items = []
        while not isinstance(event := self._next(), yaml.SequenceEndEvent):
            items.append(self._node(event, level + 1))
        return items

    def _entries(self, level: int) -> dict[str, Entry]:
        entries: dict[str, Entry] = {}
        before: Node | None = None
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            key = self._node(event, level + 1)
            node = self._node(self._next(), level + 1)
            name = self._key(key, event)
            if name is not None and name[:1].isdigit() and is_nothing(node) and _is_number(before):
                self._left_over(key.place, name)
            before = node
            if name in entries:
                first = entries[name].place
                sentence = f"{shown(name)} is given twice, first at {first.line}:{first.column}"
                self._count_repeated(key.place)
                self._findings.add(rules.DUPLICATE_KEY, key.place, sentence, "remove one of them")
            elif name is not None:
                entries[name] = Entry(key.place, node)
        return entries

    def _key(self, key: Node, event: yaml.Event) -> str | None:
        """Return the text of a key; None if the key is a list or a map.

        A key that is not text has a finding. A number as a key gives its text all the same, so that the key is not
        reported as missing as well.
        """
        if isinstance(key, Scalar) and isinstance(event, yaml.ScalarEvent):
            if not isinstance(key.value, str):
                sentence = f"the key {shown(event.value)} is not text"
                self._findings.add(rules.KEY_NOT_TEXT, key.place, sentence, "put it in quotes")
            return str(event.value)
        self._findings.add(rules.KEY_NOT_TEXT, key.place, "the key of an entry must be text", "write key: value")
        return None

    def _left_over(self, place: Place, digits: str) -> None:
        """Report digits after a decimal comma, as in {cpu: 0,5}, which are never meant as a key."""
        self._findings.withdraw(place)
        hint = "write a decimal point instead of a comma, and no comma between thousands"
        sentence = f"a comma ends the value here, so {shown(digits)} is no part of the number"
        self._findings.add(rules.KEY_NOT_TEXT, place, sentence, hint)

    def _value(self, event: yaml.ScalarEvent, place: Place) -> Value | Refused:
        if not event.implicit[0]:  # quoted, or a block of text
            return str(event.value)
        value = resolve(event.value)
        if isinstance(value, Surprise):
            self._findings.add(value.rule, place, value.sentence, value.hint)
            return REFUSED
        return value

    def _refuse_properties(self, event: Any) -> None:
        if event.anchor is not None:
            self._refuse(rules.ANCHOR, event, "an anchor (&) is not allowed", "leave it out")
        if event.tag is not None:
            self._refuse(rules.TAG, event, "a tag (!) is not allowed", "leave it out")

    def _refuse(self, rule: Rule, event: yaml.Event, sentence: str, hint: str) -> None:
        mark: Any = event.start_mark
        self._findings.add(rule, Place(mark.line + 1, mark.column + 1), sentence, hint)


def _decoded(data: bytes, findings: Findings) -> str | None:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8", "replace")
        sentence = f"byte 0x{data[error.start]:02x} is not UTF-8"
        findings.add(rules.NOT_UTF8, _end_of(before), sentence, "save the file as UTF-8")
        return None
    bad = _UNPRINTABLE.search(text)
    if bad is None:
        return text
    sentence = f"character U+{ord(bad[0]):04X} is not allowed"
    findings.add(rules.INVISIBLE, _end_of(text[: bad.start()]), sentence, "remove the character, which is invisible")
    return None


def _end_of(text: str) -> Place:
    lines = split_lines(text)
    return Place(len(lines), len(lines[-1]) + 1)
