"""The verifier of transitions: may one configuration take over from another in these steps, and if not, why not.

It plays every order in which the PEs could take the steps. Where those are too many to play one by one, the PEs that
are no gateways are taken at their worst for each bus, which is exact, since what they send adds up; beyond that, so are
gateways, which is safe. Nothing is chosen here, and nothing is shared with `transition`.

    t.steps      the steps are none that a manager takes: BREAK before GO before GO_ALL, and GO_ALL last
    t.wait       a PE that cannot answer is waited for, or BREAK is there without a PE to wait for
    t.cpu, t.ram, t.flash   a PE holds more than it has, in a state of its own
    t.exclusive  a module, or the branches of a DEMUX, could run on two PEs at once
    t.bus        more could be published on a bus than it may carry

A bus may carry its budget, or what it carries before anything is done where that is more already. Where the wires of
what runs are not known, every variable that is given is taken to go everywhere.
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
    """What is verified; `now_runs` and `shall_run` map a module to its mode and PE."""

    spec: Spec
    left: Survivors
    now_runs: Placement
    shall_run: Placement
    sends_now: "_Traffic"
    shall_send: "_Traffic"
    known: bool  # the wires of what runs are
    demux_of: Mapping[str, str]

    def modules(self, pe: str, state: str) -> dict[str, Mode]:
        """Modules that run on a PE in a state, with their modes."""
        now = {m: mode for m, (mode, at) in self.now_runs.items() if at == pe}
        then = {m: mode for m, (mode, at) in self.shall_run.items() if at == pe}
        if state == BEFORE:
            chosen = now
        elif state == BROKEN:
            chosen = {m: mode for m, mode in now.items() if then.get(m) == mode}
        elif state == HELD:
            chosen = {m: mode for m, mode in then.items() if m not in self.demux_of or m in now}
        else:
            chosen = then
        return {m: self.spec.modules[m].modes[mode] for m, mode in chosen.items()}


@dataclass(frozen=True, slots=True)
class _Traffic:
    """The tables of a configuration: (PE, producer, variable) -> buses; (gateway, PE, producer, variable) -> buses."""

    publish: Mapping[tuple[str, str, str], frozenset[str]]
    forward: Mapping[tuple[str, str, str, str], frozenset[str]]


def verify_transition(
    spec: Spec, before: Configuration | Placement, after: Configuration, now: Situation, way: Transition
) -> list[Violation]:
    """List what is wrong with a way from what runs to what is to run; an empty list means that it is legal."""
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
        {branch: demux.name for demux in spec.demuxes.values() for branch in demux.branches},
    )
    found = list(_shape(way, left))
    found += _pe_budgets(case)
    for stage in _stages(way, left):
        found += _exclusives(case, way, stage)
        found += _bus_budgets(case, stage)
    return list(dict.fromkeys(found))


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
    if steps != sorted(set(steps)) or Step.PREPARED in steps or not steps or steps[-1] is not Step.GO_ALL:
        yield Violation("t.steps", "transition", f"{[step.name for step in steps]} is not a legal order of steps")
    if (Step.BREAK in steps) != bool(way.wait_for):
        yield Violation("t.wait", "transition", "PEs are waited for if and only if there is a step BREAK")
    for pe in way.wait_for:
        if pe not in left.pe_cpu_millis:
            yield Violation("t.wait", f"pe {pe}", "it is waited for, and cannot answer")


def _stages(way: Transition, left: Survivors) -> Iterator[dict[str, tuple[str, ...]]]:
    """For each step the states in which each PE could be from when the step goes out until the next one does."""
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
            for rule, used, before, capacity in (
                ("t.cpu", _cpu(there), _cpu(held), cpu_millis),
                ("t.ram", _ram(there), _ram(held), pe.ram),
                ("t.flash", _flash(case, there), _flash(case, held), pe.flash),
            ):
                if used > max(capacity, before):
                    yield Violation(rule, f"pe {name}", f"{state} takes {used}, and there is {capacity}")


def _cpu(there: Mapping[str, Mode]) -> int:
    return sum(mode.cpu_millis for mode in there.values())


def _ram(there: Mapping[str, Mode]) -> int:
    return sum(mode.ram for mode in there.values())


def _flash(case: _Way, there: Mapping[str, Mode]) -> int:
    return sum(case.spec.modules[module].flash for module in there)


def _exclusives(case: _Way, way: Transition, stage: Mapping[str, Sequence[str]]) -> Iterator[Violation]:
    """Find what a PE could begin to drive while another one could drive it, too."""
    could: dict[str, set[str]] = {}  # what is exclusive -> the PEs that could drive it
    begins: dict[str, set[str]] = {}  # ... those of them that do not drive it now
    for pe, states in stage.items():
        driven_now = set(_driven(case, case.modules(pe, BEFORE)))
        for thing in {thing for state in states for thing in _driven(case, case.modules(pe, state))}:
            could.setdefault(thing, set()).add(pe)
            if thing not in driven_now:
                begins.setdefault(thing, set()).add(pe)
    waited = way.hold if Step.GO in way.steps and any(AFTER in states for states in stage.values()) else ()
    for module, (_, pe) in case.now_runs.items():
        demux = case.demux_of.get(module)
        if demux is not None and pe not in stage and demux not in waited:
            could.setdefault(f"demux {demux}", set()).add(pe)  # silent, and not known to be dead
    for thing in begins:
        if len(could[thing]) > 1:
            yield Violation("t.exclusive", thing, f"{' and '.join(sorted(could[thing]))} could drive it at once")


def _driven(case: _Way, modules: Iterable[str]) -> Iterator[str]:
    """Name what is exclusive about some modules: they themselves, and the DEMUXes whose branches they are."""
    for module in modules:
        yield f"module {module}"
        if module in case.demux_of:
            yield f"demux {case.demux_of[module]}"


def _bus_budgets(case: _Way, stage: Mapping[str, Sequence[str]]) -> Iterator[Violation]:
    before = _loads(case, dict.fromkeys(stage, BEFORE)) if case.known else {}
    worst = _worst_loads(case, stage)
    for bus, room in case.left.bus_mbit_per_s.items():
        limit = max(room, before.get(bus, 0))
        if worst[bus] > limit:
            text = f"up to {worst[bus] / 1000:.3f} bit/s on the way, and it may carry {limit / 1000:.3f}"
            yield Violation("t.bus", f"bus {bus}", text)


def _worst_loads(case: _Way, stage: Mapping[str, Sequence[str]]) -> dict[str, int]:
    if not case.known and not any(AFTER in states or HELD in states for states in stage.values()):
        # No PE exceeds a limit by stopping; with unknown wires only that is known of the first step.
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
    """The states of a PE that differ on the buses."""
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
    """What is published on each bus when each PE is in this state.

    gateways: the states of those that forward, where `states` are not those of all; one that is in neither of them
    forwards what it would in any of its `choices`.
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
    """What a PE publishes itself: source, buses, bandwidth on each."""
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
    """Compute what each PE publishes and each gateway forwards, along the routes of the whole system."""
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
    """Producer, variable and the consumer's PE of each wire, or of each that there could be."""
    if isinstance(running, Configuration):
        for consumer, _, wire in running.wires():
            if consumer in runs and wire.producer in runs:
                yield wire.producer, wire.variable, runs[consumer][1]
        return
    for producer, (mode, _) in runs.items():
        for variable in spec.modules[producer].modes[mode].gives:
            yield from ((producer, variable, pe) for pe in spec.pes)
