"""Every legal configuration of a small spec, and the best of them, by brute force: the measure of the planner.

Written from semantics.md alone. This code shares with the product the model's dataclasses and the analysis of one bus
(`heronry_wire.timing`). Faults, routes, gates, identifiers, resources, deadlines and scoring are computed here a second
time, in another way, so that an error is seen unless both have it:

1. *Structures*: modules, modes and wires without places, built backwards from the outputs of wanted functions. A module
   to which no wire leads does not run, so no structure has an idle module.
2. *Placements* of a structure on PEs, with resources, placement rules, bandwidth and deadlines.

Levels 1 to 3 of the objective depend on the structure alone. So structures are tried from the highest value down, and
only those that share the best feasible value are placed in all ways.
"""

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.gates import And, Expression, Leaf, Or, Xor
from heronry_dg.model import Foreign, Function, Mode, Module, Spec
from heronry_dg.situation import Situation
from heronry_wire.timing import Message, analyse

PAYLOAD_BYTES = {"FLOAT": 4, "SHORT": 2, "UCHAR": 1, "UCHAR3": 3, "NODATA": 0}

Inputs = dict[str, tuple[str, str, int]]  # leaf path -> (producer, variable, version)
Placement = Mapping[str, tuple[str, str]]  # module -> (mode, PE)
Key = tuple[int, ...]  # ten integers as of `Objective.key`: the greater is the better


class TooManyError(Exception):
    """The spec has more configurations than the caller wants to wait for."""


@dataclass
class Structure:
    """Modules with modes and wires, and what levels 1 to 3 make of them."""

    modes: dict[str, Mode]
    inputs: dict[str, Inputs]
    value: Key = ()


