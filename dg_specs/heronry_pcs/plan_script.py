"""Applies a reconfiguration script (script.py) to a plan: the script rewires and moves running modules.

The graph to which the script is applied has only the running modules and their wires, not devices and
plants. The script may create the leaves in the space of this graph. For each module, the space has one
leaf for each pair of a mode and a possible PE of the module, under the name of the module. The image
`IMAGE:MODE@PE` selects one of these leaves. Parts that a script may leave out:

    :MODE    the mode is then the best one that has all inputs and variables which the script wires
    @PE      the PEs are then those of the legal configuration that publishes the fewest bits per second
             (level 6); if several publish the fewest, the first one in the spec's order
    :PATH    of the input at the end of an edge, if the module has only one input of that variable

A script can create an edge that is not a wire: an edge that leads from an input, an edge between two
variables, or an edge to a module that the script has deleted. `no_wires` lists such edges.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import prod
from typing import Final

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.model import Module, Spec
from heronry_dg.situation import Situation, hosts_when_all_is_up, survivors
from heronry_dg.traffic import bus_loads_mbit_per_s, hops
from heronry_dg.verify import verify
from heronry_pcs.graph import Edge, Graph, Leaf, Part
from heronry_pcs.plan_graph import image_of, module_leaf, sides_of, wire_edges
from heronry_pcs.script import interpret
from heronry_pcs.script_syntax import Call, ScriptError, read_script

MOST_PLACEMENTS: Final = 20_000  # tried for modules whose PE is left out

Place = tuple[str, str]  # mode, PE


@dataclass(frozen=True, slots=True)
class PlanOutcome:
    """The result of a script applied to a configuration.

    configuration: after the script; if there are errors, the configuration before the script.
    """

    statements: int
    errors: tuple[ScriptError, ...]
    configuration: Configuration
    no_wires: tuple[Edge, ...]  # edges of the graph after the script that cannot be wires


def module_graph(spec: Spec, configuration: Configuration) -> Graph:
    """The modules of a configuration and their wires, as a graph of leaves."""
    sides = sides_of(spec)
    leaves = {name: module_leaf(spec, name, one.mode, one.pe, sides) for name, one in configuration.modules.items()}
    vertices = frozenset(vertex for leaf in leaves.values() for vertex in leaf.vertices())
    return Graph(spec.name, leaves, {}, Part(vertices, frozenset(wire_edges(configuration)), frozenset(leaves)))


def apply_to_plan(
    text: str, spec: Spec, now: Situation, configuration: Configuration, most_placements: int = MOST_PLACEMENTS
) -> PlanOutcome:
    """Apply a script to a configuration; choose a PE for each module that the script creates without naming a PE.

    The PEs are chosen for the situation `now`. If there are more than `most_placements` combinations of PEs, each
    module that the script creates without naming a PE gets its first possible PE in the order of the spec.
    """
    space = _Space(spec, text)
    outcome = interpret(text, module_graph(spec, configuration), space.pick, _target)
    if outcome.errors:
        return PlanOutcome(outcome.statements, outcome.errors, configuration, ())
    places = {name: space.place(name, outcome.after.leaves[name].image) for name in outcome.after.own.components}
    wired, no_wires = _wired(spec, outcome.after, places)
    free = [name for name in wired.modules if name in space.free]
    return PlanOutcome(outcome.statements, (), _placed(spec, now, wired, free, most_placements), no_wires)


def _target(leaf: Leaf, port: str) -> str:
    """Complete the name of the port of `leaf` at which an edge ends: `V` becomes `V:PATH` if one input reads V."""
    inputs = [one for one in leaf.ports if one.startswith(f"{port}:")] if ":" not in port else []
    return inputs[0] if len(inputs) == 1 else port


class _Space:
    """The leaves that a script may create for the modules of one spec."""

    def __init__(self, spec: Spec, text: str) -> None:
        self._spec = spec
        self._sides = sides_of(spec)
        self._outputs: dict[str, set[str]] = {}  # module -> ports at which created edges begin
        self._inputs: dict[str, set[str]] = {}
        self.free: set[str] = set()  # created modules whose PE was left out
        for call in read_script(text)[0]:
            if isinstance(call, Call) and call.operation == "CreateEdge":
                for ports, vertex in zip((self._outputs, self._inputs), call.arguments, strict=True):
                    name, _, port = vertex.partition(".")
                    ports.setdefault(name, set()).add(port)

    def pick(self, name: str, image: str) -> Leaf | None:
        """Return the leaf of the module `name` in the mode and on the PE that `image` selects.

        If `image` names no mode, the first mode is taken whose leaf has a port for each edge that the script
        creates at the module. If `image` names no PE, the first possible PE is taken, and the module is added
        to `free`. None: there is no such module, or `image` selects no mode of it on a possible PE.
        """
        module = self._spec.modules.get(name)
        if module is None:
            return None
        self.free.discard(name)
        for (mode, pe), names in self._names(module):
            leaf = module_leaf(self._spec, name, mode, pe, self._sides)
            if image in names[:2] or (image in names[2:] and self._has_wires(leaf)):
                if image in names[1::2]:
                    self.free.add(name)
                return leaf
        return None

    def _names(self, module: Module) -> Iterator[tuple[Place, tuple[str, ...]]]:
        """Yield each pair of a mode and a possible PE of a module, with the four images that select this pair.

        The four images name, in this order: mode and PE, the mode alone, the PE alone, neither.
        """
        for mode in module.modes:
            for pe in hosts_when_all_is_up(self._spec, module):
                short = f"{module.image}:{mode}", f"{module.image}@{pe}", module.image
                yield (mode, pe), (image_of(module, mode, pe), *short)

    def place(self, name: str, image: str) -> Place:
        """Return the mode and PE that an image names.

        image: the whole image `IMAGE:MODE@PE`, as a leaf of the module `name` has it.
        """
        module = self._spec.modules[name]
        places = product(module.modes, self._spec.pes)
        return next((mode, pe) for mode, pe in places if image_of(module, mode, pe) == image)

    def _has_wires(self, leaf: Leaf) -> bool:
        outputs, inputs = self._outputs.get(leaf.name, set()), self._inputs.get(leaf.name, set())
        return outputs <= leaf.ports.keys() and all(_target(leaf, port) in leaf.ports for port in inputs)


def _wired(spec: Spec, graph: Graph, places: Mapping[str, Place]) -> tuple[Configuration, tuple[Edge, ...]]:
    """Convert a graph of modules to a configuration; gives it with the edges that could not become wires.

    places: mode and PE of each module.
    """
    modules = {name: Running(places[name][1], places[name][0], {}) for name in spec.modules if name in places}
    no_wires = []
    for start, end in sorted(graph.edges):
        (producer, _, variable), (consumer, _, port) = start.partition("."), end.partition(".")
        read, _, path = port.partition(":")
        if producer not in modules or consumer not in modules:  # a deleted module's edge, which PruneEdges would drop
            no_wires.append((start, end))
            continue
        gives = spec.modules[producer].modes[modules[producer].mode].gives
        leaves = dict(spec.modules[consumer].modes[modules[consumer].mode].leaves())
        inputs = modules[consumer].inputs
        if ":" not in port or read != variable or variable not in gives or path not in leaves or path in inputs:
            no_wires.append((start, end))
            continue
        wire = Wire(producer, variable, gives[variable])
        modules[consumer] = replace(modules[consumer], inputs={**inputs, path: wire})
    return Configuration(modules), tuple(no_wires)


def _placed(
    spec: Spec, now: Situation, configuration: Configuration, free: list[str], most_placements: int
) -> Configuration:
    """Place the modules in `free` on those PEs on which the whole configuration publishes the fewest bits per second.

    Legal choices come before all others: a choice that is not legal is taken only if no choice is legal. If there
    are more than `most_placements` choices, the configuration stays as it is. CPU (level 7 of the objective) need
    not be compared: it is the same for every choice, since a module takes the same CPU on every PE.
    """
    hosts = [hosts_when_all_is_up(spec, spec.modules[name]) for name in free]
    if not free or prod(map(len, hosts)) > most_placements:
        return configuration
    left = survivors(spec, now)
    found = []
    for number, pes in enumerate(product(*hosts)):
        moved = {name: replace(configuration.modules[name], pe=pe) for name, pe in zip(free, pes, strict=True)}
        placed = Configuration({**configuration.modules, **moved})
        found.append((sum(bus_loads_mbit_per_s(spec, hops(left, placed)).values()), number, placed))
    found.sort(key=lambda one: one[:2])
    return next((placed for _, _, placed in found if not verify(spec, now, placed)), found[0][2])
