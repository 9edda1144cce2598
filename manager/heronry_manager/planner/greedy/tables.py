"""A spec in integers, worked out once: what the greedy planner looks up while it plans.

Modules, modes, PEs, buses, inputs (leaves) and sources are numbers from 0 in the spec's order; a set of modules, modes
or PEs is an integer with their bits. Modes are numbered through all modules, leaves through all modes. Everything that
depends on the spec and the phase alone is here; what depends on faults is a `Scene`.

*Price* of a mode: a guess at the CPU that running it takes, its cheapest producers included. It orders alternatives
and decides nothing else.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

from heronry_dg.configuration import Wire
from heronry_dg.gates import And, Expression, Leaf, Or, Xor, child_path, most_together
from heronry_dg.model import CRITICALITIES, Function, Spec
from heronry_dg.objective import CRITICAL_CLASSES
from heronry_dg.situation import Situation, elements, hosts_when_all_is_up, survivors
from heronry_dg.traffic import frame_bits

LEAF, ALL, SOME, ONE = range(4)
Node = tuple[int, int, tuple["Node", ...], tuple["Node", ...]]
"""A gate: kind; number of the leaf, or of inputs that must hold; inputs, worth most first; inputs, cheapest first."""

_PRICE_ROUNDS = 8  # as deep as prices look; deeper graphs are merely ordered less well
_UNPRICED = 1 << 40


Giver = tuple[int, int]
"""Who may feed a leaf: a mode, and the module it is of."""


@dataclass(frozen=True, slots=True)
class Goal:
    """A wanted function."""

    name: str
    rank: int  # 0 (A) to 4 (E)
    priority: int
    outputs: tuple[int, ...]  # modules
    modes: tuple[int, ...]  # of its outputs, the most valuable first


@dataclass(frozen=True, slots=True)
class Wanted:
    """The functions that a phase wants, and what they are worth."""

    goals: tuple[Goal, ...]  # most important first
    outputs: int  # set of modules that serve by running
    output_modules: tuple[int, ...]  # the same
    weight: Mapping[int, int]  # mode of an output -> levels 1 and 2 in one number
    utility_bound: int  # level 2 is less than this: weight = critical classes * utility_bound + utility

    def score(self, modes: Sequence[int]) -> int:
        """Levels 1 and 2 of what runs in one number; `modes` by module, -1 for what does not run."""
        weight = self.weight
        return sum(weight[modes[module]] for module in self.output_modules if modes[module] >= 0)


class Tables:
    """All of it, for one spec."""

    def __init__(self, spec: Spec) -> None:
        """Number everything."""
        self.spec = spec
        self.modules = list(spec.modules.values())
        self.pes = list(spec.pes.values())
        self.buses = list(spec.buses.values())
        self.variables = list(spec.variables)
        self.module_number = {module.name: number for number, module in enumerate(self.modules)}
        self.pe_number = {pe.name: number for number, pe in enumerate(self.pes)}
        self.variable_number = {name: number for number, name in enumerate(self.variables)}
        self.bus_number = {bus.name: number for number, bus in enumerate(self.buses)}
        self._number_modes()
        self._find_hosts()
        self._size_up()
        self._number_leaves()
        self._price()
        self._order()
        self._find_rules()
        self._find_routes()
        self._wanted: dict[str | None, Wanted] = {}

    # Modes and hosts

    def _number_modes(self) -> None:
        self.modes = [(number, mode) for number, module in enumerate(self.modules) for mode in module.modes.values()]
        self.module_of = [number for number, _ in self.modes]
        self.cpu = [mode.cpu_millis for _, mode in self.modes]
        self.ram = [mode.ram for _, mode in self.modes]
        self.flash = [module.flash for module in self.modules]
        self.mode_number = {
            (self.modules[module].name, mode.name): number for number, (module, mode) in enumerate(self.modes)
        }
        self.modes_of: list[list[int]] = [[] for _ in self.modules]
        for number, (module, _) in enumerate(self.modes):
            self.modes_of[module].append(number)

    def _find_hosts(self) -> None:
        """Set, for each mode, of the PEs that could carry it if nothing else ran there."""
        hosts = [
            [self.pe_number[pe] for pe in hosts_when_all_is_up(self.spec, module)] if module.modes else []
            for module in self.modules
        ]
        self.hosts = [
            sum(1 << pe for pe in hosts[module] if self._fits_alone(number, pe))
            for number, (module, _) in enumerate(self.modes)
        ]

    def _size_up(self) -> None:
        """Size of a mode: its shares of all CPU, RAM and flash that there is."""
        whole = [sum(all_of) or 1 for all_of in zip(*((p.cpu_millis, p.ram, p.flash) for p in self.pes), strict=True)]
        self.size = [
            (self.cpu[mode] * 10**6 // whole[0])
            + (self.ram[mode] * 10**6 // whole[1])
            + (self.flash[self.module_of[mode]] * 10**6 // whole[2])
            for mode in range(len(self.modes))
        ]

    def _fits_alone(self, mode: int, number: int) -> bool:
        pe = self.pes[number]
        return (
            self.cpu[mode] <= pe.cpu_millis
            and self.ram[mode] <= pe.ram
            and self.flash[self.module_of[mode]] <= pe.flash
        )

    # Leaves and gates

    def _number_leaves(self) -> None:
        self.leaf_mode: list[int] = []
        self.leaf_module: list[int] = []
        self.leaf_path: list[str] = []
        self.leaf_variable: list[int] = []
        self.worth: list[dict[int, int]] = []  # by leaf: mode that may feed it -> points
        self.wire: list[dict[int, Wire]] = []  # by leaf: mode that may feed it -> the wire
        self.leaves_of: list[list[int]] = [[] for _ in self.modes]
        self._giving: dict[str, list[int]] = {}
        for number, (_, mode) in enumerate(self.modes):
            for variable in mode.gives:
                self._giving.setdefault(variable, []).append(number)
        self._written = [self._node(number, mode.needs, "") for number, (_, mode) in enumerate(self.modes)]

    def _node(self, mode: int, gate: Expression | None, path: str) -> Node | None:
        if gate is None:
            return None
        if isinstance(gate, Leaf):
            return (LEAF, self._leaf(mode, gate, path), (), ())
        inputs = (self._node(mode, child, child_path(path, index)) for index, child in enumerate(gate.inputs))
        nodes = tuple(node for node in inputs if node is not None)
        match gate:
            case And():
                return (ALL, len(nodes), nodes, nodes)
            case Or(k, _):
                return (ALL if k == len(nodes) else SOME, k, nodes, nodes)
            case Xor():
                return (ONE, 1, nodes, nodes)
            case _:
                assert_never(gate)

    def _leaf(self, mode: int, leaf: Leaf, path: str) -> int:
        """Number a leaf. A module feeds itself only in the one mode that it runs in."""
        self.leaf_mode.append(mode)
        self.leaf_module.append(self.module_of[mode])
        self.leaf_path.append(path)
        self.leaf_variable.append(self.variable_number[leaf.variable])
        number = len(self.leaf_mode) - 1
        self.leaves_of[mode].append(number)
        giving = [
            (giver, self.modes[giver][1].gives[leaf.variable])
            for giver in self._giving.get(leaf.variable, ())
            if self.module_of[giver] != self.module_of[mode] or giver == mode
        ]
        accepted = [(giver, version) for giver, version in giving if leaf.accepts(version)]
        self.worth.append({giver: leaf.points(version) for giver, version in accepted})
        self.wire.append({g: Wire(self.modules[self.module_of[g]].name, leaf.variable, v) for g, v in accepted})
        return number

    # Prices and orders

    def _price(self) -> None:
        self.price = list(self.size)
        for _ in range(_PRICE_ROUNDS):
            self.price = [size + self._price_of(node) for size, node in zip(self.size, self._written, strict=True)]

    def _price_of(self, node: Node | None) -> int:
        if node is None:
            return 0
        kind, number, inputs, _ = node
        if kind == LEAF:
            return min((self.price[giver] for giver in self.worth[number]), default=_UNPRICED)
        prices = sorted(map(self._price_of, inputs))
        return min(sum(prices[:number]), _UNPRICED)

    def _order(self) -> None:
        """Put gates and givers into the orders in which they are tried; ties stay in the spec's order."""
        self.needs = [None if node is None else self._ordered(node) for node in self._written]
        self.dearest: list[list[Giver]] = []  # by leaf, worth most first
        self.cheapest: list[list[Giver]] = []  # by leaf
        for worths in self.worth:
            givers = [(mode, self.module_of[mode]) for mode in worths]
            self.dearest.append(sorted(givers, key=lambda giver: -worths[giver[0]]))
            self.cheapest.append(sorted(givers, key=lambda giver: self.price[giver[0]]))
        self.giver_set = [sum(1 << mode for mode in worths) for worths in self.worth]
        self.has_choice = [node is not None and self._has_choice(node) for node in self.needs]
        self.readers = [0] * len(self.modes)  # mode -> modes with a leaf that it may feed
        for leaf, worths in enumerate(self.worth):
            for mode in worths:
                self.readers[mode] |= 1 << self.leaf_mode[leaf]

    def _ordered(self, node: Node) -> Node:
        kind, number, inputs, _ = node
        ordered = tuple(map(self._ordered, inputs))
        if kind not in (SOME, ONE):
            return (kind, number, ordered, ordered)
        return (
            kind,
            number,
            tuple(sorted(ordered, key=lambda one: (-self._most_points(one), self._price_of(one)))),
            tuple(sorted(ordered, key=self._price_of)),
        )

    def _most_points(self, node: Node) -> int:
        """Most points that the leaves of a gate can have together."""
        kind, number, inputs, _ = node
        if kind == LEAF:
            return max(self.worth[number].values(), default=0)
        points = [self._most_points(one) for one in inputs]
        return most_together(points, 1 if kind == ONE else len(points))

    def _has_choice(self, node: Node) -> bool:
        """Tell whether inputs could be supplied in ways of unlike worth."""
        kind, number, inputs, _ = node
        if kind == LEAF:
            return len(set(self.worth[number].values())) > 1
        return kind in (SOME, ONE) or any(map(self._has_choice, inputs))

    # Rules between modules

    def _find_rules(self) -> None:
        number = self.module_number
        self.pe_ram = [pe.ram for pe in self.pes]
        self.pe_flash = [pe.flash for pe in self.pes]
        self.separate = [0] * len(self.modules)
        self.together = [0] * len(self.modules)
        self.rivals = [0] * len(self.modules)  # other branches of the same DEMUX
        demuxes = [demux.branches for demux in self.spec.demuxes.values()]
        self.demuxes = [[number[name] for name in branches] for branches in demuxes]
        groups = ((self.spec.separate, self.separate), (self.spec.together, self.together), (demuxes, self.rivals))
        for written, others in groups:
            for group in written:
                everybody = sum(1 << number[name] for name in group)
                for name in group:
                    others[number[name]] |= everybody & ~(1 << number[name])

    # Buses

    def _find_routes(self) -> None:
        """Routes between PEs, and what the way from the manager to a PE leads over (`way`).

        Bits of `way`: PEs from 0, buses from `first_bus`; a PE that no fault-free way leads to has the bit `never`.
        """
        healthy = survivors(self.spec, Situation())
        self.first_bus = len(self.pes)
        self.never = 1 << (self.first_bus + len(self.buses))
        self.route = [
            [tuple(self.bus_number[bus] for bus in healthy.route(one.name, other.name) or ()) for other in self.pes]
            for one in self.pes
        ]
        self.way = self._ways()
        self.bits = [frame_bits(self.spec, variable) for variable in self.variables]
        self.load = [  # variable -> bandwidth in mode
            {number: bits * mode.rate_mhz for number, (_, mode) in enumerate(self.modes) if name in mode.gives}
            for name, bits in zip(self.variables, self.bits, strict=True)
        ]

    def _ways(self) -> list[int]:
        ways = [self.never] * len(self.pes)
        frontier = [(self.spec.manager.bus, 0)]
        seen = {self.spec.manager.bus}
        while frontier:
            bus, so_far = frontier.pop()
            so_far |= 1 << (self.first_bus + self.bus_number[bus])
            for number, pe in enumerate(self.pes):
                if bus in pe.buses and ways[number] == self.never:
                    ways[number] = so_far | 1 << number
                    further = [other for other in pe.buses if other not in seen]
                    seen.update(further)
                    frontier.extend((other, ways[number]) for other in further)
        return ways

    # What is wanted

    def wanted(self, phase: str | None) -> Wanted:
        """What a phase wants; worked out once for each."""
        if phase not in self._wanted:
            self._wanted[phase] = self._want(phase)
        return self._wanted[phase]

    def _want(self, phase: str | None) -> Wanted:
        functions = [f for f in self.spec.functions.values() if f.priority_in(phase) > 0]
        goals = sorted((self._goal(f, phase) for f in functions), key=self._urgency)
        worth = {
            mode: sum(self._utility(f, phase, mode) for f in functions) for mode in {m for g in goals for m in g.modes}
        }
        bound = 1 + sum(max((self._utility(f, phase, m) for m in self._output_modes(f)), default=0) for f in functions)
        classes = _class_weights(goals)
        outputs = sorted({module for goal in goals for module in goal.outputs})
        return Wanted(
            goals=tuple(goals),
            outputs=sum(1 << module for module in outputs),
            output_modules=tuple(outputs),
            weight={
                mode: worth[mode] + bound * sum(classes[g.rank] * g.priority for g in goals if mode in g.modes)
                for mode in worth
            },
            utility_bound=bound,
        )

    def _goal(self, function: Function, phase: str | None) -> Goal:
        modes = self._output_modes(function)
        return Goal(
            name=function.name,
            rank=CRITICALITIES.index(function.criticality_in(phase)),
            priority=function.priority_in(phase),
            outputs=tuple(self.module_number[name] for name in function.outputs),
            modes=tuple(sorted(modes, key=lambda mode: -self._utility(function, phase, mode))),
        )

    def _output_modes(self, function: Function) -> list[int]:
        return [mode for name in function.outputs for mode in self.modes_of[self.module_number[name]]]

    def _utility(self, function: Function, phase: str | None, mode: int) -> int:
        module = self.module_of[mode]
        if self.modules[module].name not in function.outputs:
            return 0
        modes = self.modes_of[module]
        return function.priority_in(phase) * function.value_of(modes.index(mode), len(modes))

    def _urgency(self, goal: Goal) -> tuple[int, int, int]:
        """Order of goals: by class, then by priority for the price; uncritical ones alike."""
        price = 1 + min((self.price[mode] for mode in goal.modes), default=0)
        return goal.rank, -goal.priority if goal.rank < len(CRITICAL_CLASSES) else 0, -(goal.priority * 10**9 // price)


def _class_weights(goals: Sequence[Goal]) -> list[int]:
    """Weights with which the sums of priorities of the classes A to E compare as level 1 does; E counts nothing."""
    weights = [0] * len(CRITICALITIES)
    weight = 1
    for rank in reversed(range(len(CRITICAL_CLASSES))):
        weights[rank] = weight
        weight *= 1 + sum(goal.priority for goal in goals if goal.rank == rank)
    return weights


def element_numbers(tables: Tables) -> dict[str, tuple[str, int]]:
    """Kind and number of every element of the spec that can be down; a channel has the number of its bus."""
    numbers: dict[str, Mapping[str, int]] = {
        "pe": tables.pe_number,
        "module": tables.module_number,
        "bus": tables.bus_number,
        "device": {name: number for number, name in enumerate(tables.spec.devices)},
        "channel": {},
    }
    found = {}
    for element in elements(tables.spec):
        kind, _, name = element.partition(":")
        number = tables.bus_number[name.rpartition(".")[0]] if kind == "channel" else numbers[kind][name]
        found[element] = (kind, number)
    return found
