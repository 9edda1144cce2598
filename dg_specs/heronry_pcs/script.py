"""Interprets a reconfiguration script (script_syntax.py): gives the graph after the script, or all of its errors.

CreateComponent adds a leaf to the graph: the leaf of the space that has the assigned name and the image.
DeleteComponent removes a component with its own components and all their vertices, from all composites as well; a
composite that has no vertices left is removed. The edges at the removed vertices stay until PruneEdges removes them.
(PruneEdges is not the operation cprune.) CreateEdge and DeleteEdge add and remove an edge. At the end, a composite has
the edges of the graph with both ends in its vertices. A created leaf is in no composite.

A script with one error changes nothing. To find every error, the statements are followed as if those before them had
been executed. If a component could not be created, its deletion and edges at it give no further errors.

    PCS101 syntax                   PCS201 no such component        PCS205 the edge exists already
    PCS102 no such operation        PCS202 no such port             PCS206 no such edge
    PCS103 not called on the graph  PCS203 the component exists     PCS207 deleted on an earlier line
    PCS104 wrong use of a variable  PCS204 no such leaf and image   PCS208 an edge inside one leaf

Source: the paper that graph.py names, section 3.4 and Figure 16.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from heronry_pcs.graph import Edge, Graph, Leaf, Part, inside
from heronry_pcs.script_syntax import Call, Define, ScriptError, read_script

Pick = Callable[[str, str], Leaf | None]
"""Gives the leaf of the space with a name and an image; None if the space has no such leaf."""

Target = Callable[[Leaf, str], str]
"""Gives the port of a leaf that is meant by the port's name in a script, at the end of an edge."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a script: the graph after it (with errors: the graph before it), and its errors by line."""

    statements: int  # that could be read
    errors: tuple[ScriptError, ...]
    after: Graph


def interpret(text: str, graph: Graph, pick: Pick | None = None, target: Target = lambda _leaf, port: port) -> Outcome:
    """Apply a script to a graph; if the script has an error, the graph in the result is the given one.

    pick: gives the leaf that the script creates by a name and an image. By default this is the leaf in
        `graph.leaves` that has this name and image.
    target: gives the port that a name at the end of an edge means; by default the port that has this name.
    """
    statements, errors = read_script(text)
    run = _Run(graph, pick or _picked_from(graph.leaves), target)
    for statement in statements:
        match statement:
            case Define():
                run.define(statement)
            case Call():
                run.call(statement)
    found = tuple(sorted([*errors, *run.errors], key=lambda error: error.line))
    return Outcome(len(statements), found, graph if found else run.graph())


def _picked_from(leaves: Mapping[str, Leaf]) -> Pick:
    def pick(name: str, image: str) -> Leaf | None:
        leaf = leaves.get(name)
        return leaf if leaf is not None and leaf.image == image else None

    return pick


