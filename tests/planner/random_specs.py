"""Small random specs with every kind of element: test cases of planner, verifier and enumerator.

`random_case` draws from a `random.Random`, a seeded one or Hypothesis's (`st.randoms`). Every spec meets the conditions
that a loaded spec meets (`model`). Capacities, bit rates and deadlines are drawn so that they often bind. `features`
names what a case contains, so that a test can check that every feature occurs.
"""

import itertools
import random
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import get_args

from heronry_dg.field_types import Criticality
from heronry_dg.gates import And, Expression, Leaf, Or, Xor, holds, leaves, with_leaves
from heronry_dg.model import (
    Bus,
    Checkpoint,
    Demux,
    Device,
    Foreign,
    Function,
    Manager,
    Mode,
    Module,
    Pe,
    Phase,
    Spec,
    Variable,
)
from heronry_dg.situation import Situation

CLASSES: tuple[Criticality, ...] = get_args(Criticality)
TYPES = ("FLOAT", "FLOAT", "UCHAR", "SHORT", "UCHAR3", "NODATA")


@dataclass(frozen=True)
class Case:
    """A spec, a situation, and what runs (None: nothing is known to)."""

    spec: Spec
    now: Situation
    running: dict[str, tuple[str, str]] | None


def random_case(rng: random.Random, *, modules: int = 7) -> Case:
    """Draw a spec of 3 to `modules` modules, a situation, and a running placement."""
    return with_phase_inputs_and_priorities(rng, plain_case(rng, modules=modules))


def plain_case(rng: random.Random, *, modules: int = 7) -> Case:
    """Draw a case in which every input is open in every phase, and no priority is changed."""
    spec = with_foreign_frames(rng, with_shared_actuator(rng, random_spec(rng, modules=modules)))
    return Case(spec, random_situation(rng, spec), random_running(rng, spec))


def with_phase_inputs_and_priorities(rng: random.Random, case: Case) -> Case:
    """Let some inputs be open in some phases only, and change some priorities."""
    spec = with_phase_inputs(rng, case.spec)
    return Case(spec, replace(case.now, priorities=random_priorities(rng, spec)), case.running)


def with_checkpoints(rng: random.Random, case: Case) -> Case:
    """Let about half of the modules have their state kept; a short one at a low rate, or one that fills a bus."""
    kept = {
        name: replace(
            module,
            checkpoint=Checkpoint(rng.choice((1, 5, 6, 40, 200)), rng.choice((1000, 2500, 20_000)), 1_000_000_000)
            if rng.random() < 0.5
            else None,
        )
        for name, module in case.spec.modules.items()
    }
    return replace(case, spec=replace(case.spec, modules=kept))


def random_spec(rng: random.Random, *, modules: int = 7) -> Spec:
    """Draw a spec of 3 to `modules` modules."""
    buses = _buses(rng)
    pes = _pes(rng, list(buses))
    devices = {f"d{i}": Device(f"d{i}", rng.choice(("sensor", "actuator")), rng.choice(list(pes))) for i in range(2)}
    variables = _variables(rng)
    count = rng.randint(3, modules)
    demux = _demux(rng, variables, count)
    draw = _ModuleDrawer(rng, count, variables, list(pes), list(devices), demux)
    drawn = [draw.module(index) for index in range(count)]
    drawn_modules = {module.name: module for module in drawn}
    phases = {f"f{i}": Phase(f"f{i}") for i in range(rng.choice((0, 0, 1, 2)))}
    demuxes = {demux.name: demux} if demux else {}
    spec = Spec(
        name="random",
        digest="0" * 64,
        buses=buses,
        manager=Manager(rng.choice([b.name for b in buses.values() if b.kind == "wired"])),
        pes=pes,
        devices=devices,
        variables=_broken_cycles(rng, drawn_modules, variables),
        demuxes=demuxes,
        shorthands={},
        modules=drawn_modules,
        functions=dict(_functions(rng, drawn_modules, demuxes, list(phases))),
        phases=phases,
        separate=_groups(rng, list(drawn_modules)),
        together=_groups(rng, list(drawn_modules)),
    )
    return with_paths(rng, spec) if demux and rng.random() < 0.85 else spec


