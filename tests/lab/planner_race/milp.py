"""Levels 1 and 2 as a plain integer program, the same for every solver.

All variables are binary; rows are weighted sums between two bounds; goals are maximised in their order, each fixed
before the next. The rows follow docs/semantics.md, one rule after the other:

    x  a module runs in a mode on a PE        w  an input is wired to a producer
    y  a gate or an input holds               q  a variable is published on a bus, by its producer in a mode

Idle modules (semantics rule 5) are left in: they serve nothing, so they change neither level. Modules that cannot run
at all are left out beforehand, as for the planner. Deadlines (semantics rule 9) are no rows, but cuts: `forbid` adds
one.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import combinations, pairwise
from typing import assert_never

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.gates import And, Expression, Leaf, Or, Xor, child_path
from heronry_dg.model import Function
from heronry_dg.objective import CRITICAL_CLASSES
from heronry_dg.traffic import Hop, source_mbit_per_s
from heronry_manager.planner.candidates import Candidates, Source

Terms = list[tuple[int, int]]  # variable, weight


@dataclass(frozen=True, slots=True)
class Row:
    """A weighted sum that must lie in `low`..`high`; None: no bound on that side."""

    terms: Terms
    low: int | None
    high: int | None


@dataclass
class Milp:
    """The problem of one situation."""

    possible: Candidates
    count: int = 0  # of variables
    rows: list[Row] = field(default_factory=list)
    goals: list[Terms] = field(default_factory=list)  # most important first
    _x: dict[tuple[str, str, str], int] = field(default_factory=dict)
    _w: dict[tuple[str, str, str], list[tuple[Source, Leaf, int]]] = field(default_factory=dict)
    _q: dict[tuple[str, str, str, str], int] = field(default_factory=dict)  # producer, mode, variable, bus

    def __post_init__(self) -> None:
        """State the rules and the goals."""
        for name, candidate in self.possible.modules.items():
            for mode, hosts in candidate.hosts.items():
                for pe in hosts:
                    self._x[name, mode, pe] = self._new()
            self._row(self._runs(name), high=1)
        for name, candidate in self.possible.modules.items():
            for mode_ in candidate.modes():
                if mode_.needs is not None:
                    root = self._gate(mode_.needs, (name, mode_.name, ""))
                    self._row([(root, 1), *self._runs(name, mode_.name, -1)], low=0, high=0)
        for demux in self.possible.spec.demuxes.values():
            self._row([term for branch in demux.branches for term in self._runs(branch)], high=1)
        self._capacities()
        self._placement_rules()
        self._traffic()
        self.goals = list(self._levels())

    def configuration(self, ones: Iterable[int]) -> Configuration:
        """Read a solution: the variables that are 1."""
        true = set(ones)
        running = {(name, mode): pe for (name, mode, pe), variable in self._x.items() if variable in true}
        inputs: dict[str, dict[str, Wire]] = {}
        for (consumer, mode, path), wires in self._w.items():
            if (consumer, mode) in running:
                for source, leaf, variable in wires:
                    if variable in true:
                        inputs.setdefault(consumer, {})[path] = Wire(source.module, leaf.variable, source.version)
        return Configuration({name: Running(pe, mode, inputs.get(name, {})) for (name, mode), pe in running.items()})

    def forbid(self, published: Iterable[Hop]) -> None:
        """Forbid solutions with all of these hops."""
        terms, facts = [], 0
        for hop in sorted(published, key=lambda hop: (hop.bus, hop.producer, hop.variable)):
            terms.append((self._q[hop.producer, hop.mode, hop.variable, hop.bus], 1))
            facts += 1
            if hop.after is not None:
                turn = (hop.after, hop.bus)
                origins = {start for (start, _), way in self.possible.left.routes.items() if turn in pairwise(way)}
                terms.extend(self._at(hop.producer, origins))
                facts += 1
        self._row(terms, high=facts - 1)

    def _new(self) -> int:
        self.count += 1
        return self.count - 1

    def _row(self, terms: Terms, low: int | None = None, high: int | None = None) -> None:
        if terms:
            self.rows.append(Row(terms, low, high))

    def _runs(self, module: str, mode: str | None = None, weight: int = 1) -> Terms:
        return [(v, weight) for (name, m, _), v in self._x_of(module) if mode in (None, m)]

    def _at(self, module: str, pes: Iterable[str], weight: int = 1, mode: str | None = None) -> Terms:
        there = set(pes)
        return [(v, weight) for (_, m, pe), v in self._x_of(module) if pe in there and mode in (None, m)]

    def _x_of(self, module: str) -> Iterator[tuple[tuple[str, str, str], int]]:
        if module in self.possible.modules:
            for mode, hosts in self.possible.modules[module].hosts.items():
                for pe in hosts:
                    yield (module, mode, pe), self._x[module, mode, pe]

    def _gate(self, gate: Expression, where: tuple[str, str, str]) -> int:
        """State when a gate holds; returns its variable."""
        held = self._new()
        if isinstance(gate, Leaf):
            self._row([(held, 1), *((w, -1) for w in self._wires(gate, where))], low=0, high=0)
            return held
        inputs = [
            self._gate(child, (where[0], where[1], child_path(where[2], i))) for i, child in enumerate(gate.inputs)
        ]
        match gate:
            case And():
                for one in inputs:
                    self._row([(one, 1), (held, -1)], low=0, high=0)
            case Or(k, _):
                self._row([*((one, 1) for one in inputs), (held, -k)], low=0)
                for one in inputs:
                    self._row([(one, 1), (held, -1)], high=0)
            case Xor():
                self._row([*((one, 1) for one in inputs), (held, -1)], low=0, high=0)
            case _:
                assert_never(gate)
        return held

    def _wires(self, leaf: Leaf, where: tuple[str, str, str]) -> Iterator[int]:
        wires = self._w[where] = []
        for source in self.possible.sources(where[0], where[1], leaf):
            wire = self._new()
            wires.append((source, leaf, wire))
            if source.module != where[0]:
                giving = [term for mode in source.modes for term in self._runs(source.module, mode, -1)]
                self._row([(wire, 1), *giving], high=0)
            yield wire

    def _capacities(self) -> None:
        spec, left = self.possible.spec, self.possible.left
        for name, cpu_millis in left.pe_cpu_millis.items():
            here = [
                (spec.modules[m], spec.modules[m].modes[mode], v) for (m, mode, pe), v in self._x.items() if pe == name
            ]
            self._row([(v, mode.cpu_millis) for _, mode, v in here], high=cpu_millis)
            self._row([(v, mode.ram) for _, mode, v in here], high=spec.pes[name].ram)
            self._row([(v, module.flash) for module, _, v in here], high=spec.pes[name].flash)

    def _placement_rules(self) -> None:
        for pe in self.possible.left.pe_cpu_millis:
            for group in self.possible.spec.separate:
                self._row([term for module in group for term in self._at(module, [pe])], high=1)
            elsewhere = [other for other in self.possible.left.pe_cpu_millis if other != pe]
            for group in self.possible.spec.together:
                for one, other in combinations(group, 2):
                    self._row([*self._at(one, [pe]), *self._at(other, elsewhere)], high=1)

    def _traffic(self) -> None:
        """Publish what is wired from one side of a bus to another one."""
        for bus, capacity in self.possible.left.bus_mbit_per_s.items():
            sides = self._sides(bus)
            for (consumer, _, _), wires in self._w.items():
                for wire in wires:
                    self._publish(consumer, wire, bus, sides)
            spec = self.possible.spec
            self._row(
                [
                    (q, source_mbit_per_s(spec, variable, spec.modules[producer].modes[mode]))
                    for (producer, mode, variable, on), q in self._q.items()
                    if on == bus
                ],
                high=capacity,
            )

    def _publish(self, consumer: str, wire: tuple[Source, Leaf, int], bus: str, sides: list[frozenset[str]]) -> None:
        source, leaf, wired = wire
        for mode in source.modes if source.module != consumer else ():
            key = (source.module, mode, leaf.variable, bus)
            if key not in self._q:
                self._q[key] = self._new()
            for side in sides:
                sent = self._at(source.module, side, -1, mode)
                if sent:
                    self._row([(self._q[key], 1), (wired, -1), *sent, *self._at(consumer, side)], low=-1)

    def _sides(self, bus: str) -> list[frozenset[str]]:
        """Split the PEs that are up by what stays connected without a bus."""
        left = self.possible.left
        up = list(left.pe_cpu_millis)
        return list(dict.fromkeys(frozenset(b for b in up if bus not in (left.route(a, b) or ())) for a in up))

    def _levels(self) -> Iterator[Terms]:
        phase, functions = self.possible.now.phase, self.possible.spec.functions.values()
        for criticality in CRITICAL_CLASSES:
            worth: Counter[int] = Counter()
            for function in functions:
                if function.criticality_in(phase) == criticality:
                    for variable in self._serving(function):
                        worth[variable] += self.possible.now.priority_of(function)
            yield sorted(worth.items())
        worth = Counter()
        for function in functions:
            for variable, value in self._serving(function).items():
                worth[variable] += self.possible.now.priority_of(function) * value
        yield sorted(worth.items())

    def _serving(self, function: Function) -> dict[int, int]:
        """Return variables of which one is 1 when a wanted function is served, each with the value of that service."""
        wanted = self.possible.now.priority_of(function) > 0
        modules = [self.possible.spec.modules[output] for output in function.outputs if wanted]
        return {
            variable: function.value_of(module.mode_index(mode), len(module.modes))
            for module in modules
            for (_, mode, _), variable in self._x_of(module.name)
        }
