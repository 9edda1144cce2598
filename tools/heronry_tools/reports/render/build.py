"""Makes the graph of a spec: every symbol once, and every edge along which data can flow.

If a mode has a single input, there is no gate: the edge leads from the variable to the mode. If the reader of an input
is a branch of a DEMUX, and the input is the one that the DEMUX distributes, the edge leads from the DEMUX. If a
function is given, the graph has only what may contribute to that function, in any mode.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

from heronry_dg.findings import listed
from heronry_dg.gates import Expression, Leaf, child_path, demux_at, leaves, words
from heronry_dg.model import Demux, Function, Mode, Module, Spec
from heronry_tools.reports.render.graph import Cell, Edge, Graph, Node
from heronry_tools.reports.render.marks import Marks


def build(spec: Spec, marks: Marks, function: Function | None = None) -> Graph:
    """Make the graph of a spec; with a function, of all that may contribute to this function."""
    modules = list(spec.modules.values()) if function is None else _contributors(spec, function)
    return _Builder(spec, marks).graph(modules, whole=function is None)


def _contributors(spec: Spec, function: Function) -> list[Module]:
    """Name the modules whose data may reach a function, in the spec's order."""
    found, frontier = set(function.outputs), list(function.outputs)
    while frontier:
        module = spec.modules[frontier.pop()]
        read = {leaf.variable for mode in module.modes.values() for _, leaf in mode.leaves()}
        givers = {giver.name for variable in read for giver, _ in spec.producers(variable)}
        frontier += sorted(givers - found)
        found |= givers
    return [module for module in spec.modules.values() if module.name in found]


