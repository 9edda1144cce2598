"""The verifier of transitions: finds the rules that the steps from one configuration to another break.

The verifier tries every combination of states that the PEs could have during the steps. If there are too many
combinations, it assumes for each bus the worst state of each PE that is no gateway. The result is still exact, since
the loads of PEs add up. If there are still too many combinations, it assumes the worst state of some gateways, too.
Then the result is safe but not exact. The verifier shares no code with `transition`, which finds the steps.

    t.steps      the steps are not in the required order: BREAK before GO before GO_ALL, and GO_ALL last
    t.wait       the manager would wait for a PE that cannot answer; or there is a step BREAK without PEs to wait for,
                 or there are PEs to wait for without a step BREAK
    t.cpu, t.ram, t.flash   the modules of a PE in one of its states exceed its capacity
    t.exclusive  a module, the branches of a DEMUX, or the ends of its `to`, could run on two PEs at once
    t.bus        the load of a bus could exceed its limit

The limit of a bus is its budget, or its load before the transition if that load is higher. If the wires of the running
configuration are not known, every variable that a module gives is assumed to go to every PE.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod

from heronry_dg.configuration import Configuration
from heronry_dg.model import Mode, Spec
from heronry_dg.objective import Placement
from heronry_dg.situation import Situation, Survivors, survivors
from heronry_dg.traffic import source_mbit_per_s
from heronry_dg.transition import Transition
from heronry_dg.verify import Violation
from heronry_wire.management import Step

MOST_MIXTURES = 4096

BEFORE, BROKEN, HELD, AFTER = "before", "broken", "held", "after"


@dataclass(frozen=True, slots=True)
class _Way:
    """The transition to verify, and its traffic.

    now_runs, shall_run: mode and PE of each module before and after the transition. sends_now, shall_send: what the PEs
    publish and forward before and after the transition.
    """

    spec: Spec
    left: Survivors
    now_runs: Placement
    shall_run: Placement
    sends_now: "_Traffic"
    shall_send: "_Traffic"
    known: bool  # whether the wires of the running configuration are known
    drives: Mapping[str, Sequence[tuple[str, str]]]  # module -> its DEMUXes, each with its part there: branch or end

    def modules(self, pe: str, state: str) -> dict[str, Mode]:
        """Modules that run on a PE while the PE is in a state, with their modes."""
        now = {m: mode for m, (mode, at) in self.now_runs.items() if at == pe}
        then = {m: mode for m, (mode, at) in self.shall_run.items() if at == pe}
        if state == BEFORE:
            chosen = now
        elif state == BROKEN:
            chosen = {m: mode for m, mode in now.items() if then.get(m) == mode}
        elif state == HELD:
            chosen = {m: mode for m, mode in then.items() if m not in self.drives or m in now}
        else:
            chosen = then
        return {m: self.spec.modules[m].modes[mode] for m, mode in chosen.items()}


@dataclass(frozen=True, slots=True)
class _Traffic:
    """Tells on which buses each PE publishes each source, and onto which buses each gateway forwards each source.

    publish: (producer's PE, producing module, variable) -> buses.
    forward: (gateway, producer's PE, producing module, variable) -> buses.
    """

    publish: Mapping[tuple[str, str, str], frozenset[str]]
    forward: Mapping[tuple[str, str, str, str], frozenset[str]]


def verify_transition(
    spec: Spec, before: Configuration | Placement, after: Configuration, now: Situation, way: Transition
) -> list[Violation]:
    """List every broken rule of a transition; an empty list means that the transition is legal."""
    left = survivors(spec, now)
    runs = _runs(spec, before)
    case = _Way(
        spec,
        left,
        runs,
        _runs(spec, after),
        _traffic(spec, runs, before),
        _traffic(spec, _runs(spec, after), after),
        isinstance(before, Configuration),
        _drives(spec),
    )
    found = list(_shape(way, left))
    found += _pe_budgets(case)
    for stage in _stages(way, left):
        found += _exclusives(case, way, stage)
        found += _bus_budgets(case, stage)
    return list(dict.fromkeys(found))


def _drives(spec: Spec) -> dict[str, list[tuple[str, str]]]:
    drives: dict[str, list[tuple[str, str]]] = {}
    for demux in spec.demuxes.values():
        for module in demux.branches:
            drives.setdefault(module, []).append((demux.name, "branch"))
        for module in demux.to:
            drives.setdefault(module, []).append((demux.name, "end"))
    return drives


def _runs(spec: Spec, running: Configuration | Placement) -> Placement:
    if isinstance(running, Configuration):
        running = {name: (module.mode, module.pe) for name, module in running.modules.items()}
    return {
        name: (mode, pe)
        for name, (mode, pe) in running.items()
        if name in spec.modules and mode in spec.modules[name].modes and pe in spec.pes
    }


def _shape(way: Transition, left: Survivors) -> Iterator[Violation]:
    steps = list(way.steps)
    names = ", ".join(step.name for step in steps) or "none"
    if steps != sorted(set(steps)) or Step.PREPARED in steps or not steps or steps[-1] is not Step.GO_ALL:
        yield Violation("t.steps", "transition", f"{names} is not a legal sequence of activation steps")
    if (Step.BREAK in steps) != bool(way.wait_for):
        sentence = "the transition has a step BREAK but waits for no PE, or waits for PEs but has no step BREAK"
        yield Violation("t.wait", "transition", sentence)
    for pe in way.wait_for:
        if pe not in left.pe_cpu_millis:
            yield Violation(
                "t.wait", f"pe {pe}", f"the transition waits for PE {pe}, which cannot answer in this situation"
            )


def _stages(way: Transition, left: Survivors) -> Iterator[dict[str, tuple[str, ...]]]:
    """Yield, for each activation step, the states in which each PE may be while no later step has been commanded."""
    behind: dict[str, tuple[str, ...]] = dict.fromkeys(left.pe_cpu_millis, (BEFORE,))
    for step in way.steps:
        state = {Step.BREAK: BROKEN, Step.GO: HELD}.get(step, AFTER)
        stage = {pe: (*states, state) for pe, states in behind.items()}
        yield stage
        behind = {pe: (state,) if step is Step.BREAK and pe in way.wait_for else stage[pe] for pe in stage}


def _pe_budgets(case: _Way) -> Iterator[Violation]:
    for name, cpu_millis in case.left.pe_cpu_millis.items():
        pe = case.spec.pes[name]
        held = case.modules(name, BEFORE)
        for state in (BROKEN, HELD, AFTER):
            there = case.modules(name, state)
            for rule, unit, used, before, capacity in (
                ("t.cpu", "thousandths of a reference core", _cpu(there), _cpu(held), cpu_millis),
                ("t.ram", "bytes of RAM", _ram(there), _ram(held), pe.ram),
                ("t.flash", "bytes of flash", _flash(case, there), _flash(case, held), pe.flash),
            ):
                if used > max(capacity, before):
                    sentence = f"in state '{state}' its modules take {used} {unit}, but the PE has only {capacity}"
                    yield Violation(rule, f"pe {name}", sentence)


def _cpu(there: Mapping[str, Mode]) -> int:
    return sum(mode.cpu_millis for mode in there.values())


def _ram(there: Mapping[str, Mode]) -> int:
    return sum(mode.ram for mode in there.values())


def _flash(case: _Way, there: Mapping[str, Mode]) -> int:
    return sum(case.spec.modules[module].flash for module in there)


def _exclusives(case: _Way, way: Transition, stage: Mapping[str, Sequence[str]]) -> Iterator[Violation]:
    """Find exclusive outputs that a PE could begin to drive while another PE could still drive them.

    stage: the states in which each PE may be.
    """
    could: dict[str, set[str]] = {}  # exclusive output -> PEs that could drive it
    begins: dict[str, set[str]] = {}  # exclusive output -> those of these PEs that do not drive it now
    for pe, states in stage.items():
        driven_now = set(_driven(case, case.modules(pe, BEFORE)))
        for thing in {thing for state in states for thing in _driven(case, case.modules(pe, state))}:
            could.setdefault(thing, set()).add(pe)
            if thing not in driven_now:
                begins.setdefault(thing, set()).add(pe)
    waited = way.hold if Step.GO in way.steps and any(AFTER in states for states in stage.values()) else ()
    for module, (_, pe) in case.now_runs.items():
        for demux, part in case.drives.get(module, ()) if pe not in stage else ():
            if demux not in waited:  # the PE is silent, but not known to be dead
                could.setdefault(f"{part} of demux {demux}", set()).add(pe)
    for thing in begins:
        if len(could[thing]) > 1:
            pes = " and ".join(sorted(could[thing]))
            yield Violation("t.exclusive", thing, f"PEs {pes} could run {thing} at the same time")


def _driven(case: _Way, modules: Iterable[str]) -> Iterator[str]:
    """Name the exclusive outputs of these modules.

    For each module these are the module itself, and its part (branch or end) of each of its DEMUXes.
    """
    for module in modules:
        yield f"module {module}"
        for demux, part in case.drives.get(module, ()):
            yield f"{part} of demux {demux}"


def _bus_budgets(case: _Way, stage: Mapping[str, Sequence[str]]) -> Iterator[Violation]:
    before = _loads(case, dict.fromkeys(stage, BEFORE)) if case.known else {}
    worst = _worst_loads(case, stage)
    for bus, room in case.left.bus_mbit_per_s.items():
        limit = max(room, before.get(bus, 0))
        if worst[bus] > limit:
            text = f"it carries up to {worst[bus] / 1000:.3f} bit/s in transition, but its limit is {limit / 1000:.3f}"
            yield Violation("t.bus", f"bus {bus}", text)


def _worst_loads(case: _Way, stage: Mapping[str, Sequence[str]]) -> dict[str, int]:
    if not case.known and not any(AFTER in states or HELD in states for states in stage.values()):
        # In the first step PEs only stop modules, so no load rises. If the wires are unknown, the loads before this
        # step are unknown, too.
        return dict.fromkeys(case.left.bus_mbit_per_s, 0)
    choices = {pe: _different(case, pe, states) for pe, states in stage.items()}
    if prod(map(len, choices.values())) <= MOST_MIXTURES:
        return _most(case, choices)
    gateways = {pe: states for pe, states in choices.items() if len(case.spec.pes[pe].buses) > 1}
    while prod(map(len, gateways.values())) > MOST_MIXTURES:
        gateways.popitem()
    worst = dict.fromkeys(case.left.bus_mbit_per_s, 0)
    for states in itertools.product(*gateways.values()):
        fixed = dict(zip(gateways, states, strict=True))
        total = dict.fromkeys(worst, 0)
        for pe, own in choices.items():
            alone = [_loads(case, {pe: state}, fixed, choices) for state in ([fixed[pe]] if pe in fixed else own)]
            for bus in total:
                total[bus] += max(load[bus] for load in alone)
        worst = {bus: max(most, total[bus]) for bus, most in worst.items()}
    return worst


def _most(case: _Way, choices: Mapping[str, Sequence[str]]) -> dict[str, int]:
    worst = dict.fromkeys(case.left.bus_mbit_per_s, 0)
    for states in itertools.product(*choices.values()):
        for bus, load in _loads(case, dict(zip(choices, states, strict=True))).items():
            worst[bus] = max(worst[bus], load)
    return worst


def _different(case: _Way, pe: str, states: Sequence[str]) -> list[str]:
    """Return `states` without each state in which the PE sends and forwards the same as in an earlier one."""
    seen: dict[object, str] = {}
    for state in states:
        forwards = {key: _forwarded(case, key, state) for key in _forward_keys(case) if key[0] == pe}
        seen.setdefault(
            (tuple(_sent(case, pe, state)), tuple(sorted((k, *sorted(v)) for k, v in forwards.items()))), state
        )
    return list(seen.values())


def _loads(
    case: _Way,
    states: Mapping[str, str],
    gateways: Mapping[str, str] | None = None,
    choices: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, int]:
    """Compute the load of each bus, in thousandths of a bit/s, from the sources that the PEs in `states` publish.

    states: the state of each PE that publishes.
    gateways: the state by which each gateway forwards. None: each gateway in `states` forwards by its state
        there, and no other gateway forwards.
    choices: used only together with `gateways`: the possible states of each PE. A gateway that is missing in
        `gateways` forwards everything that it forwards in at least one of its possible states.
    """
    loads = dict.fromkeys(case.left.bus_mbit_per_s, 0)
    keys = _forward_keys(case)

    def onto(gateway: str, key: tuple[str, str, str, str]) -> frozenset[str]:
        if gateways is None:
            return _forwarded(case, key, states[gateway]) if gateway in states else frozenset()
        own = [gateways[gateway]] if gateway in gateways else (choices or {}).get(gateway, ())
        return frozenset(bus for state in own for bus in _forwarded(case, key, state))

    for pe, state in states.items():
        for (producer, variable), buses, mbit_per_s in _sent(case, pe, state):
            reached, frontier = set(buses), list(buses)
            while frontier:
                inward = frontier.pop()
                for key in keys:
                    gateway = key[0]
                    if key[1:] != (pe, producer, variable) or inward not in case.spec.pes[gateway].buses:
                        continue
                    new = onto(gateway, key) - reached
                    reached |= new
                    frontier.extend(new)
            for bus in reached & loads.keys():
                loads[bus] += mbit_per_s
    return loads


def _sent(case: _Way, pe: str, state: str) -> Iterator[tuple[tuple[str, str], tuple[str, ...], int]]:
    """Yield each source that a PE publishes in a state, with the buses on which the PE publishes it.

    The last part is the load of the source on each of these buses, in thousandths of a bit/s.
    """
    for module, mode in case.modules(pe, state).items():
        for variable in mode.gives:
            key = (pe, module, variable)
            now = case.sends_now.publish.get(key, frozenset[str]())
            then = case.shall_send.publish.get(key, frozenset[str]())
            buses = {BEFORE: now, BROKEN: now & then}.get(state, then)
            if buses:
                yield (module, variable), tuple(sorted(buses)), source_mbit_per_s(case.spec, variable, mode)


def _forward_keys(case: _Way) -> list[tuple[str, str, str, str]]:
    return sorted(case.sends_now.forward.keys() | case.shall_send.forward.keys())


def _forwarded(case: _Way, key: tuple[str, str, str, str], state: str) -> frozenset[str]:
    now = case.sends_now.forward.get(key, frozenset[str]())
    then = case.shall_send.forward.get(key, frozenset[str]())
    return {BEFORE: now, BROKEN: now & then}.get(state, then)


def _traffic(spec: Spec, runs: Placement, running: Configuration | Placement) -> _Traffic:
    """Compute what each PE publishes and each gateway forwards, along the routes of the undamaged system.

    runs: mode and PE of each module whose traffic counts.
    running: the configuration whose wires count. If it is a placement, the wires are not known: then each
        variable that a module gives counts as sent to every PE.
    """
    whole = survivors(spec, Situation())
    publish: dict[tuple[str, str, str], frozenset[str]] = {}
    forward: dict[tuple[str, str, str, str], frozenset[str]] = {}
    for producer, variable, consumer_pe in _wires(spec, runs, running):
        origin = runs[producer][1]
        route = whole.route(origin, consumer_pe) or ()
        if route:
            key = (origin, producer, variable)
            publish[key] = publish.get(key, frozenset()) | {route[0]}
        for inward, outward in itertools.pairwise(route):
            gateway = next(pe.name for pe in spec.pes.values() if {inward, outward} <= set(pe.buses))
            along = (gateway, origin, producer, variable)
            forward[along] = forward.get(along, frozenset()) | {outward}
    return _Traffic(publish, forward)


def _wires(spec: Spec, runs: Placement, running: Configuration | Placement) -> Iterator[tuple[str, str, str]]:
    """Yield producer, variable and consumer's PE of each wire, or of each possible wire if the wires are not known."""
    if isinstance(running, Configuration):
        for consumer, _, wire in running.wires():
            if consumer in runs and wire.producer in runs:
                yield wire.producer, wire.variable, runs[consumer][1]
        return
    for producer, (mode, _) in runs.items():
        for variable in spec.modules[producer].modes[mode].gives:
            yield from ((producer, variable, pe) for pe in spec.pes)
