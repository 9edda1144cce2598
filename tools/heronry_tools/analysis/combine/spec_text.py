"""A spec as text with its places, so that it can be edited in place: comments, line breaks and notation stay.

A spec has no anchors, aliases or tags (`heronry_dg.yaml_source`), so each value stands where it is written, and a part
of the text can be replaced, moved to another file, or shifted to the right without a change of its meaning.

`Document` has the nodes of a file and their places. `Edits` collects replacements and applies them all at once.
`Document.chunks` cuts a section into its elements, each with the comments above it, at two spaces of indentation.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import yaml

from heronry_dg.yaml_syntax import split_lines

_LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_INDENT: Final = "  "
_BEGIN_OF_DOCUMENT: Final = "---"
_TOLD_TO_EDITORS: Final = "# yaml-language-server:"  # its path is relative to the file that it stands in

Node = Any  # of PyYAML, which has no types
Entry = tuple[Node, Node]  # key and value of a map


class Document:
    """A spec that loads, as text with places. Offsets count characters."""

    def __init__(self, text: str) -> None:
        self._lines = [f"{line}\n" for line in split_lines(text.removesuffix("\n"))]
        self.text = "".join(self._lines)
        self._starts: list[int] = [0]
        for line in self._lines:
            self._starts.append(self._starts[-1] + len(line))
        self.root: Node = yaml.compose(self.text, _LOADER)

    def begin(self, node: Node) -> int:
        """Offset of the first character of a node."""
        return self._starts[int(node.start_mark.line)] + int(node.start_mark.column)

    def end(self, node: Node) -> int:
        """Offset behind the last character of a scalar, or of a list or map in brackets."""
        return self._starts[int(node.end_mark.line)] + int(node.end_mark.column)

    def written(self, node: Node) -> str:
        """Return a node as it stands in the file; a list or map without brackets is written with them."""
        if isinstance(node, yaml.ScalarNode) or node.flow_style:
            return self.text[self.begin(node) : self.end(node)]
        if isinstance(node, yaml.SequenceNode):
            return f"[{', '.join(map(self.written, node.value))}]"
        return f"{{{', '.join(f'{self.written(key)}: {self.written(value)}' for key, value in node.value)}}}"

    def sections(self) -> dict[str, Entry]:
        """Return the top-level entries, by key, in the order of the file."""
        return {key.value: (key, value) for key, value in self.root.value}

    def elements(self, section: str) -> dict[str, Entry]:
        """Return the entries of a section, by name; none where the file lacks it, or it is empty."""
        return fields(self.sections()[section][1]) if section in self.sections() else {}

    def head(self) -> str:
        """Return the comments above the first key."""
        return self._above(0) if not self.root.flow_style else ""

    def lead(self, section: str) -> str:
        """Return the comments and blank lines above the key of a section, but for the first one of the file."""
        number = list(self.sections()).index(section)
        return self._above(number) if number and not self.root.flow_style else ""

    def chunks(self, section: str) -> dict[str, str]:
        """Return each element of a section with the comments above it, as whole lines, by name."""
        if section not in self.sections():
            return {}
        key, node = self.sections()[section]
        if not isinstance(node, yaml.MappingNode):
            return {}
        if node.flow_style:
            return {k.value: f"{_INDENT}{self.written(k)}: {self.written(v)}\n" for k, v in node.value}
        found, begin = {}, key.start_mark.line + 1
        shift = len(_INDENT) - int(node.value[0][0].start_mark.column)
        for number, (name, value) in enumerate(node.value):
            is_last = number == len(node.value) - 1
            end = self._end_of_section(section) if is_last else _last_line(name, value) + 1
            found[name.value] = "".join(_shifted(line, shift) for line in self._lines[begin:end])
            begin = end
        return found

    def _above(self, number: int) -> str:
        """Return the lines between the end of the section before and the key of a section, by its number."""
        keys = list(self.sections().values())
        begin = 0 if number == 0 else self._end_of_section(keys[number - 1][0].value)
        lines = self._lines[begin : keys[number][0].start_mark.line]
        return "".join(line for line in lines if not line.startswith((_TOLD_TO_EDITORS, _BEGIN_OF_DOCUMENT)))

    def _end_of_section(self, section: str) -> int:
        """Return the number of the line behind a section: comments at the margin belong to what follows, if it does."""
        keys = list(self.sections().values())
        number = list(self.sections()).index(section)
        is_last = number + 1 == len(keys)
        after, behind = (len(self._lines), "...") if is_last else (keys[number + 1][0].start_mark.line, "#")
        line = _last_line(*keys[number]) + 1
        while line < after and not self._lines[line].startswith(behind):
            line += 1
        while line > 0 and not self._lines[line - 1].strip():
            line -= 1
        return line


def fields(node: Node) -> dict[str, Entry]:
    """Return the entries of a map, by key; none where the node is no map."""
    return {key.value: (key, value) for key, value in node.value} if isinstance(node, yaml.MappingNode) else {}


def scalars(node: Node) -> Iterator[Node]:
    """Yield all scalars of a list, also of lists in it; the node itself if it is one."""
    if isinstance(node, yaml.ScalarNode):
        yield node
    elif isinstance(node, yaml.SequenceNode):
        for item in node.value:
            yield from scalars(item)


def is_nothing(node: Node) -> bool:
    """Tell whether a value is null."""
    return isinstance(node, yaml.ScalarNode) and node.tag == "tag:yaml.org,2002:null"


@dataclass(slots=True)
class Edits:
    """Replacements in the text of a document, which do not overlap."""

    document: Document
    _made: list[tuple[int, int, str]] = field(default_factory=list)

    def replace(self, begin: int, end: int, text: str) -> None:
        """Write `text` instead of what stands from one offset to another."""
        self._made.append((begin, end, text))

    def add_key(self, node: Node, key: str, text: str) -> None:
        """Write a key as the first one of a map that is not empty."""
        first = self.document.begin(node.value[0][0])
        column = int(node.value[0][0].start_mark.column)
        between = ", " if node.flow_style else "\n" + " " * column
        self.replace(first, first, f"{key}: {text}{between}")

    def drop_key(self, node: Node, key: str) -> None:
        """Remove a key of a map with its value; other keys stay."""
        entries = node.value
        number = next(i for i, (one, _) in enumerate(entries) if one.value == key)
        begin, end = self.document.begin(entries[number][0]), self.document.end(entries[number][1])
        if number + 1 < len(entries):
            end = self.document.begin(entries[number + 1][0])
        elif number and node.flow_style:
            begin = self.document.end(entries[number - 1][1])
        self.replace(begin, end, "")

    def add_to_list(self, node: Node, key: str, item: str) -> None:
        """Write an item as the first one of the list under a key of a map; a map without the key gets it."""
        entry = fields(node).get(key)
        if entry is None:
            self.add_key(node, key, f"[{item}]")
            return
        name, found = entry
        if is_nothing(found):
            self.replace(self.document.begin(name), self.document.end(found), f"{key}: [{item}]")
        elif found.flow_style:
            begin = self.document.begin(found) + 1
            self.replace(begin, begin, f"{item}, " if found.value else item)
        else:
            begin = self.document.begin(found)
            self.replace(begin, begin, f"- {item}\n{' ' * int(found.start_mark.column)}")

    def applied(self) -> Document:
        """Return the document with all replacements made; those at one place in the order in which they came."""
        text, position, parts = self.document.text, 0, []
        for begin, end, new in sorted(self._made, key=lambda one: one[:2]):
            parts += [text[position:begin], new]
            position = end
        return Document("".join([*parts, text[position:]]))


def _last_line(key: Node, node: Node) -> int:
    """Return the number of the last line of an entry, without the comments below it."""
    if isinstance(node, yaml.ScalarNode):
        end = node.end_mark
        is_block = node.style in ("|", ">")
        return int(end.line) - 1 if is_block and not end.column else int(max(end.line, key.start_mark.line))
    if node.flow_style or not node.value:
        return int(node.end_mark.line)
    last = node.value[-1]
    return _last_line(*last) if isinstance(node, yaml.MappingNode) else _last_line(last, last)


def _shifted(line: str, columns: int) -> str:
    """Return a line moved to the right, or to the left as far as it has spaces."""
    if not line.strip():
        return line
    if columns >= 0:
        return " " * columns + line
    return line[min(-columns, len(line) - len(line.lstrip(" "))) :]