@dataclass
class Enumerator:
    """All legal configurations of a spec in a situation."""

    spec: Spec
    now: Situation
    rejected: Counter[str] = field(default_factory=Counter)  # placements refused, by reason

    # Faults: section 5

    @cached_property
    def buses_up(self) -> list[str]:
        """Buses that are up."""

        def dead(bus: str, channels: int) -> bool:
            broken = sum(f"channel:{bus}.{i + 1}" in self.now.down for i in range(channels))
            return f"bus:{bus}" in self.now.down or (channels > 1 and broken == channels)

        return [bus.name for bus in self.spec.buses.values() if not dead(bus.name, bus.channels)]

    @cached_property
    def ways(self) -> dict[tuple[str, str], tuple[str, ...]]:
        """Buses from each PE that is up to each other one, found by trying every chain of buses."""
        alive = [pe for pe in self.spec.pes if f"pe:{pe}" not in self.now.down]
        joints = {  # two buses -> a PE that is up and joins them
            (a, b): any({a, b} <= set(self.spec.pes[pe].buses) for pe in alive)
            for a, b in itertools.permutations(self.buses_up, 2)
        }
        found: dict[tuple[str, str], tuple[str, ...]] = {(pe, pe): () for pe in alive}
        for length in range(1, len(self.buses_up) + 1):
            for chain in itertools.permutations(self.buses_up, length):
                if all(joints[pair] for pair in itertools.pairwise(chain)):
                    for one, other in itertools.permutations(alive, 2):
                        on_chain = chain[0] in self.spec.pes[one].buses and chain[-1] in self.spec.pes[other].buses
                        if on_chain:
                            found.setdefault((one, other), chain)
        return found

    @cached_property
    def pes_up(self) -> list[str]:
        """PEs that are up and can be commanded."""
        bus = self.spec.manager.bus
        doors = [pe for pe in self.spec.pes if bus in self.spec.pes[pe].buses and bus in self.buses_up]
        return [pe for pe in self.spec.pes if any((door, pe) in self.ways for door in doors)]

    @cached_property
    def hosts(self) -> dict[str, list[str]]:
        """PEs that each module may run on now."""
        return {module.name: [pe for pe in self.pes_up if self._may_run(module, pe)] for module in self._modules}

    @property
    def _modules(self) -> Iterable[Module]:
        return self.spec.modules.values()

    def _may_run(self, module: Module, pe: str) -> bool:
        dead = (f"module:{module.name}", f"module:{module.name}@{pe}", f"device:{module.device}")
        if any(element in self.now.down for element in dead):
            return False
        if module.device is not None and self.spec.devices[module.device].pe != pe:
            return False
        allowed = module.runs_on is None or pe in module.runs_on
        return allowed and all(feature in self.spec.pes[pe].features for feature in module.requires)

    # Structures: rules 2 to 6 and 10

    @cached_property
    def outputs(self) -> list[str]:
        """Output modules of the functions that are wanted."""
        wanted = [f for f in self.spec.functions.values() if self._weight(f) > 0]
        return list(dict.fromkeys(name for function in wanted for name in self._serving(function)))

    def _serving(self, function: Function) -> tuple[str, ...]:
        """Modules of which one serves a function: its output, or the ends (else the branches) of its DEMUX."""
        demux = self.spec.demuxes.get(function.output)
        return (function.output,) if demux is None else demux.to or demux.branches

    def _weight(self, function: Function) -> int:
        """Priority of a function: a changed one replaces only one that is above 0 (section 5)."""
        weight = function.priority.get(self.now.phase, function.priority[None])
        return self.now.priorities[function.name] if weight > 0 and function.name in self.now.priorities else weight

    def structures(self) -> Iterator[Structure]:
        """Every structure that is legal but for its placement, each once."""
        choices: list[list[Mode | None]] = [
            [None, *(self.spec.modules[name].modes.values() if self.hosts[name] else ())] for name in self.outputs
        ]
        for picked in itertools.product(*choices):
            modes = {name: mode for name, mode in zip(self.outputs, picked, strict=True) if mode is not None}
            if self._rivals_allow(modes):
                for structure in self._wired(modes, {}):
                    if not self._starts_nowhere(structure):
                        structure.value = self.worth(structure)
                        yield structure

    def _rivals_allow(self, modes: Mapping[str, Mode]) -> bool:
        """Tell whether no DEMUX has two branches or two ends among these modules, and no actuator two drivers."""
        groups = [group for demux in self.spec.demuxes.values() for group in (demux.branches, demux.to)]
        if any(len(modes.keys() & set(group)) > 1 for group in groups):
            return False
        driven = [self.spec.modules[name].device for name in modes]
        return all(driven.count(device.name) < 2 for device in self.spec.devices.values() if device.kind == "actuator")

    def _wired(self, modes: dict[str, Mode], inputs: dict[str, Inputs]) -> Iterator[Structure]:
        unwired = next((name for name in modes if name not in inputs), None)
        if unwired is None:
            yield Structure(modes, inputs)
            return
        leaf_of = dict(modes[unwired].leaves())
        for paths in ways_to_hold(modes[unwired].needs):
            for more_modes, wires in self._fed(modes, sorted(paths), leaf_of):
                yield from self._wired(more_modes, {**inputs, unwired: wires})

    def _fed(
        self, modes: dict[str, Mode], paths: list[str], leaf_of: Mapping[str, Leaf]
    ) -> Iterator[tuple[dict[str, Mode], Inputs]]:
        """Every way to feed these leaves, with the modules that then run too."""
        if not paths:
            yield modes, {}
            return
        first, *rest = paths
        leaf = leaf_of[first]
        if leaf.only_in is not None and self.now.phase is not None and self.now.phase not in leaf.only_in:
            return
        for producer in self._modules:
            for mode in producer.modes.values():
                version = mode.gives.get(leaf.variable, 0)
                if not leaf.best <= version <= leaf.worst or not self._may_join(modes, producer.name, mode):
                    continue
                for more_modes, wires in self._fed({**modes, producer.name: mode}, rest, leaf_of):
                    yield more_modes, {first: (producer.name, leaf.variable, version), **wires}

    def _may_join(self, modes: Mapping[str, Mode], name: str, mode: Mode) -> bool:
        if name in modes:
            return modes[name] is mode
        if name in self.outputs or not self.hosts[name]:
            return False  # an output that was chosen not to run, or a module with no place
        return self._rivals_allow({**modes, name: mode})

    def _starts_nowhere(self, structure: Structure) -> bool:
        """Tell whether some module waits, through variables without an initial value, for itself."""
        waits = {
            (consumer, producer)
            for consumer, wires in structure.inputs.items()
            for producer, variable, _ in wires.values()
            if self.spec.variables[variable].initial is None
        }
        size = -1
        while len(waits) != size:  # transitive closure
            size = len(waits)
            waits |= {(a, d) for a, b in waits for c, d in waits if b == c}
        return any(a == b for a, b in waits)

    def worth(self, structure: Structure) -> Key:
        """Levels 1 to 3."""
        totals, utility = Counter[str](), 0
        for function in self.spec.functions.values():
            for name in self._serving(function):
                if name in structure.modes:
                    modes = list(self.spec.modules[name].modes)
                    index, count = modes.index(structure.modes[name].name), len(modes)
                    value = function.value[index] if function.value else 100 * (count - index) // count
                    weight = self._weight(function)
                    totals[function.criticality.get(self.now.phase, function.criticality[None])] += weight
                    utility += weight * value
        points = 0
        for name, wires in structure.inputs.items():
            leaf_of = dict(structure.modes[name].leaves())
            points += sum(leaf_of[path].worth[version - leaf_of[path].best] for path, (_, _, version) in wires.items())
        return (*(totals[criticality] for criticality in "ABCD"), utility, points)

    # Placements: rules 1 and 7 to 9

    def placements(self, structure: Structure) -> Iterator[dict[str, str]]:
        """Every legal way to put a structure on PEs."""
        yield from self._placed(structure, {}, list(structure.modes))

    def _placed(self, structure: Structure, places: dict[str, str], rest: list[str]) -> Iterator[dict[str, str]]:
        if not rest:
            refusal = self._refused_by_buses(structure, places)
            self.rejected[refusal] += 1
            if not refusal:
                yield places
            return
        for pe in self.hosts[rest[0]]:
            more = {**places, rest[0]: pe}
            refusal = self._refused_by_pe(structure, more, pe) or self._refused_by_groups(more)
            self.rejected[refusal] += 1
            if not refusal:
                yield from self._placed(structure, more, rest[1:])

    def _refused_by_pe(self, structure: Structure, places: Mapping[str, str], pe: str) -> str:
        here = [name for name, place in places.items() if place == pe]
        element = self.spec.pes[pe]
        share = self.now.limits.get(f"pe:{pe}", Fraction(1))
        if sum(structure.modes[name].cpu_millis for name in here) > element.cpu_millis * share:
            return "cpu"
        if sum(structure.modes[name].ram for name in here) > element.ram:
            return "ram"
        return "flash" if sum(self.spec.modules[name].flash for name in here) > element.flash else ""

    def _refused_by_groups(self, places: Mapping[str, str]) -> str:
        for group in self.spec.separate:
            taken = [places[name] for name in group if name in places]
            if len(set(taken)) < len(taken):
                return "separate"
        for group in self.spec.together:
            if len({places[name] for name in group if name in places}) > 1:
                return "together"
        return ""

    def published(self, structure: Structure, places: Mapping[str, str]) -> dict[tuple[str, str], set[tuple[str, ...]]]:
        """For each source, the ways from its producer that its data take: every beginning of every route."""
        ways: dict[tuple[str, str], set[tuple[str, ...]]] = {}
        for consumer, wires in structure.inputs.items():
            for producer, variable, _ in wires.values():
                route = self.ways[places[producer], places[consumer]]
                beginnings = {route[: n + 1] for n in range(len(route))}
                if beginnings:
                    ways.setdefault((producer, variable), set()).update(beginnings)
        return ways

    def _refused_by_buses(self, structure: Structure, places: Mapping[str, str]) -> str:
        ways = self.published(structure, places)
        loads = Counter(self._loads(structure, ways))
        loads.update(self._checkpoints(places))
        for bus, load in loads.items():
            element = self.spec.buses[bus]
            share = self.now.limits.get(f"bus:{bus}", Fraction(1))
            foreign = sum(Fraction(10**9 * self._foreign_bits(one), one.period_ns) for one in element.foreign)
            if load and Fraction(load, 1000) + foreign > element.bitrate * (element.max_load - element.reserve) * share:
                return "bus"
        return "" if self._in_time(structure, ways) else "deadline"

    def _loads(self, structure: Structure, ways: Mapping[tuple[str, str], set[tuple[str, ...]]]) -> dict[str, int]:
        """Thousandths of a bit/s on each bus."""
        loads: Counter[str] = Counter()
        for (producer, variable), beginnings in ways.items():
            for beginning in beginnings:
                loads[beginning[-1]] += self._bits(variable) * structure.modes[producer].rate_mhz
        return loads

    def _checkpoints(self, places: Mapping[str, str]) -> Counter[str]:
        """Thousandths of a bit/s that checkpoints take, by rule 7: each on every wired bus towards another home."""
        loads: Counter[str] = Counter()
        for name, pe in places.items():
            module = self.spec.modules[name]
            if module.checkpoint is None:
                continue
            frames = 1 + sum(1 for _ in range(0, module.checkpoint.data_bytes, 5))
            towards = {bus for other in self._homes(name) if other != pe for bus in self.ways.get((pe, other), ())}
            for bus in towards:
                if self.spec.buses[bus].kind == "wired":
                    loads[bus] += frames * 135 * module.checkpoint.rate_mhz
        return loads

    def _homes(self, name: str) -> list[str]:
        """Every PE that could ever carry a module."""
        module = self.spec.modules[name]
        bolted = None if module.device is None else self.spec.devices[module.device].pe
        return [
            pe.name
            for pe in self.spec.pes.values()
            if bolted in (None, pe.name)
            and (module.runs_on is None or pe.name in module.runs_on)
            and not module.requires - pe.features
        ]

    def _bits(self, variable: str) -> int:
        return 55 + 10 * (4 + PAYLOAD_BYTES[self.spec.variables[variable].type])

    def _in_time(self, structure: Structure, ways: Mapping[tuple[str, str], set[tuple[str, ...]]]) -> bool:
        """Response times source by source, most urgent first: its rivals' jitters are then known on every bus."""
        above = {bus.name: [self._overhead(bus.name)] * self._overheads(bus.name) for bus in self.spec.buses.values()}
        blocking = {b.name: 160 if any(f.extended for f in b.foreign) else 135 for b in self.spec.buses.values()}
        for source in sorted(ways, key=self.urgency.index):
            arrived: dict[tuple[str, ...], Fraction] = {(): Fraction(0)}  # seconds after it was due
            for way in sorted(ways[source], key=len):
                bus = self.spec.buses[way[-1]]
                if bus.kind == "wireless":
                    arrived[way] = arrived[way[:-1]]
                    continue
                period = Fraction(1000, structure.modes[source[0]].rate_mhz)
                given = self.spec.variables[source[1]].deadline_ns
                deadline = period if given is None else Fraction(given, 10**9)
                times = (period * bus.bitrate, arrived[way[:-1]] * bus.bitrate, deadline * bus.bitrate)
                message = Message("/".join(source), self._bits(source[1]), *times)
                others = [self._foreign_message(bus.name, f) for f in bus.foreign if self._goes_first(f, source)]
                response = analyse([*above[bus.name], *others, message], blocking_bits=blocking[bus.name])[-1]
                if response.bits is None or response.bits > deadline * bus.bitrate:
                    return False
                above[bus.name] = [*above[bus.name], message]
                arrived[way] = response.bits / bus.bitrate
        return True

    def _foreign_bits(self, foreign: Foreign) -> int:
        return (80 if foreign.extended else 55) + 10 * foreign.data_bytes

    def _foreign_message(self, bus: str, foreign: Foreign) -> Message:
        period = Fraction(foreign.period_ns, 10**9) * self.spec.buses[bus].bitrate
        return Message("foreign", self._foreign_bits(foreign), period, 0, period)

    def _goes_first(self, foreign: Foreign, source: tuple[str, str]) -> bool:
        """Compare the bits on the wire: after the first 11 bits a 29-bit frame goes on with a recessive one."""
        number = self.numbers[source]
        mine = f"{number:011b}0"
        if foreign.extended:
            whole = f"{foreign.first:029b}"
            return f"{whole[:11]}1" < mine
        return f"{foreign.first:011b}0" <= mine

    @cached_property
    def numbers(self) -> dict[tuple[str, str], int]:
        """The identifier of every source: the standard ones, and the allocated ones in their order."""
        free = [*range(1536, 1628), *range(1664, 1793)]
        rest = [source for source in self.urgency if source not in self.standard]
        return {**self.standard, **dict(zip(rest, free, strict=False))}

    def _overhead(self, bus: str) -> Message:
        period = Fraction(self.spec.buses[bus].heartbeat_ns, 10**9) * self.spec.buses[bus].bitrate
        return Message("overhead", 135, period, 0, period)

    def _overheads(self, bus: str) -> int:
        return 2 + sum(bus in pe.buses for pe in self.spec.pes.values())

    @cached_property
    def firsts(self) -> dict[tuple[str, str], Mode]:
        """For every source the first listed mode that gives the variable."""
        firsts = {}
        for module in self._modules:
            for mode in reversed(list(module.modes.values())):
                firsts.update({(module.name, variable): mode for variable in mode.gives})
        return firsts

    @cached_property
    def standard(self) -> dict[tuple[str, str], int]:
        """The sources that have the standard identifier of their variable."""
        firsts, order = self.firsts, {module.name: i for i, module in enumerate(self._modules)}
        standard: dict[tuple[str, str], int] = {}
        for variable in self.spec.variables.values():
            givers = [source for source in firsts if source[1] == variable.name]
            if variable.identifier is not None and givers:
                best = min(givers, key=lambda s: (firsts[s].gives[s[1]], order[s[0]]))
                standard[best] = variable.identifier
        return standard

    @cached_property
    def urgency(self) -> list[tuple[str, str]]:
        """Every source by its identifier (the design's rule for identifiers), smallest first."""
        firsts, standard, order = self.firsts, self.standard, {module.name: i for i, module in enumerate(self._modules)}

        def rank(source: tuple[str, str]) -> tuple[int, int, int, int]:
            rates = [m.rate_mhz for m in self.spec.modules[source[0]].modes.values() if source[1] in m.gives]
            within = list(dict.fromkeys(v for m in self.spec.modules[source[0]].modes.values() for v in m.gives))
            return self._best_class(source[0]), -max(rates), order[source[0]], within.index(source[1])

        allocated = sorted(firsts.keys() - standard.keys(), key=rank)
        return [*sorted(standard, key=standard.__getitem__), *allocated]

    def _best_class(self, module: str) -> int:
        """Best class, 0 for A, of what a module could contribute to, by following its data forwards."""
        reached = {module}
        while True:
            more = {
                consumer.name
                for consumer in self._modules
                for mode in consumer.modes.values()
                for _, leaf in mode.leaves()
                for name in reached
                for giving in self.spec.modules[name].modes.values()
                if leaf.best <= giving.gives.get(leaf.variable, 0) <= leaf.worst
            }
            if more <= reached:
                break
            reached |= more
        classes = [
            "ABCDE".index(function.criticality.get(phase, function.criticality[None]))
            for phase in self.spec.phases or [None]
            for function in self.spec.functions.values()
            if reached & set(self._serving(function)) and function.priority.get(phase, function.priority[None]) > 0
        ]
        return min(classes, default=4)

    # The whole

    def key(
        self, structure: Structure, places: Mapping[str, str], running: Mapping[str, tuple[str, str]] | None
    ) -> Key:
        """All seven levels of a configuration, the greater the better."""
        after = {name: (structure.modes[name].name, pe) for name, pe in places.items()}
        changed = 0 if running is None else sum(after.get(n) != running.get(n) for n in {*after, *running})
        positions = [
            index
            for demux in self.spec.demuxes.values()
            for index, end in enumerate(demux.to or demux.branches)
            if end in structure.modes
        ]
        millibits = sum(self._loads(structure, self.published(structure, places)).values())
        cpu = sum(mode.cpu_millis for mode in structure.modes.values())
        return (*structure.value, -changed, -sum(positions), -millibits, -cpu)

    def best(self, running: Placement | None = None, *, most: int = 200_000) -> tuple[Key, Configuration]:
        """Find the best objective and one configuration that has it; raises TooManyError past `most` structures."""
        structures = list(itertools.islice(self.structures(), most + 1))
        if len(structures) > most:
            raise TooManyError
        structures.sort(key=lambda structure: structure.value, reverse=True)
        for _, equals in itertools.groupby(structures, key=lambda structure: structure.value):
            found = [
                (self.key(structure, places, running), structure, places)
                for structure in equals
                for places in self.placements(structure)
            ]
            if found:
                key, structure, places = max(found, key=lambda one: one[0])
                return key, self.configuration(structure, places)
        raise AssertionError("nothing at all is always legal")

    def every(self, *, most: int) -> Iterator[tuple[Configuration, Structure, dict[str, str]]]:
        """Every legal configuration; raises TooManyError past `most` of them."""
        count = 0
        for structure in self.structures():
            for places in self.placements(structure):
                count += 1
                if count > most:
                    raise TooManyError
                yield self.configuration(structure, places), structure, places

    def configuration(self, structure: Structure, places: Mapping[str, str]) -> Configuration:
        """Put it into the product's words."""
        return Configuration(
            {
                name: Running(pe, structure.modes[name].name, {p: Wire(*w) for p, w in structure.inputs[name].items()})
                for name, pe in places.items()
            }
        )


def ways_to_hold(needs: Expression | None, path: str = "") -> list[frozenset[str]]:
    """Every set of wired leaves below `path` with which the expression holds and semantics rule 3 is kept."""
    if needs is None:
        return [frozenset()]
    if isinstance(needs, Leaf):
        return [frozenset({path})]
    options: list[list[tuple[int, frozenset[str]]]] = []
    for index, child in enumerate(needs.inputs):
        held = [(1, paths) for paths in ways_to_hold(child, f"{path}.{index}" if path else str(index))]
        vacuous = (1, frozenset[str]()) in held
        options.append(held if vacuous else [(0, frozenset()), *held])
    if isinstance(needs, And):
        wanted = range(len(options), len(options) + 1)
    elif isinstance(needs, Or):
        wanted = range(needs.k, len(options) + 1)
    else:
        assert isinstance(needs, Xor)
        wanted = range(1, 2)
    return list(
        dict.fromkeys(
            frozenset().union(*(paths for _, paths in picked))
            for picked in itertools.product(*options)
            if sum(held for held, _ in picked) in wanted
        )
    )