def with_shared_actuator(rng: random.Random, spec: Spec) -> Spec:
    """Let several modules sometimes drive one actuator, some of them as outputs of functions; else give the same spec.

    Only one of these modules may run (semantics rule 10).
    """
    if rng.random() < 0.6:
        return spec
    actuator = Device("servo", "actuator", rng.choice(list(spec.pes)))
    count = min(rng.choice((2, 2, 3)), len(spec.modules))
    drivers = rng.sample(list(spec.modules), count)
    modules = {
        name: replace(module, device="servo", runs_on=None, requires=frozenset()) if name in drivers else module
        for name, module in spec.modules.items()
    }
    changed = replace(spec, devices={**spec.devices, "servo": actuator}, modules=modules)
    for demux in changed.demuxes.values():
        if demux.to and not _each_end_belongs_to_its_branch(changed, demux, _ends_by_branch(spec, demux)):
            return spec
    functions = {
        name: _with_output(function, rng.choice(drivers)) if rng.random() < 0.5 else function
        for name, function in spec.functions.items()
        if function.output not in spec.demuxes or rng.random() < 0.7
    }
    return replace(changed, functions=functions or spec.functions)


def _with_output(function: Function, output: str) -> Function:
    return replace(function, output=output, outputs=(output,), value=None)


def _ends_by_branch(spec: Spec, demux: Demux) -> list[str]:
    """Sort the ends of a DEMUX by the branch to which they belong."""
    return [
        next(end for end in demux.to if end in can_run(spec, ()) and end not in can_run(spec, (branch,)))
        for branch in demux.branches
    ]


def with_paths(rng: random.Random, spec: Spec) -> Spec:
    """Let each branch of the DEMUX begin a path of one to three modules, and name the ends; else give the same spec.

    Between two modules of a path is a variable of its own. Sometimes a monitor reads what the first modules give, so
    that a branch may run without its end.
    """
    (demux,) = spec.demuxes.values()
    modules, variables, ends = dict(spec.modules), dict(spec.variables), []
    for branch in demux.branches:
        last = branch
        for step in range(1, rng.choice((1, 2, 2, 3, 3))):
            between = f"{branch}_{step}"
            variables[between] = Variable(between, type=rng.choice(TYPES))
            modules[last] = _giving(rng, modules[last], between)
            last = f"{branch}p{step}"
            modules[last] = _reading(rng, spec, last, between)
        ends.append(last)
    firsts = [f"{branch}_1" for branch in demux.branches if f"{branch}_1" in variables]
    if firsts and rng.random() < 0.4:
        modules["monitor"] = _watching(rng, firsts)
    demux = replace(demux, to=tuple(rng.sample(ends, len(ends))))
    changed = replace(spec, modules=modules, variables=variables, demuxes={demux.name: demux})
    if not _each_end_belongs_to_its_branch(changed, demux, ends):
        return spec
    monitored = list(modules)[-1] if "monitor" in modules else None
    return replace(
        changed,
        functions={name: _served_by(rng, modules, demux, f, monitored) for name, f in spec.functions.items()},
    )


def _giving(rng: random.Random, module: Module, variable: str) -> Module:
    """Let some modes of a module, or all, give a variable as well."""
    chosen = rng.sample(list(module.modes), rng.randint(1, len(module.modes)))
    modes = {
        name: replace(mode, gives={**mode.gives, variable: 1}) if name in chosen else mode
        for name, mode in module.modes.items()
    }
    return replace(module, modes=modes)


def _reading(rng: random.Random, spec: Spec, name: str, variable: str) -> Module:
    """Draw a module of a path: in each mode it must have the variable, and may take one of the others."""
    modes = {}
    for mode in [f"o{i}" for i in range(rng.choice((1, 1, 2)))]:
        needs: Expression = Leaf(variable, 1, 1, (0,))
        if rng.random() < 0.3:
            other = Leaf(rng.choice(list(spec.variables)), 1, 1, (rng.randint(0, 3),))
            needs = And((needs, Or(rng.randint(0, 1), (other,))))
        modes[mode] = _small_mode(rng, mode, needs)
    return Module(name, image=name, modes=modes, runs_on=(rng.choice(list(spec.pes)),) if rng.random() < 0.4 else None)


def _watching(rng: random.Random, variables: list[str]) -> Module:
    leaves = tuple(Leaf(variable, 1, 1, (1,)) for variable in variables)
    gate = Xor(leaves) if len(leaves) > 1 and rng.random() < 0.3 else Or(rng.randint(0, 1), leaves)
    return Module("monitor", image="monitor", modes={"only": _small_mode(rng, "only", gate)})


