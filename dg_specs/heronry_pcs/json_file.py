"""Reads `NAME.pcs.json`, the form of a component graph that programs write and read.

    {"pcs": 1, "name": NAME,
     "leaves": {A: {"ports": {PORT: thousandths of a bit/s}, "image": TEXT, "plant": BOOL, "side": TEXT or null}},
     "components": {K: X}, "graph": X}          X = {"vertices": [..], "edges": [[s, t]], "components": [..]}

This form states vertices, edges and components of each composite, while the YAML form derives them. So JSON can also
hold graphs that break predicates. The text is parsed as JSON. Only where a mistake is found, the text is read again as
YAML (JSON is a part of YAML), to find the line and column.
"""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, Final

from heronry_dg.findings import Findings, Place, listed, shown
from heronry_dg.quantities import MOST_BITS_PER_S
from heronry_dg.yaml_source import MOST_BYTES, follow, read_tree
from heronry_pcs.file_rules import BAD_FILE
from heronry_pcs.graph import Edge, Graph, Leaf, Part
from heronry_pcs.names import COMPONENT_HINT, PORT_HINT, is_component, is_port

FILE_FIELDS: Final = ("pcs", "name", "leaves", "components", "graph")
LEAF_FIELDS: Final = ("ports", "image", "plant", "side")
PART_FIELDS: Final = ("vertices", "edges", "components")

_MOST_DIGITS: Final = 1000  # of a number; far above any weight, and below what Python refuses to read

_Path = tuple[int | str, ...]


def read_json(data: bytes, name: str, findings: Findings) -> Graph | None:
    """Read a graph; gives None, and adds findings, if the data are no graph.

    name: the name of the graph if the file gives none.
    """
    if len(data) > MOST_BYTES:
        findings.add(BAD_FILE, Place(1, 1), f"the file has more than {MOST_BYTES} bytes", "divide the graph")
        return None
    try:
        text = data.decode("utf-8-sig")
        document = json.loads(text, object_pairs_hook=_Object, parse_constant=_no_number, parse_int=_whole_number)
    except json.JSONDecodeError as error:
        findings.add(BAD_FILE, Place(error.lineno, error.colno), f"this is not JSON: {error.msg}")
    except UnicodeDecodeError as error:
        findings.add(BAD_FILE, Place(1, 1), f"byte {error.start} of the file is not UTF-8", "save the file as UTF-8")
    except RecursionError:
        findings.add(BAD_FILE, Place(1, 1), "this is not JSON of a graph: lists or objects are nested too deeply")
    except ValueError as error:
        findings.add(BAD_FILE, Place(1, 1), f"this is not JSON of a graph: {error}")
    else:
        reader = _Reader()
        graph = reader.graph(document, name)
        _place(data, reader.mistakes, findings)
        return None if reader.mistakes else graph
    return None


class _Object(dict[str, Any]):
    """An object of the file, and the keys that it gives twice."""

    def __init__(self, pairs: Sequence[tuple[str, Any]]) -> None:
        super().__init__(pairs)
        counted = Counter(key for key, _ in pairs) if len(self) < len(pairs) else Counter[str]()
        self.twice = [key for key, count in counted.items() if count > 1]


def _no_number(name: str) -> object:
    raise ValueError(f"the file holds {name}, which is no JSON number; write a finite number")


def _whole_number(digits: str) -> int:
    if len(digits) > _MOST_DIGITS:
        raise ValueError(f"the file holds a number with {len(digits)} digits; write at most {_MOST_DIGITS}")
    return int(digits)


def _place(data: bytes, mistakes: Sequence[tuple[_Path, str, str]], findings: Findings) -> None:
    """Add a finding for each mistake, at the place to which its path leads."""
    tree = read_tree(data, Findings("")) if mistakes else None
    for path, sentence, hint in mistakes:
        place = follow(tree, path)[0].place if tree is not None else Place(1, 1)
        findings.add(BAD_FILE, place, sentence, hint)