@dataclass(slots=True)
class _Builder:
    spec: Spec
    marks: Marks
    nodes: dict[str, Node] = field(default_factory=dict)
    edges: list[Edge] = field(default_factory=list)

    def graph(self, modules: list[Module], *, whole: bool) -> Graph:
        read = {leaf.variable for module in modules for mode in module.modes.values() for _, leaf in mode.leaves()}
        for variable in self.spec.variables:
            if whole or variable in read:
                self._add_variable(variable)
        for demux in self.spec.demuxes:
            if whole or any(module.name in self.spec.demuxes[demux].branches for module in modules):
                self._add_demux(demux)
        for device in self.spec.devices:
            if whole or any(module.device == device for module in modules):
                self._add_device(device)
        for module in modules:
            self._add_module(module)
        return Graph(self.spec.name, self.nodes, tuple(self.edges))

    def _add(self, node: Node) -> None:
        self.nodes[node.key] = node

    def _add_variable(self, name: str) -> None:
        variable = self.spec.variables[name]
        self._add(
            Node(
                f"variable:{name}",
                "variable",
                name,
                str(variable.versions),
                initial=variable.initial is not None,
                dead=self.marks.variable_dead(name),
                chosen=self.marks.given(name),
            )
        )

    def _add_demux(self, name: str) -> None:
        demux = self.spec.demuxes[name]
        branches = [self.spec.modules[branch] for branch in demux.branches]
        dead, chosen = self.marks.demux_dead(demux), any(self.marks.running(branch) for branch in branches)
        notes = [self._serves(name), f"to {', '.join(demux.to)}" if demux.to else ""]
        note = "\n".join(note for note in notes if note)
        self._add(Node(f"demux:{name}", "demux", name, note, dead=dead, chosen=chosen))
        if isinstance(demux.needs, Leaf):
            source, versions = f"variable:{demux.needs.variable}", accepted_versions(self.spec, demux.needs)
            self.edges.append(Edge(source, f"demux:{name}", versions, dead=dead, chosen=chosen))
        else:
            self._add_demand(demux, demux.needs, "", target=f"demux:{name}")

    def _add_demand(self, demux: Demux, needs: Expression, path: str, *, target: str) -> None:
        """Add the gates in front of a DEMUX, and the wires into them."""
        dead, chosen = self.marks.gate_dead(needs), self.marks.demanded(demux, path)
        if isinstance(needs, Leaf):
            source = f"variable:{needs.variable}"
            self.edges.append(Edge(source, target, accepted_versions(self.spec, needs), dead=dead, chosen=chosen))
            return
        key = f"gate:{demux.name}/{path}"
        symbol = words(needs)
        self._add(Node(key, symbol.outline, symbol.drawn, dead=dead, chosen=chosen))
        for index, one in enumerate(needs.inputs):
            self._add_demand(demux, one, child_path(path, index), target=key)
        self.edges.append(Edge(key, target, "", dead=dead, chosen=chosen))

    def _add_device(self, name: str) -> None:
        device = self.spec.devices[name]
        drivers = [module for module in self.spec.modules.values() if module.device == name]
        chosen = any(self.marks.running(module) for module in drivers)
        dead = self.marks.device_dead(name)
        self._add(Node(f"device:{name}", device.kind, name, f"on {device.pe}", dead=dead, chosen=chosen))

    def _serves(self, output: str) -> str:
        names = [function.name for function in self.spec.functions.values() if function.output == output]
        return f"serves {', '.join(names)}" if names else ""

    def _add_module(self, module: Module) -> None:
        key, running = f"module:{module.name}", self.marks.running(module)
        notes = [f"on {running.pe}" if running else "", self._serves(module.name)]
        modes = list(module.modes.values())
        cells = tuple(
            Cell(f"V{number} {mode.name}", self.marks.mode_dead(module, mode), self.marks.runs(module, mode))
            for number, mode in enumerate(modes, 1)
        )
        self._add(
            Node(
                key,
                "module",
                module.name,
                "\n".join(note for note in notes if note),
                cells if len(modes) > 1 else (),
                dead=self.marks.module_dead(module),
                chosen=running is not None,
            )
        )
        for number, mode in enumerate(modes):
            cell = number if len(modes) > 1 else None
            self._add_inputs(module, mode, key, cell)
            self.edges += self._outputs(module, mode, cell)
        self._add_device_edge(module, key)

    def _add_device_edge(self, module: Module, key: str) -> None:
        if module.device is None:
            return
        device = f"device:{module.device}"
        forth = self.spec.devices[module.device].kind == "sensor"
        source, target = (device, key) if forth else (key, device)
        dead = self.marks.module_dead(module) or self.marks.device_dead(module.device)
        self.edges.append(Edge(source, target, dead=dead, chosen=self.marks.running(module) is not None))

    def _outputs(self, module: Module, mode: Mode, cell: int | None) -> Iterator[Edge]:
        for variable, version in mode.gives.items():
            if f"variable:{variable}" not in self.nodes:
                continue
            label = str(version) if self.spec.variables[variable].versions > 1 else ""
            dead, chosen = self.marks.mode_dead(module, mode), self.marks.runs(module, mode)
            yield Edge(f"module:{module.name}", f"variable:{variable}", label, cell, None, dead, chosen)

    def _add_inputs(self, module: Module, mode: Mode, key: str, cell: int | None) -> None:
        if mode.needs is not None:
            self._add_input(module, mode, mode.needs, "", target=key, cell=cell)

    def _add_input(
        self, module: Module, mode: Mode, needs: Expression, path: str, *, target: str, cell: int | None
    ) -> None:
        dead = self.marks.gate_dead(needs) or self.marks.mode_dead(module, mode)
        demux = demux_at(needs)
        if demux is not None:
            chosen = any(self.marks.wired(module, mode, at) for at, _ in leaves(needs, path))
            self.edges.append(Edge(f"demux:{demux}", target, "", None, cell, dead, chosen))
            return
        if isinstance(needs, Leaf):
            source, chosen = f"variable:{needs.variable}", self.marks.wired(module, mode, path)
            self.edges.append(Edge(source, target, accepted_versions(self.spec, needs), None, cell, dead, chosen))
            return
        key = f"gate:{module.name}/{mode.name}/{path}"
        symbol = words(needs)
        chosen = self.marks.gate_chosen(module, mode, needs, path)
        self._add(Node(key, symbol.outline, symbol.drawn, dead=self.marks.gate_dead(needs), chosen=chosen))
        for index, one in enumerate(needs.inputs):
            self._add_input(module, mode, one, child_path(path, index), target=key, cell=None)
        self.edges.append(Edge(key, target, "", None, cell, dead, chosen))


def accepted_versions(spec: Spec, leaf: Leaf) -> str:
    """Write the versions that an input accepts (`@1`, `@<=2`) and the phases to which it is limited (` only in ...`).

    The text is empty if the input accepts all versions in all phases.
    """
    phases = f" only in {listed(sorted(leaf.only_in))}" if leaf.only_in is not None else ""
    if (leaf.best, leaf.worst) == (1, spec.variables[leaf.variable].versions):
        return phases
    return (f"@{leaf.best}" if leaf.best == leaf.worst else f"@<={leaf.worst}") + phases