class _Run:
    """One interpretation of a script; it holds the graph as the statements so far have made it."""

    def __init__(self, graph: Graph, pick: Pick, target: Target) -> None:
        self._before = graph
        self._pick = pick
        self._target = target
        self._leaves = dict(graph.leaves)
        self._composites = dict(graph.composites)
        self._vertices = set(graph.vertices)
        self._edges = set(graph.edges)
        self._members = set(graph.own.components)
        self._names = graph.leaves.keys() | graph.composites.keys()
        self._defined: set[str] = set()
        self._receiver: str | None = None
        self._deleted: dict[str, int] = {}  # name -> line
        self._unmade: set[str] = set()  # names to which no component could be assigned
        self.errors: list[ScriptError] = []

    def graph(self) -> Graph:
        """Return the graph as it is now, with the edges of its composites."""
        edges = frozenset(self._edges)
        return replace(
            self._before,
            leaves=self._leaves,
            composites={
                name: replace(part, edges=inside(edges, part.vertices)) for name, part in self._composites.items()
            },
            own=Part(frozenset(self._vertices), edges, frozenset(self._members)),
        )

    def define(self, statement: Define) -> None:
        if statement.name in self._defined:
            self._error(statement.line, "104", f"'{statement.name}' is defined twice")
        self._defined.add(statement.name)

    def call(self, call: Call) -> None:
        self._check_receiver(call)
        if call.operation == "CreateComponent":
            self._create_component(call)
            return
        if call.assigned is not None:
            self._unmade.add(call.assigned)
            sentence = f"'{call.assigned}' is assigned {call.operation}, which gives no component"
            self._error(call.line, "104", sentence)
        _OPERATIONS[call.operation](self, call)

    def _check_receiver(self, call: Call) -> None:
        if call.receiver in self._names or call.receiver in self._defined:
            sentence = f"'{call.receiver}' is no graph: a component or a variable has that name"
            self._error(call.line, "103", sentence)
        elif self._receiver is None:
            self._receiver = call.receiver
        elif call.receiver != self._receiver:
            self._error(call.line, "103", f"the graph is called '{self._receiver}' above, not '{call.receiver}'")

    def _create_component(self, call: Call) -> None:
        name, (image,) = call.assigned, call.arguments
        if name is None:
            self._error(call.line, "104", f"the component of image '{image}' is assigned to no name")
        elif name not in self._defined:
            self._unmade.add(name)
            self._error(call.line, "104", f"'{name}' is not defined above; write define {name};")
        elif name in self._members:
            self._error(call.line, "203", f"component '{name}' exists already")
        else:
            self._join(call.line, name, image)

    def _join(self, line: int, name: str, image: str) -> None:
        leaf = self._pick(name, image)
        if leaf is None:
            self._unmade.add(name)
            self._error(line, "204", f"the space has no leaf '{name}' of image '{image}'")
            return
        self._unmade.discard(name)
        self._deleted.pop(name, None)
        self._leaves[name] = leaf
        self._members.add(name)
        self._vertices |= leaf.vertices()

    def _delete_component(self, call: Call) -> None:
        (name,) = call.arguments
        if name in self._unmade:
            return
        if name not in self._members:
            code, why = self._missing(name)
            self._error(call.line, code, f"component '{name}' {why}")
            return
        part = Part(self._leaves[name].vertices()) if name in self._leaves else self._composites[name]
        gone = {name, *part.components}
        self._vertices -= part.vertices
        for one, other in list(self._composites.items()):
            left = replace(other, vertices=other.vertices - part.vertices, components=other.components - gone)
            self._composites[one] = left
            if other.vertices and not left.vertices:
                gone.add(one)
        for one in gone:
            self._composites.pop(one, None)
        self._composites = {
            one: replace(other, components=other.components - gone) for one, other in self._composites.items()
        }
        self._deleted.update(dict.fromkeys(gone & self._members, call.line))
        self._members -= gone

    def _missing(self, name: str) -> tuple[str, str]:
        """Return the code and the words of the error about a name that is no member."""
        line = self._deleted.get(name)
        return ("201", "does not exist") if line is None else ("207", f"was deleted on line {line}")

    def _prune_edges(self, call: Call) -> None:
        del call
        self._edges = {edge for edge in self._edges if self._vertices.issuperset(edge)}

    def _create_edge(self, call: Call) -> None:
        edge = self._edge(call)
        if edge is None:
            return
        if edge[0].partition(".")[0] == edge[1].partition(".")[0]:
            self._error(call.line, "208", f"the edge {_shown(edge)} lies inside one leaf")
        elif edge in self._edges:
            self._error(call.line, "205", f"the edge {_shown(edge)} exists already")
        else:
            self._edges.add(edge)

    def _delete_edge(self, call: Call) -> None:
        edge = self._edge(call)
        if edge is None:
            return
        if edge in self._edges:
            self._edges.remove(edge)
        else:
            self._error(call.line, "206", f"there is no edge {_shown(edge)}")

    def _edge(self, call: Call) -> Edge | None:
        """Return the edge that an operation names; None if one of its ends does not exist.

        An end that does not exist is noted as an error, unless its component was not created because of an error.
        """
        start, end = call.arguments[0], self._named_by(call.arguments[1])
        there = [self._has_end(call.line, vertex) for vertex in (start, end)]
        return (start, end) if all(there) else None

    def _named_by(self, vertex: str) -> str:
        name, dot, port = vertex.partition(".")
        return f"{name}{dot}{self._target(self._leaves[name], port)}" if name in self._leaves else vertex

    def _has_end(self, line: int, vertex: str) -> bool:
        name, _, port = vertex.partition(".")
        if name in self._unmade:
            return False
        if name not in self._members or name not in self._leaves:
            code, why = self._missing(name)
            self._error(line, code, f"'{vertex}': component '{name}' {why}")
            return False
        if port not in self._leaves[name].ports:
            self._error(line, "202", f"'{vertex}': component '{name}' has no port '{port}'")
            return False
        return True

    def _error(self, line: int, number: str, sentence: str) -> None:
        self.errors.append(ScriptError(line, 0, f"PCS{number}", sentence))


_OPERATIONS: Final[Mapping[str, Callable[[_Run, Call], None]]] = {
    "DeleteComponent": _Run._delete_component,  # noqa: SLF001 - the operations of this very class
    "PruneEdges": _Run._prune_edges,  # noqa: SLF001
    "CreateEdge": _Run._create_edge,  # noqa: SLF001
    "DeleteEdge": _Run._delete_edge,  # noqa: SLF001
}


def _shown(edge: Edge) -> str:
    return f"'{edge[0]}' -> '{edge[1]}'"