def _small_mode(rng: random.Random, name: str, needs: Expression) -> Mode:
    rate_mhz = rng.choice((1_000, 10_000, 33_333))
    return Mode(name, needs, {}, rng.choice((5, 20, 60)), rng.choice((5, 30)), rate_mhz)


def _served_by(
    rng: random.Random, modules: dict[str, Module], demux: Demux, function: Function, monitor: str | None
) -> Function:
    """Let a function of the DEMUX be served by its ends, and another one sometimes by the monitor."""
    if function.output != demux.name:
        if monitor is None or rng.random() < 0.4:
            return function
        return replace(function, output=monitor, outputs=(monitor,), value=None)
    most = max(len(modules[end].modes) for end in demux.to)
    values = None if function.value is None else tuple(rng.randint(0, 100) for _ in range(most))
    return replace(function, outputs=demux.to, value=values)


def _each_end_belongs_to_its_branch(spec: Spec, demux: Demux, ends: list[str]) -> bool:
    """Tell whether each end can run, and cannot without its branch, and can without each other one."""
    for branch, end in zip(demux.branches, ends, strict=True):
        others = [other for other in demux.branches if other != branch]
        alike = [end in can_run(spec, without) for without in ((), *((other,) for other in others))]
        if not all(alike) or end in can_run(spec, (branch,)):
            return False
    return True


def can_run(spec: Spec, failed: Iterable[str]) -> set[str]:
    """Modules that could run with every element up and no limit: the greatest set, found by removing one by one."""
    kept = {
        (module.name, name): mode
        for module in spec.modules.values()
        for name, mode in module.modes.items()
        if module.name not in failed and any(_allows(spec, module, pe) for pe in spec.pes.values())
    }
    while True:
        given = {datum for mode in kept.values() for datum in mode.gives.items()}
        lost = [key for key, mode in kept.items() if mode.needs is not None and not _could_hold(mode.needs, given)]
        if not lost:
            return {module for module, _ in kept}
        kept = {key: mode for key, mode in kept.items() if key not in lost}


def _allows(spec: Spec, module: Module, pe: Pe) -> bool:
    at_home = module.device is None or spec.devices[module.device].pe == pe.name
    return at_home and (module.runs_on is None or pe.name in module.runs_on) and module.requires <= pe.features


def _could_hold(needs: Expression, given: set[tuple[str, int]]) -> bool:
    if isinstance(needs, Leaf):
        return any((needs.variable, version) in given for version in range(needs.best, needs.worst + 1))
    held = sum(_could_hold(one, given) for one in needs.inputs)
    if isinstance(needs, And):
        return held == len(needs.inputs)
    return held >= (needs.k if isinstance(needs, Or) else 1)


def _buses(rng: random.Random) -> dict[str, Bus]:
    buses = {}
    for i in range(rng.choice((1, 2, 2, 3))):
        buses[f"b{i}"] = Bus(
            f"b{i}",
            bitrate=rng.choice((20_000, 50_000, 83_333, 125_000, 1_000_000)),
            max_load=rng.choice((Fraction(8, 10), Fraction(1, 2), Fraction(1, 3))),
            kind="wireless" if i and rng.random() < 0.3 else "wired",
            channels=rng.choice((1, 1, 1, 2)),
            heartbeat_ns=rng.choice((50, 100, 200)) * 1_000_000,
        )
    return buses


def with_foreign_frames(rng: random.Random, spec: Spec) -> Spec:
    """Let other equipment send on some buses, above and below the data."""
    if rng.random() < 0.7:
        return spec
    buses = {
        name: replace(bus, foreign=tuple(_foreign(rng) for _ in range(rng.randint(1, 3))))
        if rng.random() < 0.7
        else bus
        for name, bus in spec.buses.items()
    }
    return replace(spec, buses=buses)


def _foreign(rng: random.Random) -> Foreign:
    extended = rng.random() < 0.6
    first = rng.choice((100, 305, 320, 1540, 1900)) << (18 if extended else 0)
    period_ns = rng.choice((2, 5, 10, 20, 100)) * 1_000_000
    return Foreign(None, (first, first + rng.choice((0, 5))), extended, rng.randint(0, 8), period_ns)


