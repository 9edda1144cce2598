"""A component graph as nodes and edges of a picture.

The picture shows only the components that have no components of their own. Plants are circles, devices have their own
symbols, and all other components are squares. An arrow from one component to another stands for all edges between their
ports in this direction. A bold arrow is on a loop that leads through a plant and through something that is no plant. A
plant on no such loop is *open*, and drawn like an element that cannot run.
"""

from collections.abc import Mapping
from typing import Final

from heronry_pcs.graph import Graph as ComponentGraph
from heronry_pcs.loops import Loops, home, is_plant, loops
from heronry_tools.reports.render.graph import Edge, Graph, Kind, Node

_DEVICE: Final = "device:"


def component_picture(graph: ComponentGraph, model: ComponentGraph | None = None) -> Graph:
    """Make the picture of a graph.

    model: the whole graph, if `graph` is only a view of the whole; loops are searched for in the whole graph.
        None: `graph` itself is whole.
    """
    found = loops(model or graph)
    drawn = [name for name, member in graph.members.items() if not member.components]
    of = {vertex: name for name in drawn for vertex in graph.members[name].vertices}
    kinds = _device_kinds(graph)
    nodes = {name: _node(graph, name, found, kinds) for name in drawn}
    return Graph(graph.name, nodes, tuple(_edges(graph, model or graph, of, found, nodes)))


def _node(graph: ComponentGraph, name: str, found: Loops, kinds: Mapping[str, Kind]) -> Node:
    vertices = graph.members[name].vertices
    leaf = graph.leaves.get(name)
    notes = [f"image {leaf.image}"] if leaf is not None and leaf.image != name else []
    if is_plant(graph, name):
        is_open = not found.control(vertices)
        notes = ["open" if is_open else "plant"]
        return Node(name, "variable", name, notes[0], initial=True, dead=is_open, chosen=not is_open)
    if leaf is not None and leaf.side is not None:
        notes.append(f"pinned to {leaf.side}")
    return Node(name, kinds.get(name, "module"), name, "\n".join(notes), initial=True)


def _device_kinds(graph: ComponentGraph) -> dict[str, Kind]:
    """Return the kind of each device in the graph of a plan: sensor or actuator.

    An edge that leads from a device to a module shows a sensor; an edge from a module to a device, an actuator.
    """
    kinds: dict[str, Kind] = {}
    for start, end in graph.edges:
        for vertex, kind in ((start, "sensor"), (end, "actuator")):
            name, _, port = vertex.partition(".")
            if name.startswith(_DEVICE) and port == "module":
                kinds[name] = "sensor" if kind == "sensor" else "actuator"
    return kinds


def _edges(
    graph: ComponentGraph, model: ComponentGraph, of: Mapping[str, str], found: Loops, nodes: Mapping[str, Node]
) -> list[Edge]:
    bold = [loop for loop in found.found if {is_plant(model, one) for one in loop} == {True, False}]
    pairs: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for start, end in sorted(graph.edges):
        if start in of and end in of and of[start] != of[end]:
            pairs.setdefault((of[start], of[end]), []).append((start, end))
    drawn = []
    for (source, target), edges in pairs.items():
        ends = [{home(model, start), home(model, end)} for start, end in edges]
        chosen = any(pair <= loop for pair in ends for loop in bold)
        dead = not chosen and (nodes[source].dead or nodes[target].dead)
        label = f"{len(edges)} edges" if len(edges) > 1 else ""
        drawn.append(Edge(source, target, label, dead=dead, chosen=chosen))
    return drawn
