"""The drawing of the dependency graph for the page.

It is made once for each choice of the user (one function, or the whole graph). Then only its colours change.

The drawing of a module has a line for the name of the PE on which the module runs. The line has room for the longest of
these names, so that no symbol moves when the page fills in a name.
"""

from dataclasses import replace

from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_tools.reports.render.build import build
from heronry_tools.reports.render.graph import Graph, Node
from heronry_tools.reports.render.marks import marks
from heronry_tools.reports.render.svg import uncoloured
from heronry_tools.watch.graph_marks import edge_key


def picture(spec: Spec, function: str | None) -> str:
    """Draw the graph of a spec as SVG without colours.

    function: draw only what contributes to this function; None: draw the whole graph.
    """
    return uncoloured(_with_room(spec, _bare(spec, function)), edge_key)


def symbols(spec: Spec) -> list[dict[str, str]]:
    """List the symbols of the whole graph for the table beside it: key, kind, label and note of each."""
    nodes = _bare(spec, None).nodes.values()
    return [{"key": node.key, "kind": node.kind, "label": node.label, "note": node.note} for node in nodes]


def contributing(spec: Spec) -> dict[str, list[str]]:
    """Return for each function the keys of the symbols that contribute to it."""
    return {function: list(_bare(spec, function).nodes) for function in spec.functions}


def _bare(spec: Spec, function: str | None) -> Graph:
    return build(spec, marks(spec, Situation()), None if function is None else spec.functions[function])


def _with_room(spec: Spec, graph: Graph) -> Graph:
    longest = max(spec.pes, key=len, default="")
    return replace(graph, nodes={key: _roomy(node, longest) for key, node in graph.nodes.items()})


def _roomy(node: Node, longest: str) -> Node:
    if node.kind != "module":
        return node
    return replace(node, note="\n".join(line for line in (f"on {longest}", node.note) if line))