def _pes(rng: random.Random, buses: list[str]) -> dict[str, Pe]:
    """Draw PEs on a tree of buses: a gateway joins two neighbours, and sometimes it is missing."""
    places: list[tuple[str, ...]] = [(buses[0],), (buses[0],), (rng.choice(buses),)]
    for near, far in itertools.pairwise(buses):
        if rng.random() < 0.9:
            places[buses.index(near)] = (near, far)
    if len(buses) > 2:
        places[2] = (buses[2],)
    elif len(buses) > 1:
        places[1] = (buses[1],)
    pes = {}
    for i, on in enumerate(places[: max(2, rng.randint(len(buses), 3))]):
        pes[f"p{i}"] = Pe(
            f"p{i}",
            node_id=92 + i,
            buses=on,
            cpu_millis=rng.choice((100, 200, 350, 600)),
            ram=rng.choice((100, 200, 400)),
            flash=rng.choice((100, 200, 400)),
            features=frozenset(rng.sample(("fpu", "camera"), rng.choice((0, 1, 2, 2)))),
        )
    return pes


def _variables(rng: random.Random) -> dict[str, Variable]:
    standard = rng.sample(range(300, 310), 10)
    variables = {}
    for i in range(rng.randint(2, 4)):
        variables[f"v{i}"] = Variable(
            f"v{i}",
            type=rng.choice(TYPES),
            versions=rng.choice((1, 1, 2, 3)),
            identifier=standard.pop() if rng.random() < 0.4 else None,
            initial=0 if rng.random() < 0.15 else None,
            deadline_ns=rng.choice((3, 5, 10, 20, 50, 200)) * 1_000_000 if rng.random() < 0.4 else None,
        )
    return variables


def _demux(rng: random.Random, variables: dict[str, Variable], modules: int) -> Demux | None:
    """Draw a DEMUX with two branches; in front of it is a variable, or an expression that does not hold unwired."""
    if modules < 3 or rng.random() < 0.5:
        return None
    branches = sorted(rng.sample(range(modules), 2))
    versions = _Versions(variables, variables)
    needs: Expression | None = None
    if rng.random() < 0.5:
        needs = _expression(rng, versions, rng.choice((0, 1)))
    if needs is None or holds(needs, frozenset()):
        versions = _Versions(variables, variables)
        needs = versions.take(rng, rng.choice(list(variables)), whole=True)
    worthy = _with_worth(rng, needs, variables)
    assert worthy is not None
    tagged = with_leaves(worthy, lambda leaf: replace(leaf, demux="x0"))
    variable = next(leaf.variable for _, leaf in leaves(tagged))
    return Demux("x0", variable, tuple(f"m{i}" for i in branches), tagged)


