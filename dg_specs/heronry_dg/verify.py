"""The verifier: finds the rules that a configuration breaks in a situation; a legal configuration breaks none.

The verifier uses no solver and makes no choice. One function per rule of docs/semantics.md, section 3, checks the
configuration. A violation names the rule as number and sub-rule (`7.cpu`), the place, and the mistake in one sentence.
The rules and their sub-rules:

    1 place      module, mode, pe (unknown names), pe_down, cut_off, runs_on, requires, device, device_down, failed,
                 failed_there
    2 wire       input (unknown), producer (not running), variable (another one), gives, version, accepts, phase, route
    3 gate       leaf, and, or, xor (does not hold), below (an input is wired, but a gate above it does not hold)
    4 demux      branches, ends (more than one runs), wired (a branch runs, and its input for the DEMUX is not wired)
    5 purpose    idle (a module serves no wanted function)
    6 cycles     cycle (of wires; none of their variables has an initial value)
    7 resources  cpu, ram, flash, bus
    8 placement  separate, together
    9 deadlines  deadline
   10 actuators  drivers (more than one module runs on one actuator)

A plan may come from anywhere, so every name in it can be wrong. A module with an unknown name, mode or PE is reported
under semantics rule 1, and the other checks ignore it. As far as possible, one mistake gives one violation. The order
of violations does not depend on the order in the plan.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from heronry_dg.checkpoints import loads_mbit_per_s
from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.cycles import components, shortest_cycle
from heronry_dg.findings import listed
from heronry_dg.gates import And, Expression, Leaf, bounds, child_path, holds, leaves, words
from heronry_dg.model import Mode, Module, Spec
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation, Survivors, survivors
from heronry_dg.traffic import bus_loads_mbit_per_s, hops


@dataclass(frozen=True, slots=True)
class Violation:
    """One broken rule."""

    rule: str  # number and sub-rule: "7.cpu"
    where: str  # "module NAME", "pe NAME", ...
    sentence: str

    def __str__(self) -> str:
        return f"rule {self.rule}, {self.where}: {self.sentence}"


@dataclass(frozen=True, slots=True)
class _Case:
    """The configuration to verify, in the spec's order; modules and modes that the spec lacks are left out."""

    spec: Spec
    now: Situation
    left: Survivors
    known: Configuration
    sound: Configuration  # `known` without wires that break semantics rule 2

    def mode(self, module: str) -> Mode:
        return self.known.mode(self.spec, module)

    def on(self, pe: str) -> list[str]:
        """Modules that the configuration runs on a PE."""
        return [name for name, running in self.known.modules.items() if running.pe == pe]


def verify(spec: Spec, now: Situation, configuration: Configuration) -> list[Violation]:
    """List every broken rule; an empty list means that the configuration is legal.

    now: a situation of this spec, as `situation` makes it.
    """
    found = list(_unknown_names(spec, configuration))
    known = _known(spec, configuration)
    case = _Case(spec, now, survivors(spec, now), known, _sound(spec, known))
    for rule in (
        _place,
        _wires,
        _gates,
        _demuxes,
        _purpose,
        _cycles,
        _pe_resources,
        _bus_resources,
        _placement_rules,
        _deadlines,
        _actuators,
    ):
        found.extend(rule(case))
    return found


def _known(spec: Spec, configuration: Configuration) -> Configuration:
    """Return a configuration without the modules whose name or mode the spec does not have.

    All inputs of the other modules are kept. Modules and inputs are in the spec's order.
    """
    kept = {}
    for name, module in spec.modules.items():
        running = configuration.modules.get(name)
        if running is not None and running.mode in module.modes:
            order = {path: i for i, (path, _) in enumerate(module.modes[running.mode].leaves())}
            inputs = sorted(running.inputs.items(), key=lambda item: (order.get(item[0], len(order)), item[0]))
            kept[name] = Running(running.pe, running.mode, dict(inputs))
    return Configuration(kept)


def _sound(spec: Spec, known: Configuration) -> Configuration:
    """Return `known` without its wrong wires.

    A wire is wrong if it breaks any part of semantics rule 2, or belongs to no input of its consumer's mode.
    """
    kept = {}
    for name, running in known.modules.items():
        accepted = dict(known.mode(spec, name).leaves())
        right = {
            path: wire
            for path, wire in running.inputs.items()
            if path in accepted and not any(_wire(spec, known, accepted[path], wire))
        }
        kept[name] = Running(running.pe, running.mode, right)
    return Configuration(kept)


