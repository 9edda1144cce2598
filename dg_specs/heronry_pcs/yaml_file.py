"""Reads `NAME.pcs.yaml`, the form of a component graph that people write.

    pcs: 1
    name: g_eav
    components:
      Kc: {components: {Kc1: {ports: [a]}, Kc2: {ports: [a, b]}}}
      Kdyn: {plant: true, ports: [motion]}
      Kimu: {side: uav, ports: {motion: 0, m_posUp_ft: 9500}}      # bit/s, up to three decimals
    edges: [Kc1.a -> Kc2.a, Kdyn.motion -> Kimu.motion]
    library: {Kekf: {image: pcstrackingfilter.dll, ports: [m_alt]}}    # in the space, not in the graph

The members of the graph are all names under `components`, at any depth. Of a composite, the components are all names
below it, the vertices are all ports of their leaves, and the edges are those with both ends in these vertices.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from heronry_dg import quantities
from heronry_dg.findings import Findings, Place, listed, shown
from heronry_dg.quantities import UnfitError
from heronry_dg.yaml_source import REFUSED, Entry, Node, Scalar, Sequence, is_nothing, read_tree
from heronry_dg.yaml_source import Mapping as MapNode
from heronry_pcs.file_rules import BAD_FILE
from heronry_pcs.graph import Edge, Graph, Leaf, Part, inside
from heronry_pcs.names import COMPONENT_HINT, EDGE_HINT, PORT_HINT, edge_of, is_component, is_port

FILE_FIELDS: Final = ("pcs", "name", "components", "edges", "library")
LEAF_FIELDS: Final = ("ports", "image", "plant", "side")
COMPONENT_FIELDS: Final = ("components", *LEAF_FIELDS)


def read_yaml(data: bytes, name: str, findings: Findings) -> Graph | None:
    """Read a graph; if the data have mistakes, adds findings, and gives None or a part of the graph.

    name: the name of the graph if the file gives none.
    """
    if not data.strip():
        findings.add(BAD_FILE, Place(1, 1), "the file is empty", "begin with pcs: 1, then components:")
        return None
    root = read_tree(data, findings)
    return _Reader(findings).graph(root, name) if root is not None else None


class _Reader:
    """Reads one file; parts with a mistake are reported, and left out of the graph."""

    def __init__(self, findings: Findings) -> None:
        self._findings = findings
        self._leaves: dict[str, Leaf] = {}
        self._below: dict[str, list[str]] = {}  # composite -> all names below it
        self._placed: dict[str, Place] = {}

    def graph(self, root: Node, name: str) -> Graph | None:
        if not isinstance(root, MapNode):
            self._refuse(root.place, "a component graph is a map", "begin with pcs: 1, then components:")
            return None
        fields = self._fields(root, "the file", FILE_FIELDS)
        self._version(root, fields)
        members = self._components(fields.get("components"))
        inner = dict(self._leaves)
        self._components(fields.get("library"), in_library=True)
        vertices = _vertices(inner.values())
        edges = frozenset(self._edges(fields.get("edges")))
        composites = {one: self._part(below, edges) for one, below in self._below.items()}
        own = Part(vertices, edges, frozenset(members))
        return Graph(self._text(fields, "name", "the file") or name, self._leaves, composites, own)

    def _part(self, below: list[str], edges: frozenset[Edge]) -> Part:
        vertices = _vertices(self._leaves[name] for name in below if name in self._leaves)
        return Part(vertices, inside(edges, vertices), frozenset(below))

    def _version(self, root: MapNode, fields: Mapping[str, Entry]) -> None:
        entry = fields.get("pcs")
        if entry is None:
            self._refuse(root.place, "the file lacks 'pcs'", "begin with pcs: 1")
        elif not (isinstance(entry.node, Scalar) and entry.node.value in (1, REFUSED)):
            self._refuse(entry.node.place, f"'pcs' must be 1, not {_shown(entry.node)}", "write pcs: 1")

    def _fields(self, node: MapNode, subject: str, known: tuple[str, ...]) -> dict[str, Entry]:
        """Return the fields of a map that are known and not empty; each unknown field is reported."""
        for name in node.entries.keys() - set(known):
            hint = self._findings.suggestion(name, known) or f"it may have {listed(known)}"
            self._refuse(node.entries[name].place, f"{subject} has no field {shown(name)}", hint)
        return {name: one for name, one in node.entries.items() if name in known and not is_nothing(one.node)}

    def _components(self, entry: Entry | None, *, in_library: bool = False) -> list[str]:
        """Read a map of components, at any depth; gives all names in it."""
        if entry is None:
            return []
        if not isinstance(entry.node, MapNode):
            self._refuse(entry.node.place, f"components must be a map, not {_shown(entry.node)}", "write NAME: {...}")
            return []
        found: list[str] = []
        for name, one in entry.node.entries.items():
            if self._is_new(name, one.place):
                found += [name, *self._component(name, one, in_library=in_library)]
        return found

    def _is_new(self, name: str, place: Place) -> bool:
        if not is_component(name):
            self._refuse(place, f"{shown(name)} cannot be the name of a component", COMPONENT_HINT)
            return False
        if name in self._placed:
            first = self._placed[name]
            sentence = f"clash:{name}: {shown(name)} is given twice, first at {first.line}:{first.column}"
            self._refuse(place, sentence, "name one of them differently")
            return False
        self._placed[name] = place
        return True

    def _component(self, name: str, entry: Entry, *, in_library: bool) -> list[str]:
        """Read a leaf or a composite; gives the names of all components inside the composite, at any depth.

        A leaf gives no names.
        """
        subject = f"component {shown(name)}"
        if not isinstance(entry.node, MapNode):
            self._refuse(entry.node.place, f"{subject} must be a map, not {_shown(entry.node)}", "write {ports: [a]}")
            return []
        fields = self._fields(entry.node, subject, COMPONENT_FIELDS)
        if "components" not in fields:
            self._leaf(name, entry, fields)
            return []
        for field in LEAF_FIELDS:
            if field in fields:
                sentence = f"{subject} has components, and {field!r} stands on leaves only"
                self._refuse(fields[field].place, sentence, "move it to the components")
        if in_library:
            self._refuse(fields["components"].place, f"{subject} has components", "a library has leaves only")
        self._below[name] = []  # entered here, so that composites stand in the order of the file
        self._below[name] += self._components(fields["components"], in_library=in_library)
        return self._below[name]

    def _leaf(self, name: str, entry: Entry, fields: Mapping[str, Entry]) -> None:
        subject = f"component {shown(name)}"
        self._leaves[name] = Leaf(
            name=name,
            ports=self._ports(subject, entry.place, fields.get("ports")),
            image=self._text(fields, "image", subject) or name,
            plant=self._flag(fields.get("plant"), subject),
            side=self._text(fields, "side", subject),
        )

    def _ports(self, subject: str, place: Place, entry: Entry | None) -> dict[str, int]:
        if entry is None:
            self._refuse(place, f"{subject} lacks 'ports'", "add ports: [...], or components: {...}")
            return {}
        node = entry.node
        if isinstance(node, Scalar):
            self._refuse(node.place, f"'ports' of {subject} must be a list or a map", "write ports: [a, b]")
            return {}
        if not (node.items if isinstance(node, Sequence) else node.entries):
            self._refuse(node.place, f"{subject} has no port", "a leaf has one or more")
        if isinstance(node, Sequence):
            return self._listed_ports(subject, node.items)
        named = [(name, one) for name, one in node.entries.items() if self._is_port(subject, name, one.place)]
        return {name: self._weight(subject, name, one.node) for name, one in named}

    def _listed_ports(self, subject: str, items: list[Node]) -> dict[str, int]:
        ports: dict[str, int] = {}
        for item in items:
            name = item.value if isinstance(item, Scalar) else None
            if name is REFUSED:
                continue
            if not isinstance(name, str):
                self._refuse(item.place, f"a port of {subject} must be a name, not {_shown(item)}", PORT_HINT)
            elif name in ports:
                self._refuse(item.place, f"{subject} has port {shown(name)} twice", "remove one of them")
            elif self._is_port(subject, name, item.place):
                ports[name] = 0
        return ports

    def _is_port(self, subject: str, name: str, place: Place) -> bool:
        if is_port(name):
            return True
        self._refuse(place, f"{shown(name)} cannot be the name of a port of {subject}", PORT_HINT)
        return False

    def _weight(self, subject: str, port: str, node: Node) -> int:
        value = node.value if isinstance(node, Scalar) else _shown(node)
        if value is None or value is REFUSED:
            return 0
        try:
            return quantities.weight_mbit_per_s(value)
        except UnfitError as error:
            self._refuse(node.place, error.said_of(f"the weight of port {shown(port)} of {subject}"), error.hint)
            return 0

    def _text(self, fields: Mapping[str, Entry], field: str, subject: str) -> str | None:
        node = fields[field].node if field in fields else None
        if node is None or (isinstance(node, Scalar) and node.value is REFUSED):
            return None
        if isinstance(node, Scalar) and isinstance(node.value, str) and node.value and node.value.isprintable():
            return node.value
        sentence = f"{field!r} of {subject} must be text, not {_shown(node)}"
        self._refuse(node.place, sentence, "put it in quotes if it is meant as text")
        return None

    def _flag(self, entry: Entry | None, subject: str) -> bool:
        if entry is None:
            return False
        if isinstance(entry.node, Scalar) and isinstance(entry.node.value, bool):
            return entry.node.value
        sentence = f"'plant' of {subject} must be true or false, not {_shown(entry.node)}"
        self._refuse(entry.node.place, sentence, "write plant: true, or leave it out")
        return False

    def _edges(self, entry: Entry | None) -> Iterator[Edge]:
        if entry is None:
            return
        if not isinstance(entry.node, Sequence):
            self._refuse(entry.node.place, f"'edges' must be a list, not {_shown(entry.node)}", f"{EDGE_HINT} in [...]")
            return
        space = _vertices(self._leaves.values())
        seen: set[Edge] = set()
        for item in entry.node.items:
            edge = edge_of(item.value) if isinstance(item, Scalar) and isinstance(item.value, str) else None
            if edge is None:
                self._refuse(item.place, f"an edge must be text with an arrow, not {_shown(item)}", EDGE_HINT)
            elif edge in seen:
                self._refuse(item.place, f"edge {shown(' -> '.join(edge))} is given twice", "remove one of them")
            elif self._is_known(edge, space, item.place):
                seen.add(edge)
                yield edge

    def _is_known(self, edge: Edge, space: frozenset[str], place: Place) -> bool:
        for vertex in edge:
            if vertex not in space:
                hint = self._findings.suggestion(vertex, space)
                self._refuse(place, f"unknown:{vertex}: no leaf has such a port", hint or "write LEAF.PORT")
                return False
        return True

    def _refuse(self, place: Place, sentence: str, hint: str) -> None:
        self._findings.add(BAD_FILE, place, sentence, hint)


def _vertices(leaves: Iterable[Leaf]) -> frozenset[str]:
    return frozenset(vertex for leaf in leaves for vertex in leaf.vertices())


def _shown(node: Node) -> str:
    match node:
        case Scalar(value=value):
            return "that" if value is REFUSED else shown(value)
        case Sequence():
            return "a list"
        case MapNode():
            return "a map"
