"""Checks the gates of a spec: DEMUXes have branches, no two inputs of a mode accept the same datum, cycles can start.

A cycle of wires can start if it passes through a variable with an `initial` value. Cycles are searched in the graph of
all modes. In this graph an edge leads from mode A to mode B if A gives a variable without `initial` in a version that a
leaf of B accepts. The search does not consider that two modes of one module never run together. So a cycle through both
modes is refused, although it can never be wired.

Source: docs/semantics.md, section 2, and semantics rule 6.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from heronry_dg import cycles, yaml_source
from heronry_dg.draft import Draft, Element, ModuleElement
from heronry_dg.expression_reader import ExpressionReader, Reading
from heronry_dg.findings import Findings, Place, listed, shown_cycle
from heronry_dg.gates import Expression, leaves
from heronry_dg.model import Mode
from heronry_dg.rules import graph as rules
from heronry_dg.schema import ONLY_MODE

ModeName = tuple[str, str]  # module, mode
_Datum = tuple[str, int]  # variable, version


@dataclass(frozen=True, slots=True)
class Gates:
    """The expressions of a spec after reading; an expression with a mistake is missing.

    shorthands: expression of each entry of `gates` that is no DEMUX, by name.
    demuxes: expression in front of each DEMUX.
    needs: expression of each mode; None for a mode without `needs`.
    branches: the modules that are branches of each DEMUX.
    places: where each leaf of a mode stands in the file, in the order of `gates.leaves`.
    """

    shorthands: Mapping[str, Expression]
    demuxes: Mapping[str, Expression]
    needs: Mapping[ModeName, Expression | None]
    branches: Mapping[str, tuple[str, ...]]
    places: Mapping[ModeName, tuple[Place, ...]]


def read_gates(draft: Draft, findings: Findings) -> Gates:
    """Read and check every expression. An expression with a mistake gives a finding, and is missing from the result."""
    reader = ExpressionReader(draft, findings)
    assess = _GateRules(draft, findings)
    for module in draft.modules.values():
        assess.read_module(module, reader)
    assess.check_branches()
    assess.check_values()
    assess.check_wiring_cycles()
    needs = {name: reading.expression if reading else None for name, reading in assess.readings.items()}
    places = {name: reading.places if reading else () for name, reading in assess.readings.items()}
    branches = {name: tuple(modules) for name, modules in assess.branches.items()}
    return Gates(reader.shorthands(), reader.demuxes(), needs, branches, places)


class _GateRules:
    def __init__(self, draft: Draft, findings: Findings) -> None:
        self._draft = draft
        self._findings = findings
        self.readings: dict[
            ModeName, Reading | None
        ] = {}  # None: a mode without `needs`; a mode with a mistake is missing
        self.branches: dict[str, list[str]] = {name: [] for name in draft.demuxes}

    def read_module(self, module: ModuleElement, reader: ExpressionReader) -> None:
        """Read the `needs` of all modes of a module, and note the DEMUXes of which this module is a branch."""
        for mode in module.modes.values():
            needs = _needs(mode)
            if needs is None:
                if module.form is not None and mode.form is not None:  # else `needs` may be present, but misspelt
                    self.readings[module.name, mode.name] = None
                continue
            reading = reader.read(needs)
            if reading is not None:
                self.readings[module.name, mode.name] = reading
                self._check_votes(reading)
        named = (demux for mode in module.modes for demux in self._demuxes(module.name, mode))
        for demux in dict.fromkeys(named):
            self.branches[demux].append(module.name)

    def check_branches(self) -> None:
        """Check that every mode of a branch names its DEMUX, and that every DEMUX has at least two branches."""
        for demux, modules in self.branches.items():
            for module in modules:
                self._check_modes_of_branch(self._draft.modules[module], demux)
        if not self._all_is_read():
            return  # a module with a mistake may be the missing branch
        for demux, modules in self.branches.items():
            if len(modules) < 2 and self._draft.demuxes[demux].form is not None:
                found = f"only '{modules[0]}'" if modules else "no module"
                sentence = f"DEMUX '{demux}' needs two branches or more, and {found} names it"
                place = self._draft.demuxes[demux].place
                self._findings.add(
                    rules.DEMUX_BRANCHES, place, sentence, "name the DEMUX in the `needs` of each branch"
                )

    def check_values(self) -> None:
        """Check that `value` of a function, if it is given, has one number per mode of the function's output."""
        for function in self._draft.functions.values():
            if function.form is None or function.form.value is None:
                continue
            outputs = self._outputs(function.form.output)
            modes = [len(self._draft.modules[name].modes) for name in outputs if name in self._draft.modules]
            if modes and self._all_is_read() and len(function.form.value) != max(modes):
                sentence = (
                    f"'value' of function '{function.name}' must have a number per mode of its output: {max(modes)}"
                )
                place = yaml_source.place_at(function.node, ("value",))
                sentence = f"{sentence}, not {len(function.form.value)}"
                self._findings.add(rules.VALUE_LENGTH, place, sentence, "best mode first")

    def check_wiring_cycles(self) -> None:
        """Check that every possible cycle of wires has a variable with an `initial` value."""
        graph = self._wiring()
        for component in cycles.components(graph):
            cycle = cycles.shortest_cycle(graph, component)
            if cycle:
                self._refuse_cycle(cycle)

    def _check_votes(self, reading: Reading) -> None:
        """Check that a mode names each DEMUX at most once, and that no two of its inputs accept the same datum.

        A datum is a variable in one version.
        """
        twice = {name for name, count in Counter(reading.demuxes).items() if count > 1}
        accepted: set[_Datum] = set()
        below: Counter[str] = Counter()  # leaves read so far, by DEMUX
        placed = list(zip(reading.places, leaves(reading.expression), strict=True))
        sizes = Counter(leaf.demux for _, (_, leaf) in placed)
        for place, (_, leaf) in placed:
            data = {(leaf.variable, version) for version in range(leaf.best, leaf.worst + 1)}
            if leaf.demux in twice:
                below[leaf.demux] += 1
                if below[leaf.demux] == 1 + sizes[leaf.demux] // reading.demuxes.count(leaf.demux):
                    sentence = f"DEMUX '{leaf.demux}' is named twice in one mode"
                    self._findings.add(rules.DEMUX_MISPLACED, place, sentence, "name it once")
            elif data & accepted:
                variable, version = min(data & accepted)
                sentence = f"version {version} of '{variable}' is accepted by another input of this mode as well"
                hint = "inputs of one mode accept different versions, so that no producer counts twice"
                self._findings.add(rules.READ_TWICE, place, sentence, hint)
            accepted |= data

    def _demuxes(self, module: str, mode: str) -> tuple[str, ...]:
        reading = self.readings.get((module, mode))
        return reading.demuxes if reading is not None else ()

    def _check_modes_of_branch(self, module: ModuleElement, demux: str) -> None:
        for mode in module.modes.values():
            understood = (module.name, mode.name) in self.readings
            if understood and demux not in self._demuxes(module.name, mode.name):
                sentence = f"mode '{mode.name}' of module '{module.name}' does not name DEMUX '{demux}'"
                hint = "other modes of the module do: every mode of a branch must"
                self._findings.add(rules.BRANCH_IN_PART, mode.place, sentence, hint)

    def _outputs(self, name: str) -> Sequence[str]:
        """Return the modules that can each serve a function whose output is `name`, a module or a DEMUX."""
        demux = self._draft.demuxes.get(name)
        ends = demux.form.to if demux is not None and demux.form is not None else ()
        return ends or self.branches.get(name, [name])

    def _all_is_read(self) -> bool:
        modules = self._draft.modules.values()
        return all(m.modes and all((m.name, mode) in self.readings for mode in m.modes) for m in modules)

    def _wiring(self) -> dict[ModeName | _Datum, list[ModeName | _Datum]]:
        """Return a graph with edges from each mode to its data, and from each datum to the modes that accept it.

        Data with an initial value are left out.
        """
        graph: dict[ModeName | _Datum, list[ModeName | _Datum]] = {}
        for module in self._draft.modules.values():
            for mode in module.modes.values():
                gives = mode.form.gives if mode.form is not None else {}
                graph[module.name, mode.name] = [datum for datum in gives.items() if self._may_be_waited_for(datum[0])]
        for datum in [datum for given in graph.values() for datum in given]:
            graph.setdefault(datum, [])
        for name, reading in self.readings.items():
            for _, leaf in leaves(reading.expression if reading is not None else None):
                for version in range(leaf.best, leaf.worst + 1):
                    if (leaf.variable, version) in graph:
                        graph[leaf.variable, version].append(name)
        return graph

    def _may_be_waited_for(self, variable: str) -> bool:
        element = self._draft.variables.get(variable)
        return element is not None and element.form is not None and element.form.initial is None

    def _refuse_cycle(self, cycle: list[ModeName | _Datum]) -> None:
        first = self._draft.modules[cycle[0][0]]
        route = shown_cycle([_shown(self._draft, node) for node in cycle])
        variables = list(dict.fromkeys(f"'{name}'" for name, step in cycle if isinstance(step, int)))
        which = listed(variables, last="or") if len(variables) <= 12 else "one of the variables on the cycle"
        sentence = f"nothing can start this cycle: {route}"
        self._findings.add(rules.CYCLE, first.place, sentence, f"give an 'initial' value to {which}")


def _needs(mode: Element[Mode]) -> yaml_source.Node | None:
    fields = mode.node.entries if isinstance(mode.node, yaml_source.Mapping) else {}
    needs = fields["needs"].node if "needs" in fields else None
    return None if needs is None or yaml_source.is_nothing(needs) else needs


def _shown(draft: Draft, node: ModeName | _Datum) -> str:
    name, step = node
    if isinstance(step, int):
        return f"{name}@{step}" if _versions(draft, name) > 1 else name
    return name if step == ONLY_MODE else f"{name} ({step})"


def _versions(draft: Draft, variable: str) -> int:
    form = draft.variables[variable].form
    return form.versions if form is not None else 1