# Semantics rule 1: place


def _unknown_names(spec: Spec, configuration: Configuration) -> Iterator[Violation]:
    for name in sorted(configuration.modules.keys() - spec.modules.keys()):
        yield Violation("1.module", f"module {name}", f"the spec has no module '{name}'")
    for name, module in spec.modules.items():
        running = configuration.modules.get(name)
        if running is not None and running.mode not in module.modes:
            yield Violation(
                "1.mode",
                f"module {name}",
                f"the module has no mode '{running.mode}'; its modes are {', '.join(module.modes)}",
            )


def _place(case: _Case) -> Iterator[Violation]:
    for name, running in case.known.modules.items():
        module = case.spec.modules[name]
        where = f"module {name}"
        if name in case.left.failed_modules:
            yield Violation("1.failed", where, "the module has failed and must not run")
        elif f"module:{name}@{running.pe}" in case.now.down:
            yield Violation(
                "1.failed_there",
                where,
                f"the module cannot run on {running.pe}: it failed there, or its code is missing there",
            )
        if running.pe not in case.spec.pes:
            yield Violation("1.pe", where, f"the spec has no PE named '{running.pe}'")
            continue
        if f"pe:{running.pe}" in case.now.down:
            yield Violation("1.pe_down", where, f"it is placed on {running.pe}, which is down")
        elif running.pe not in case.left.pe_cpu_millis:
            bus = case.spec.manager.bus
            yield Violation("1.cut_off", where, f"the module is placed on {running.pe}, which has no route to {bus}")
        yield from _host(case, module, running.pe)


def _host(case: _Case, module: Module, pe: str) -> Iterator[Violation]:
    where = f"module {module.name}"
    if module.runs_on is not None and pe not in module.runs_on:
        yield Violation("1.runs_on", where, f"the module may run only on {', '.join(module.runs_on)}, but is on {pe}")
    missing = module.requires - case.spec.pes[pe].features
    if missing:
        yield Violation(
            "1.requires", where, f"the module requires {', '.join(sorted(missing))}, which {pe} does not offer"
        )
    if module.device is None:
        return
    home = case.spec.devices[module.device].pe
    if pe != home:
        yield Violation(
            "1.device", where, f"the module's device {module.device} is on {home}, but the module is on {pe}"
        )
    if f"device:{module.device}" in case.now.down:
        yield Violation("1.device_down", where, f"the module's device {module.device} is down")


# Semantics rule 2: wire


def _wires(case: _Case) -> Iterator[Violation]:
    for name, running in case.known.modules.items():
        accepted = dict(case.mode(name).leaves())
        for path, wire in running.inputs.items():
            where = f'module {name}, input "{path}"'
            if path not in accepted:
                yield Violation("2.input", where, f'mode {running.mode} has no input "{path}"')
                continue
            leaf = accepted[path]
            yield from (Violation(rule, where, text) for rule, text in _wire(case.spec, case.known, leaf, wire))
            if leaf.only_in is not None and case.now.phase is not None and case.now.phase not in leaf.only_in:
                only = listed(sorted(leaf.only_in))
                yield Violation(
                    "2.phase", where, f"the input is wired in phase {case.now.phase}, and may be wired only in {only}"
                )
            yield from _route(case, running.pe, wire.producer, where)


def _wire(spec: Spec, known: Configuration, leaf: Leaf, wire: Wire) -> Iterator[tuple[str, str]]:
    """Check one wire; yields (rule, sentence) for its first mistake, and nothing for a correct wire."""
    if wire.producer not in known.modules:
        yield "2.producer", f"the input is wired to {wire.producer}, which does not run"
        return
    mode = known.mode(spec, wire.producer)
    if wire.variable != leaf.variable:
        yield "2.variable", f"the input takes {leaf.variable} and is wired to {wire.variable}"
    elif wire.variable not in mode.gives:
        yield "2.gives", f"{wire.producer} does not give {wire.variable} in mode {mode.name}"
    elif wire.version != mode.gives[wire.variable]:
        given = mode.gives[wire.variable]
        yield (
            "2.version",
            f"{wire.producer} gives {wire.variable}@{given} in mode {mode.name}, not @{wire.version}",
        )
    elif not leaf.accepts(wire.version):
        yield "2.accepts", f"the input takes {leaf.variable}@{leaf.best} to @{leaf.worst}, not @{wire.version}"


