"""The live parts of the dependency graph: which symbols and edges are in use, lost, idle or dead.

Symbols and edges are named by the keys of `reports.render`. So a picture is drawn once, and later only its colours are
changed.
"""

from functools import lru_cache

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_tools.reports.render.build import build
from heronry_tools.reports.render.graph import Edge, Node
from heronry_tools.reports.render.marks import Marks, marks
from heronry_tools.watch.snapshot import Graph, Live

_Choices = tuple[tuple[str, str, str, tuple[tuple[str, Wire], ...]], ...]  # of each module: name, PE, mode, inputs


def edge_key(edge: Edge) -> str:
    """Name an edge by its two symbols and, for each of them, by the number of the cell at which the edge ends.

    The number is `-` if the edge ends at the symbol as a whole, and not at one of its cells.
    """
    cells = ("-" if cell is None else str(cell) for cell in (edge.out_cell, edge.in_cell))
    return f"{edge.source}>{edge.target}#{'/'.join(cells)}"


class LiveGraphs:
    """Finds which parts of one spec's graph are in use, lost, idle or dead.

    The last results are remembered, since the same situations often return.
    """

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self.feasible = lru_cache(maxsize=32)(lambda now: marks(spec, now).found)
        self._made = lru_cache(maxsize=8)(self._make)

    def graph(self, now: Situation, configuration: Configuration) -> Graph:
        """Return the state of every symbol and edge, for a situation and the configuration that runs in it."""
        return self._made(now, _choices(configuration))

    def _make(self, now: Situation, choices: _Choices) -> Graph:
        spec = self._spec
        configuration = Configuration({name: Running(pe, mode, dict(inputs)) for name, pe, mode, inputs in choices})
        graph = build(spec, Marks(spec, self.feasible(now), configuration))
        lost = _lost_outputs(spec, now, configuration)
        degraded = {f"module:{name}" for name in configuration.modules if is_degraded(spec, configuration, name)}
        nodes = {
            key: _node(node, is_lost=key in lost, in_lesser_mode=key in degraded) for key, node in graph.nodes.items()
        }
        cells = {
            f"{key}#{number}": _live(cell.chosen, cell.dead, in_lesser_mode=number > 0)
            for key, node in graph.nodes.items()
            for number, cell in enumerate(node.cells)
        }
        edges = {
            edge_key(one): _live(one.chosen, one.dead, in_lesser_mode=bool(degraded & {one.source, one.target}))
            for one in graph.edges
        }
        return Graph(nodes, cells, edges)


def _choices(configuration: Configuration) -> _Choices:
    """Return the PE, the mode and the wires of each module of a configuration, in a form that a cache can compare."""
    return tuple(
        (name, running.pe, running.mode, tuple(sorted(running.inputs.items())))
        for name, running in configuration.modules.items()
    )


def is_degraded(spec: Spec, configuration: Configuration, module: str) -> bool:
    """Tell whether a module of the configuration runs in another mode than its best one."""
    return configuration.modules[module].mode != next(iter(spec.modules[module].modes))


def _lost_outputs(spec: Spec, now: Situation, configuration: Configuration) -> set[str]:
    """Return the keys of the output symbols of functions that are wanted and not served."""
    unserved = [
        function
        for function in spec.functions.values()
        if now.priority_of(function) > 0 and not any(output in configuration.modules for output in function.outputs)
    ]
    demuxes = {f"demux:{one.output}" for one in unserved if one.output in spec.demuxes}
    return demuxes | {f"module:{output}" for one in unserved for output in one.outputs}


def _node(node: Node, *, is_lost: bool, in_lesser_mode: bool) -> Live:
    return "lost" if is_lost else _live(node.chosen, node.dead, in_lesser_mode=in_lesser_mode)


def _live(chosen: bool, dead: bool, *, in_lesser_mode: bool) -> Live:
    if chosen:
        return "degraded" if in_lesser_mode else "served"
    return "dead" if dead else "idle"