@dataclass(frozen=True)
class _ModuleDrawer:
    rng: random.Random
    count: int
    variables: dict[str, Variable]
    pes: list[str]
    devices: list[str]
    demux: Demux | None

    def module(self, index: int) -> Module:
        """Draw module number `index`."""
        rng, name = self.rng, f"m{index}"
        drawn = [self._mode(f"o{i}", index) for i in range(rng.choice((1, 1, 2, 3)))]
        return Module(
            name,
            image=name,
            modes={mode.name: mode for mode in drawn},
            device=rng.choice(self.devices) if rng.random() < 0.25 else None,
            runs_on=tuple(rng.sample(self.pes, rng.randint(1, len(self.pes)))) if rng.random() < 0.2 else None,
            requires=frozenset({rng.choice(("fpu", "camera"))}) if rng.random() < 0.1 else frozenset(),
            flash=rng.choice((0, 20, 60, 120)),
        )

    def _mode(self, name: str, index: int) -> Mode:
        """Draw a mode: early modules are sources, late ones read early variables and give late ones, mostly."""
        rng, names = self.rng, list(self.variables)
        pivot = max(1, index * len(names) // self.count)
        always = names[index % len(names)]  # so that most variables have a producer
        early = index < (self.count + 1) // 2
        loose = rng.random() < 0.15
        readable = names if loose else names[:pivot]
        needs = None if early and rng.random() < 0.75 else _needs(rng, self.variables, readable)
        if self.demux and f"m{index}" in self.demux.branches:
            needs = _demuxed(rng, self.variables, self.demux)
        return Mode(
            name,
            needs=needs,
            gives=_gives(
                rng, self.variables, [always] if early else [], names if needs is None or loose else names[pivot:]
            ),
            cpu_millis=rng.choice((10, 40, 60, 90, 150)),
            ram=rng.choice((10, 50, 120)),
            rate_mhz=rng.choice((1_000, 10_000, 12_500, 33_333, 50_000, 100_000)),
        )


def _gives(rng: random.Random, variables: dict[str, Variable], always: list[str], names: list[str]) -> dict[str, int]:
    more = rng.sample(names, min(rng.choice((0, 0, 1) if always else (0, 1, 1, 1)), len(names)))
    return {name: rng.randint(1, variables[name].versions) for name in dict.fromkeys([*always, *more])}


class _Versions:
    """What the leaves of one mode may still take: no version of a variable is taken by two of them."""

    def __init__(self, variables: dict[str, Variable], names: Iterable[str]) -> None:
        self.left = {(name, v) for name in names for v in range(1, variables[name].versions + 1)}

    def take(self, rng: random.Random, name: str, *, whole: bool = False) -> Leaf:
        """Draw a leaf over versions that are free."""
        free = sorted(v for n, v in self.left if n == name)
        best = free[0] if whole else rng.choice(free)
        worst = best
        while worst + 1 in free and (whole or rng.random() < 0.6):
            worst += 1
        self.left -= {(name, v) for v in range(best, worst + 1)}
        return Leaf(name, best, worst, worth=(0,) * (worst - best + 1))

    def names(self) -> list[str]:
        """Variables of which some version is free."""
        return sorted({name for name, _ in self.left})


def _needs(rng: random.Random, variables: dict[str, Variable], readable: list[str]) -> Expression | None:
    versions = _Versions(variables, readable)
    return _with_worth(rng, _expression(rng, versions, 0), variables)


def _demuxed(rng: random.Random, variables: dict[str, Variable], demux: Demux) -> Expression:
    versions, needs = _Versions(variables, variables), demux.needs
    for _, leaf in leaves(needs):
        versions.left -= {(leaf.variable, version) for version in range(leaf.best, leaf.worst + 1)}
    if rng.random() < 0.4:
        other = _with_worth(rng, _expression(rng, versions, 1), variables)
        needs = And((needs, other)) if other is not None else And((needs,))
    return And((needs,)) if rng.random() < 0.2 else needs


def _expression(rng: random.Random, versions: _Versions, depth: int) -> Expression | None:
    """Draw an expression, or None when no version of any variable is left."""
    if not versions.names():
        return None
    kind = rng.choice(("leaf", "leaf", "and", "or", "or", "xor") if depth < 2 else ("leaf",))
    if kind == "leaf":
        return versions.take(rng, rng.choice(versions.names()), whole=rng.random() < 0.65)
    drawn = [_expression(rng, versions, depth + 1) for _ in range(rng.randint(2 if kind == "xor" else 1, 3))]
    inputs = tuple(one for one in drawn if one is not None)
    if kind == "and":
        return And(inputs)
    if kind == "xor":
        inputs = tuple(one for one in inputs if not holds(one, frozenset()))
        return Xor(inputs) if len(inputs) > 1 else (inputs[0] if inputs else None)
    return Or(rng.randint(0, len(inputs)), inputs) if inputs else None


def _with_worth(
    rng: random.Random, needs: Expression | None, variables: dict[str, Variable], *, chosen: bool = False
) -> Expression | None:
    """Return the leaves their default worth, and some of them one of their own."""
    if needs is None:
        return None
    if isinstance(needs, Leaf):
        versions = range(needs.best, needs.worst + 1)
        most = variables[needs.variable].versions
        counts = chosen or len(versions) > 1
        worth = tuple(most - version + 1 if counts else 0 for version in versions)
        if rng.random() < 0.2:
            worth = tuple(rng.randint(0, 9) for _ in versions)
        return replace(needs, worth=worth)
    below = chosen or not isinstance(needs, And)
    drawn = [_with_worth(rng, one, variables, chosen=below) for one in needs.inputs]
    return replace(needs, inputs=tuple(one for one in drawn if one is not None))


def _functions(
    rng: random.Random, modules: dict[str, Module], demuxes: dict[str, Demux], phases: list[str]
) -> Iterator[tuple[str, Function]]:
    for i in range(rng.randint(1, 4)):
        name = f"g{i}"
        demux = rng.choice(list(demuxes.values())) if demuxes and rng.random() < 0.6 else None
        outputs = demux.branches if demux else (rng.choice(list(modules)[-4:]),)
        most = max(len(modules[output].modes) for output in outputs)
        criticality: dict[str | None, Criticality] = {None: rng.choice(CLASSES)}
        priority: dict[str | None, int] = {None: rng.choice((0, 1, 1, 1, 2, 2, 3, 5))}
        for phase in phases:
            if rng.random() < 0.5:
                criticality[phase] = rng.choice(CLASSES)
            if rng.random() < 0.5:
                priority[phase] = rng.choice((0, 1, 3))
        yield (
            name,
            Function(
                name,
                output=demux.name if demux else outputs[0],
                outputs=outputs,
                criticality=criticality,
                priority=priority,
                value=tuple(rng.randint(0, 100) for _ in range(most)) if rng.random() < 0.3 else None,
            ),
        )


def _groups(rng: random.Random, modules: list[str]) -> tuple[tuple[str, ...], ...]:
    if rng.random() < 0.75:
        return ()
    return (tuple(rng.sample(modules, rng.randint(2, min(3, len(modules))))),)


def _broken_cycles(
    rng: random.Random, modules: dict[str, Module], variables: dict[str, Variable]
) -> dict[str, Variable]:
    """Return initial values until no cycle is possible without one."""
    variables = dict(variables)
    while ring := _variables_on_cycles(modules, variables):
        name = rng.choice(sorted(ring))
        variables[name] = replace(variables[name], initial=0)
    return variables


def _variables_on_cycles(modules: dict[str, Module], variables: dict[str, Variable]) -> set[str]:
    edges = {
        (consumer, producer, leaf.variable)
        for consumer, module in modules.items()
        for mode in module.modes.values()
        for _, leaf in mode.leaves()
        for producer in modules
        if variables[leaf.variable].initial is None and leaf.variable in _given(modules[producer])
    }
    while True:
        kept = {e for e in edges if any(e[1] == f[0] for f in edges) and any(e[0] == f[1] for f in edges)}
        if kept == edges:
            return {variable for _, _, variable in edges}
        edges = kept


def _given(module: Module) -> set[str]:
    return {variable for mode in module.modes.values() for variable in mode.gives}


def random_situation(rng: random.Random, spec: Spec) -> Situation:
    """Draw faults, limits and a phase."""
    everything = [
        *(f"pe:{name}" for name in spec.pes),
        *(f"device:{name}" for name in spec.devices),
        *(f"module:{name}" for name in spec.modules),
        *(f"bus:{name}" for name in spec.buses),
        *(f"channel:{bus.name}.{i}" for bus in spec.buses.values() if bus.channels == 2 for i in (1, 2)),
    ]
    down = rng.sample(everything, rng.choice((0, 0, 0, 0, 0, 1, 1, 2)))
    if rng.random() < 0.3:
        down += [f"module:{name}@{pe}" for name, pe in random_places(rng, spec, rng.randint(1, 3))]
    limits = {}
    for element in [f"bus:{name}" for name in spec.buses] + [f"pe:{name}" for name in spec.pes]:
        if rng.random() < 0.08:
            limits[element] = Fraction(rng.choice((0, 1, 333, 400, 500, 875, 1000)), 1000)
    return Situation(frozenset(down), limits, rng.choice(list(spec.phases)) if spec.phases else None)


def random_places(rng: random.Random, spec: Spec, most: int) -> list[tuple[str, str]]:
    """Draw places, each a module with two possible PEs or more and one of these."""
    hosts = {m.name: [pe.name for pe in spec.pes.values() if _allows(spec, m, pe)] for m in spec.modules.values()}
    every = [(name, pe) for name, pes in hosts.items() if len(pes) > 1 for pe in pes]
    return rng.sample(every, min(most, len(every)))


def with_phase_inputs(rng: random.Random, spec: Spec) -> Spec:
    """Let some inputs of a spec with phases be wired in some phases only."""
    if not spec.phases or rng.random() < 0.5:
        return spec

    def changed(leaf: Leaf) -> Leaf:
        if leaf.demux is not None or rng.random() < 0.7:
            return leaf
        return replace(leaf, only_in=frozenset(rng.sample(list(spec.phases), rng.randint(1, len(spec.phases)))))

    modules = {}
    for name, module in spec.modules.items():
        needs = {mode.name: mode.needs and with_leaves(mode.needs, changed) for mode in module.modes.values()}
        modes = {mode.name: replace(mode, needs=needs[mode.name]) for mode in module.modes.values()}
        modules[name] = replace(module, modes=modes)
    return replace(spec, modules=modules)


def random_priorities(rng: random.Random, spec: Spec) -> dict[str, int]:
    """Draw priorities that were changed in flight: mostly none."""
    if rng.random() < 0.7:
        return {}
    return {name: rng.choice((0, 1, 2, 4, 300)) for name in spec.functions if rng.random() < 0.5}


def random_running(rng: random.Random, spec: Spec) -> dict[str, tuple[str, str]] | None:
    """Draw what runs: any modules anywhere, as after a fault, or nothing known."""
    if rng.random() < 0.4:
        return None
    return {
        module.name: (rng.choice(list(module.modes)), rng.choice(list(spec.pes)))
        for module in spec.modules.values()
        if rng.random() < 0.6
    }


def features(case: Case) -> dict[str, bool]:
    """Tell what a case contains, by name."""
    spec, now = case.spec, case.now
    every_mode = [mode for module in spec.modules.values() for mode in module.modes.values()]
    gates = [gate for mode in every_mode for gate in _gates(mode.needs)]
    modules = spec.modules.values()
    buses = spec.buses.values()
    return {
        "three buses": len(spec.buses) == 3,
        "gateway": any(len(pe.buses) > 1 for pe in spec.pes.values()),
        "wireless bus": any(bus.kind == "wireless" for bus in buses),
        "replicated bus": any(bus.channels > 1 for bus in buses),
        "several modes": any(len(module.modes) > 1 for module in modules),
        "several versions": any(variable.versions > 1 for variable in spec.variables.values()),
        "initial value": any(variable.initial is not None for variable in spec.variables.values()),
        "deadline": any(variable.deadline_ns is not None for variable in spec.variables.values()),
        "standard identifier": any(variable.identifier is not None for variable in spec.variables.values()),
        "device": any(module.device for module in modules),
        "runs_on": any(module.runs_on for module in modules),
        "requires": any(module.requires for module in modules),
        "and": any(isinstance(gate, And) for gate in gates),
        "or": any(isinstance(gate, Or) and gate.k > 0 for gate in gates),
        "optional": any(isinstance(gate, Or) and gate.k == 0 for gate in gates),
        "xor": any(isinstance(gate, Xor) for gate in gates),
        "nested gates": any(not isinstance(one, Leaf) for gate in gates for one in gate.inputs),
        "demux": bool(spec.demuxes),
        "shared actuator": any(
            sum(module.device == device.name for module in spec.modules.values()) > 1
            for device in spec.devices.values()
            if device.kind == "actuator"
        ),
        "foreign frames": any(bus.foreign for bus in spec.buses.values()),
        "demux of an expression": any(not isinstance(demux.needs, Leaf) for demux in spec.demuxes.values()),
        "demux with to": any(demux.to for demux in spec.demuxes.values()),
        "path of two": any(f"{b}p1" in d.to for d in spec.demuxes.values() for b in d.branches),
        "path of three": any(f"{b}p2" in d.to for d in spec.demuxes.values() for b in d.branches),
        "demux as output": any(function.output in spec.demuxes for function in spec.functions.values()),
        "separate": bool(spec.separate),
        "together": bool(spec.together),
        "phases": len(spec.phases) > 1,
        "not wanted": any(function.priority_in(now.phase) == 0 for function in spec.functions.values()),
        "own values": any(function.value for function in spec.functions.values()),
        "shared output": len({f.output for f in spec.functions.values()}) < len(spec.functions),
        "limit": bool(now.limits),
        "faults": bool(now.down),
        "failed place": any("@" in element for element in now.down),
        "changed priority": bool(now.priorities),
        "only in": any(leaf.only_in is not None for mode in every_mode for _, leaf in mode.leaves()),
        "running": case.running is not None,
        "feeds itself": any(leaf.variable in mode.gives for mode in every_mode for _, leaf in mode.leaves()),
    }


def _gates(needs: Expression | None) -> Iterable[And | Or | Xor]:
    if needs is None or isinstance(needs, Leaf):
        return
    yield needs
    for one in needs.inputs:
        yield from _gates(one)