def _route(case: _Case, consumer_pe: str, producer: str, where: str) -> Iterator[Violation]:
    """Check that a wire has a route; a PE that is down or unknown is reported under semantics rule 1 only."""
    if producer not in case.known.modules:
        return
    ends = (case.known.modules[producer].pe, consumer_pe)
    down = any(pe not in case.spec.pes or f"pe:{pe}" in case.now.down for pe in ends)
    if not down and ends[0] != ends[1] and case.left.route(*ends) is None:
        yield Violation("2.route", where, f"no route that is up leads from {ends[0]} to {ends[1]}")


# Semantics rule 3: gate


def _gates(case: _Case) -> Iterator[Violation]:
    for name, running in case.known.modules.items():
        needs = case.mode(name).needs
        if needs is None:
            continue
        # An unwired branch of a DEMUX is reported under semantics rule 4 alone, so its DEMUX counts as wired here.
        fed = {leaf.demux for path, leaf in leaves(needs) if path in running.inputs}
        unfed = {path for path, leaf in leaves(needs) if leaf.demux is not None and leaf.demux not in fed}
        for rule, path, text in _gate(needs, "", running.inputs.keys(), "3.leaf", unfed):
            yield Violation(rule, f'module {name}, input "{path}"' if path else f"module {name}", text)


def _gate(
    expression: Expression, path: str, wired: Collection[str], rule_if_unwired: str, ignored: Collection[str]
) -> Iterator[tuple[str, str, str]]:
    """Check that an expression holds; gives a (rule, path, sentence) for each mistake.

    wired: paths of the leaves that are wired. rule_if_unwired: the rule that a leaf breaks if it is not wired.
    ignored: paths of leaves; an expression that has no other leaves is not checked.
    """
    if all(at in ignored for at, _ in leaves(expression, path)):
        return
    if isinstance(expression, Leaf):
        if path not in wired:
            yield rule_if_unwired, path, f"{expression.variable} is needed and not wired"
        return
    children = [(child, child_path(path, index)) for index, child in enumerate(expression.inputs)]
    if isinstance(expression, And):
        for child, at in children:
            yield from _gate(child, at, wired, words(expression).rule, ignored)
        return
    held = sum(holds(child, wired, at) for child, at in children)
    fewest, most = bounds(expression)
    if not fewest <= held <= most:
        kind = words(expression)
        yield kind.rule, path, f"{held} of {len(children)} inputs hold, and {kind.demand}"
    for child, at in children:
        if holds(child, wired, at):
            yield from _gate(child, at, wired, "3.leaf", ignored)
        else:
            yield from _nothing_below(child, at, wired)


def _nothing_below(expression: Expression, path: str, wired: Collection[str]) -> Iterator[tuple[str, str, str]]:
    for at, leaf in leaves(expression, path):
        if at in wired:
            yield "3.below", at, f'{leaf.variable} is wired, but the gate "{path}" above it does not hold'


# Semantics rule 4: demux


def _demuxes(case: _Case) -> Iterator[Violation]:
    for demux in case.spec.demuxes.values():
        running = [branch for branch in demux.branches if branch in case.known.modules]
        if len(running) > 1:
            yield Violation(
                "4.branches", f"demux {demux.name}", f"{' and '.join(running)} run, but only one of them may run"
            )
        ended = [end for end in demux.to if end in case.known.modules]
        if len(ended) > 1 and len(running) < 2:  # if two branches run, two ends may run as a consequence
            yield Violation(
                "4.ends", f"demux {demux.name}", f"{' and '.join(ended)} run, but only one of these ends may run"
            )
        for branch in running:
            paths = [path for path, leaf in case.mode(branch).leaves() if leaf.demux == demux.name]
            if not any(path in case.known.modules[branch].inputs for path in paths):
                read = listed(dict.fromkeys(leaf.variable for _, leaf in leaves(demux.needs)), last="or")
                yield Violation("4.wired", f"demux {demux.name}", f"{branch} runs and is not wired to {read}")


# Semantics rule 5: purpose


