"""The least cut of a component graph: the least bandwidth that the radio must carry between two sides.

*What is cut.* A cut divides the leaves that have a port in the graph, except plants, into two sides. A leaf may be
pinned to a side, and then stays there. The pinned leaves must name exactly two sides. A port and its consumers are one
*net*. The weight of a net is the bandwidth of the port's data. It counts once if at least one consumer is on the other
side than the port, however many consumers are there.

*Which cut.* If there are several least cuts, the result is the one with as many leaves as possible on the first side.
Least cuts form a lattice, so there is exactly one such cut.

*How it is found:* by maximum flow (Lawler 1973).

- The leaves pinned to the first side are the source, and the leaves pinned to the second side are the sink.
- Each net has two nodes of its own, and an arc of its weight from the first to the second of these.
- Arcs lead from each leaf of the net to the first node, and from the second node to each leaf of the net.
- After the maximum flow, the first side keeps each leaf from which no path with free capacity leads to the sink.

Source: Ippolito et al. (docs/polymorphic.md), section 3.4: "a minimum-cut was determined to partition the components".
"""

from collections.abc import Mapping
from dataclasses import dataclass

from ortools.graph.python.max_flow import SimpleMaxFlow

from heronry_pcs.graph import Graph, PcsError, parent


@dataclass(frozen=True, slots=True)
class Cut:
    """A least cut: the leaves of a component graph, divided into two sides.

    mbit_per_s: the bandwidth that crosses the cut, and that a radio must carry, in thousandths of a bit/s.
    sides: by name of the side, its leaves, sorted.
    """

    mbit_per_s: int
    sides: Mapping[str, list[str]]


def least_cut(graph: Graph, first: str | None = None) -> Cut:
    """Divide the leaves of a graph into two sides such that the radio between them carries as little as possible.

    If there are several such cuts, the result is the one with as many leaves as possible on the side `first`.

    first: name of a side; None: the side of the first leaf that is pinned to a side.
    Raises PcsError `sides` if the leaves are not pinned to exactly two sides.
    """
    inner = {parent(vertex) for vertex in graph.vertices}
    nodes = {name: leaf.side for name, leaf in graph.leaves.items() if name in inner and not leaf.plant}
    sides = list(dict.fromkeys(side for side in nodes.values() if side is not None))
    if len(sides) != 2:
        raise PcsError("sides", sides)
    if first == sides[1]:
        sides.reverse()
    number = {name: sides.index(side) if side is not None else at for at, (name, side) in enumerate(nodes.items(), 2)}
    flow, reaching = _flow(graph, number, _nets(graph, nodes))
    kept, given = (sorted(n for n in nodes if (number[n] in reaching) is other) for other in (False, True))
    return Cut(flow, {sides[0]: kept, sides[1]: given})


def _nets(graph: Graph, nodes: Mapping[str, str | None]) -> dict[str, set[str]]:
    """Return for each port of a weight above 0 the leaves in `nodes` that it joins: its producer and its consumers."""
    nets: dict[str, set[str]] = {}
    for start, end in sorted(graph.edges):
        producer, consumer = parent(start), parent(end)
        if producer in nodes and consumer in nodes and _weight(graph, start) > 0:
            nets.setdefault(start, {producer}).add(consumer)
    return nets


def _weight(graph: Graph, vertex: str) -> int:
    leaf, _, port = vertex.partition(".")
    return graph.leaves[leaf].ports[port]


def _flow(graph: Graph, number: Mapping[str, int], nets: Mapping[str, set[str]]) -> tuple[int, set[int]]:
    """Return the maximum flow from node 0 to node 1, and the nodes on the side of node 1 in the minimum cut.

    A node is on this side if a path with free capacity leads from it to node 1.

    number: the node of each leaf.
    nets: for each port, the leaves that give or read its data.
    """
    network = SimpleMaxFlow()
    network.add_arc_with_capacity(0, 1, 0)  # both nodes are there, even if nothing leads to them
    node = max(number.values(), default=1)
    for port, joined in nets.items():
        weight = _weight(graph, port)
        network.add_arc_with_capacity(node + 1, node + 2, weight)
        for leaf in sorted(joined):
            network.add_arc_with_capacity(number[leaf], node + 1, weight)
            network.add_arc_with_capacity(node + 2, number[leaf], weight)
        node += 2
    status = network.solve(0, 1)  # type: ignore[no-untyped-call]
    if status != network.OPTIMAL:
        raise AssertionError(f"a network of {len(nets)} nets has a maximum flow, and the solver said {status}")
    return network.optimal_flow(), set(network.get_sink_side_min_cut())