class _Reader:
    """Reads one JSON document as a component graph, and collects the mistakes in it.

    mistakes: each one is a path into the document, a sentence and a hint.
    """

    def __init__(self) -> None:
        self.mistakes: list[tuple[_Path, str, str]] = []
        self._names: frozenset[str] = frozenset()
        self._space: frozenset[str] = frozenset()

    def graph(self, document: Any, name: str) -> Graph | None:
        fields = self._object(document, (), "the file", FILE_FIELDS, required=("pcs", "leaves", "graph"))
        if fields.get("pcs", 1) != 1 or isinstance(fields.get("pcs"), bool):
            self._refuse(("pcs",), f"'pcs' must be 1, not {shown(fields['pcs'])}", "write 1")
        leaves = {one: self._leaf(one, x) for one, x in self._named(fields, "leaves")}
        composites = dict(self._named(fields, "components"))
        self._names = frozenset((*leaves, *composites))
        self._space = frozenset(vertex for leaf in leaves.values() for vertex in leaf.vertices())
        for clash in sorted(leaves.keys() & composites.keys()):
            sentence = f"clash:{clash}: the composite {shown(clash)} is named as a leaf"
            self._refuse(("components", clash), sentence, "name one of them differently")
        parts = {one: self._part(x, ("components", one)) for one, x in composites.items()}
        own = self._part(fields["graph"], ("graph",)) if "graph" in fields else Part()
        return Graph(self._text(fields, "name", (), name) or name, leaves, parts, own)

    def _object(
        self, value: Any, path: _Path, subject: str, known: Sequence[str], required: Sequence[str] = ()
    ) -> dict[str, Any]:
        """Return the known fields of the object `value`; report each field that is unknown, given twice or missing.

        If `value` is no object, this is reported, too, and the result is empty.

        subject: what messages call the object.
        known, required: the fields that the object may have, and those that it must have.
        """
        if not isinstance(value, _Object):
            self._refuse(path, f"{subject} must be an object, not {shown(value)}", "write {...}")
            return {}
        self._refuse_twice(value, path, subject)
        for name in value.keys() - set(known):
            self._refuse((*path, name), f"{subject} has no field {shown(name)}", f"it may have {listed(known)}")
        lacking = [f"'{name}'" for name in required if name not in value]
        if lacking:
            self._refuse(path, f"{subject} lacks {listed(lacking)}", "add it, as docs/polymorphic.md has it")
        return {name: one for name, one in value.items() if name in known}

    def _refuse_twice(self, value: _Object, path: _Path, subject: str) -> None:
        for name in value.twice:
            self._refuse((*path, name), f"{subject} gives {shown(name)} twice", "remove one of them")

    def _named(self, fields: dict[str, Any], field: str) -> Iterator[tuple[str, Any]]:
        value = fields.get(field, _Object([]))
        if not isinstance(value, _Object):
            self._refuse((field,), f"'{field}' must be an object, not {shown(value)}", "write {...}")
            return
        self._refuse_twice(value, (field,), f"'{field}'")
        for name, one in value.items():
            if not is_component(name):
                self._refuse((field, name), f"{shown(name)} cannot be the name of a component", COMPONENT_HINT)
            yield name, one

    def _leaf(self, name: str, value: Any) -> Leaf:
        path: _Path = ("leaves", name)
        fields = self._object(value, path, f"leaf {shown(name)}", LEAF_FIELDS, required=("ports",))
        plant = fields.get("plant", False)
        if not isinstance(plant, bool):
            self._refuse((*path, "plant"), f"'plant' of leaf {shown(name)} must be true or false", "write true")
        ports = self._ports(fields["ports"], (*path, "ports"), name) if "ports" in fields else {}
        image = self._text(fields, "image", path, name) or name
        return Leaf(name, ports, image, plant is True, self._text(fields, "side", path, None))

    def _ports(self, value: Any, path: _Path, leaf: str) -> dict[str, int]:
        if not isinstance(value, _Object) or not value:
            self._refuse(path, f"'ports' of leaf {shown(leaf)} must be an object with one port or more", "write {...}")
            return {}
        self._refuse_twice(value, path, f"leaf {shown(leaf)}")
        for port, weight in value.items():
            if not is_port(port):
                self._refuse((*path, port), f"{shown(port)} cannot be the name of a port", PORT_HINT)
            if not isinstance(weight, int) or isinstance(weight, bool) or not 0 <= weight <= 1000 * MOST_BITS_PER_S:
                sentence = f"the weight of port {shown(port)} must be a whole number of thousandths of a bit/s"
                self._refuse((*path, port), sentence, f"write 0 to {1000 * MOST_BITS_PER_S}")
        return {port: weight if isinstance(weight, int) else 0 for port, weight in value.items()}

    def _text(self, fields: dict[str, Any], field: str, path: _Path, default: str | None) -> str | None:
        value = fields.get(field)
        if value is None:
            return default
        if isinstance(value, str) and value and value.isprintable():
            return value
        self._refuse((*path, field), f"'{field}' must be printable text, not {shown(value)}", "write text in quotes")
        return default

    def _part(self, value: Any, path: _Path) -> Part:
        subject = " ".join(str(step) for step in path)
        fields = self._object(value, path, subject, PART_FIELDS, required=PART_FIELDS)
        lists = {name: self._list(fields[name], (*path, name)) for name in fields}
        return Part(
            frozenset(self._texts(lists.get("vertices", []), (*path, "vertices"), self._space)),
            frozenset(self._edges(lists.get("edges", []), (*path, "edges"))),
            frozenset(self._texts(lists.get("components", []), (*path, "components"), self._names)),
        )

    def _list(self, value: Any, path: _Path) -> list[Any]:
        if isinstance(value, list):
            return value
        self._refuse(path, f"'{path[-1]}' must be a list, not {shown(value)}", "write [...]")
        return []

    def _texts(self, items: list[Any], path: _Path, known: frozenset[str]) -> Iterator[str]:
        seen: set[str] = set()
        for number, item in enumerate(items):
            if self._is_known(item, known, (*path, number)):
                if item in seen:
                    self._refuse((*path, number), f"{shown(item)} is given twice", "remove one of them")
                seen.add(item)
                yield item

    def _edges(self, items: list[Any], path: _Path) -> Iterator[Edge]:
        seen: set[Edge] = set()
        for number, item in enumerate(items):
            if not isinstance(item, list) or len(item) != 2:
                self._refuse((*path, number), "an edge must be a list of two vertices", 'write ["A.a", "B.b"]')
            elif all(self._is_known(vertex, self._space, (*path, number, at)) for at, vertex in enumerate(item)):
                edge = (item[0], item[1])
                if edge in seen:
                    self._refuse((*path, number), f"the edge {shown(' -> '.join(edge))} is given twice", "remove one")
                seen.add(edge)
                yield edge

    def _is_known(self, item: Any, known: frozenset[str], path: _Path) -> bool:
        if isinstance(item, str) and item in known:
            return True
        if isinstance(item, str):
            self._refuse(path, f"unknown:{item}: the file lacks {shown(item)}", "declare it, or remove it")
        else:
            self._refuse(path, f"this must be a name, not {shown(item)}", "write a name in quotes")
        return False

    def _refuse(self, path: _Path, sentence: str, hint: str) -> None:
        self.mistakes.append((path, sentence, hint))