def _purpose(case: _Case) -> Iterator[Violation]:
    serving: set[str] = set()
    frontier = [
        output
        for function in case.spec.functions.values()
        if case.now.priority_of(function) > 0
        for output in function.outputs
    ]
    while frontier:
        module = frontier.pop()
        if module in case.known.modules and module not in serving:
            serving.add(module)
            frontier.extend(wire.producer for wire in case.known.modules[module].inputs.values())
    for name in case.known.modules:
        if name not in serving:
            yield Violation("5.idle", f"module {name}", "the module serves no function that is wanted in the phase")


# Semantics rule 6: cycles


def _cycles(case: _Case) -> Iterator[Violation]:
    feeds: dict[str, list[str]] = {name: [] for name in case.known.modules}
    for consumer, _, wire in case.sound.wires():
        if case.spec.variables[wire.variable].initial is None:
            feeds[consumer].append(wire.producer)
    for component in components(feeds):
        ring = shortest_cycle(feeds, component)
        if ring:
            text = f"no variable on the cycle {' <- '.join([*ring, ring[0]])} has an initial value"
            yield Violation("6.cycle", f"module {ring[0]}", text)


# Semantics rule 7: resources


def _pe_resources(case: _Case) -> Iterator[Violation]:
    for name, cpu_millis in case.left.pe_cpu_millis.items():
        pe, here = case.spec.pes[name], case.on(name)
        for rule, used, capacity, unit in (
            ("7.cpu", sum(case.mode(module).cpu_millis for module in here), cpu_millis, "thousandths of a core"),
            ("7.ram", sum(case.mode(module).ram for module in here), pe.ram, "bytes of RAM"),
            ("7.flash", sum(case.spec.modules[module].flash for module in here), pe.flash, "bytes of flash"),
        ):
            if used > capacity:
                yield Violation(rule, f"pe {name}", f"the modules take {used} {unit}, but the PE has only {capacity}")


def _bus_resources(case: _Case) -> Iterator[Violation]:
    loads = bus_loads_mbit_per_s(case.spec, hops(case.left, case.sound))
    kept = loads_mbit_per_s(case.left, case.sound)
    for name, capacity in case.left.bus_mbit_per_s.items():
        if loads[name] + kept.get(name, 0) > capacity:
            what = f"modules publish {loads[name] / 1000:.3f} bit/s"
            if name in kept:
                what += f", and their checkpoints take {kept[name] / 1000:.3f} bit/s"
            yield Violation("7.bus", f"bus {name}", f"{what}, but data may take only {capacity / 1000:.3f} bit/s")


# Semantics rule 8: placement rules


def _placement_rules(case: _Case) -> Iterator[Violation]:
    for group in case.spec.separate:
        running = [name for name in group if name in case.known.modules]
        for index, name in enumerate(running):
            pe = case.known.modules[name].pe
            twin = next((other for other in running[:index] if case.known.modules[other].pe == pe), None)
            if twin is not None:
                yield Violation(
                    "8.separate", f"module {name}", f"the module must not share a PE with {twin}, but both are on {pe}"
                )
    for group in case.spec.together:
        running = [name for name in group if name in case.known.modules]
        for name in running[1:]:
            first, here = case.known.modules[running[0]].pe, case.known.modules[name].pe
            if here != first:
                text = f"the module must share a PE with {running[0]}: {running[0]} is on {first}, the module on {here}"
                yield Violation("8.together", f"module {name}", text)


# Semantics rule 9: deadlines


def _deadlines(case: _Case) -> Iterator[Violation]:
    for late in ResponseTimes(case.spec).late(hops(case.left, case.sound)):
        hop = late.hop
        taken = "arbitrarily long" if late.response_ns is None else f"up to {late.response_ns} ns"
        yield Violation(
            "9.deadline",
            f"bus {hop.bus}",
            f"{hop.variable} from {hop.producer} takes {taken} to arrive, but its deadline is {late.deadline_ns} ns",
        )


# Semantics rule 10: actuators


def _actuators(case: _Case) -> Iterator[Violation]:
    for device in case.spec.devices.values():
        driving = [name for name in case.known.modules if case.spec.modules[name].device == device.name]
        if device.kind == "actuator" and len(driving) > 1:
            text = f"{listed(driving)} drive it, but only one module may drive an actuator"
            yield Violation("10.drivers", f"device {device.name}", text)
