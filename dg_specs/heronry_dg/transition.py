"""Transitions: the steps by which one configuration replaces another, and what must stop before other things start.

During a transition each PE is in one of these states:

    before   the PE runs its part of the old configuration
    broken   after BREAK: of its old modules, the PE runs only those that the new configuration has on it in the same
             mode. It sends and forwards only what it sends and forwards in both configurations
    after    after GO_ALL: the PE runs its part of the new configuration. After GO it runs the same part, without the
             DEMUX branches that are new on this PE

The PEs do not change their states at the same instant (protocol rule 4). So for a while they are in different states:
a *mixture*. No PE exceeds its own capacity, since it stops old modules before it starts new ones. But a mixture of
`before` and `after` may overload a bus, or let two PEs drive something exclusive.

Neither can happen if all PEs execute BREAK before any PE executes the next step. A mixture of `before` and `broken`
loads no bus more than the old configuration does. A mixture of `broken` and `after` loads no bus more than the new
configuration does. But the answers to BREAK cost a round trip, in which modules that move do not run. So the steps
depend on the case:

    GO_ALL          if no mixture of `before` and `after` exceeds the limit of a bus, and nothing exclusive moves
    BREAK, GO_ALL   in all other cases. The manager waits for the BREAK of as few PEs as possible: PEs that give up
                    something exclusive, and PEs that make room on a bus whose limit would be exceeded. To make room it
                    prefers PEs that are reached by wire, since a radio is slow

If a PE that drove a DEMUX has become silent, the step GO comes before GO_ALL. The new branch (or end of `to`) starts
only with GO_ALL, when the old one has certainly stopped.

A PE for which the manager does not wait changes over when a command reaches it. A module that does not change is not
interrupted.

For the load of a mixture on a bus, an upper bound is computed. It assumes that each PE is in the state in which it
loads the bus most, and that each gateway forwards what it forwards in any of its states. The bound is exact unless a
gateway itself changes over. Semantics rule 9 is not checked for mixtures: a datum may be late during a transition,
which lasts a few heartbeats at most.

Critical functions have no step of their own before the other functions. A step is a broadcast to all PEs, so this would
need another epoch, and to prepare an epoch takes longer than the round trip that could be saved.

If the wires of the running modules are not known, everything that the modules give is assumed to be on every bus.
`verify_transition` checks transitions, and shares no code with this file.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement, serving_modules
from heronry_dg.situation import Situation, Survivors, survivors
from heronry_dg.traffic import source_mbit_per_s
from heronry_wire.management import Step

Source = tuple[str, str]  # producer, variable


@dataclass(frozen=True, slots=True)
class Part:
    """What one PE does under a configuration: the modules that it runs, and the data that it sends and forwards."""

    modules: frozenset[tuple[str, str]] = frozenset()  # (module, mode)
    sends: Mapping[Source, tuple[int, frozenset[str]]] = field(default_factory=dict)  # load in 1/1000 bit/s, its buses
    forwards: frozenset[tuple[Source, str, str]] = frozenset()  # (source, PE that sends it, bus to which it goes on)

    def broken(self, after: "Part") -> "Part":
        """Return what this PE still does after BREAK, if `after` is its part of the new configuration."""
        kept = self.modules & after.modules
        running = {module for module, _ in kept}
        both = {
            source: (mbit_per_s, buses & after.sends[source][1])
            for source, (mbit_per_s, buses) in self.sends.items()
            if source[0] in running and source in after.sends
        }
        return Part(kept, both, self.forwards & after.forwards)


@dataclass(frozen=True, slots=True)
class Peak:
    """Highest possible load of a bus during a transition, and the limit of that bus, in thousandths of a bit/s."""

    mbit_per_s: int
    limit_mbit_per_s: int


@dataclass(frozen=True, slots=True)
class Transition:
    """The steps from one configuration to another, and their effects."""

    steps: tuple[Step, ...]  # what ACTIVATE carries, in order; the last is always GO_ALL
    wait_for: Mapping[str, tuple[str, ...]]  # PEs that must report BROKEN before GO is sent, each with the reasons
    hold: tuple[str, ...]  # DEMUXes that a silent PE has driven: GO_ALL must wait until T_lease of this PE has expired
    interrupted: tuple[str, ...]  # functions served before and after, though one of their modules changes or stops
    peaks: Mapping[str, Peak]

    def document(self) -> dict[str, object]:
        """Return the transition as plain data for JSON."""
        return {
            "steps": [step.name for step in self.steps],
            "wait_for": {pe: list(why) for pe, why in self.wait_for.items()},
            "hold": list(self.hold),
            "interrupted": list(self.interrupted),
            "buses": {
                bus: {"bits_per_s": peak.mbit_per_s // 1000, "limit_bits_per_s": peak.limit_mbit_per_s // 1000}
                for bus, peak in self.peaks.items()
            },
        }


def transition(spec: Spec, before: Configuration | Placement, after: Configuration, now: Situation) -> Transition:
    """Find the steps from what runs to the configuration `after`, which must be legal in the situation `now`.

    before: what runs, with its wires if they are known; modules, modes and PEs that the spec lacks are ignored.
    """
    return Transitions(spec).transition(before, after, now)


class Transitions:
    """Computes the transitions between configurations of one spec.

    Values that depend on the spec alone are computed once.
    """

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._everything = survivors(spec, Situation())
        radios = frozenset(f"bus:{bus.name}" for bus in spec.buses.values() if bus.kind == "wireless")
        self._wired = survivors(spec, Situation(radios)).pe_cpu_millis.keys()
        self._gateways = {
            (inward, outward): pe.name
            for pe in spec.pes.values()
            for inward in pe.buses
            for outward in pe.buses
            if inward != outward
        }
        self._things = spec.exclusive_things()

    def transition(self, before: Configuration | Placement, after: Configuration, now: Situation) -> Transition:
        """Find a transition, as the function `transition` does."""
        spec, left = self._spec, survivors(self._spec, now)
        known = isinstance(before, Configuration)
        runs = self._in_spec(placement(before))
        old = self._parts(runs, _links(before, runs) if isinstance(before, Configuration) else self._floods(runs))
        exclusive, hold = self._exclusive(runs, placement(after), left)
        mixtures = _Mixtures({pe: [old[pe]] for pe in left.pe_cpu_millis}, self.parts(after), left, self._gateways)
        limits = mixtures.limits(known=known)
        budget = mixtures.makes_room(exclusive.keys(), limits, [pe for pe in left.pe_cpu_millis if pe in self._wired])
        wait_for = {
            pe: (*exclusive.get(pe, ()), *(f"makes room on {bus}" for bus in budget.get(pe, ())))
            for pe in spec.pes
            if pe in exclusive or pe in budget
        }
        peaks = mixtures.peaks(frozenset(wait_for))
        return Transition(
            steps=((Step.BREAK,) if wait_for else ()) + ((Step.GO,) if hold else ()) + (Step.GO_ALL,),
            wait_for=wait_for,
            hold=hold,
            interrupted=tuple(self._interrupted(before, after, now)),
            peaks={bus: Peak(peak, limits[bus]) for bus, peak in peaks.items()},
        )

    def must_break(
        self,
        may_run: Mapping[str, Sequence[Configuration]],
        after: Configuration,
        now: Situation,
        exclusive: Collection[str],
    ) -> frozenset[str]:
        """Return the PEs whose BREAK the manager must await before it commands GO of the configuration `after`.

        may_run: for each available PE, the configurations that are possible: the PE may still run any one of them.
        exclusive: PEs to wait for in any case; the result includes these PEs.
        """
        left = survivors(self._spec, now)
        parts: dict[int, dict[str, Part]] = {}
        for configuration in (one for several in may_run.values() for one in several):
            if id(configuration) not in parts:
                parts[id(configuration)] = self.parts(configuration)
        old = {pe: [parts[id(one)][pe] for one in may_run.get(pe, ())] or [Part()] for pe in left.pe_cpu_millis}
        mixtures = _Mixtures(old, self.parts(after), left, self._gateways)
        budget = mixtures.makes_room(
            exclusive, mixtures.limits(known=True), [pe for pe in left.pe_cpu_millis if pe in self._wired]
        )
        return frozenset(exclusive).union(budget)

    def parts(self, configuration: Configuration) -> dict[str, Part]:
        """Return, by PE, the modules that it runs and the data that it sends and forwards under a configuration."""
        runs = placement(configuration)
        return self._parts(runs, _links(configuration, runs))

    def _in_spec(self, runs: Placement) -> Placement:
        modules, pes = self._spec.modules, self._spec.pes
        return {
            m: (mode, pe) for m, (mode, pe) in runs.items() if m in modules and mode in modules[m].modes and pe in pes
        }

    def _floods(self, runs: Placement) -> Iterator[tuple[Source, str]]:
        """Yield (source, PE) for each source of the running modules and each PE: as if every PE read every source."""
        for module, (mode, _) in runs.items():
            for variable in self._spec.modules[module].modes[mode].gives:
                yield from (((module, variable), pe) for pe in self._spec.pes)

    def _parts(self, runs: Placement, links: Iterable[tuple[Source, str]]) -> dict[str, Part]:
        sends: dict[str, dict[Source, tuple[int, frozenset[str]]]] = {pe: {} for pe in self._spec.pes}
        forwards: dict[str, set[tuple[Source, str, str]]] = {pe: set() for pe in self._spec.pes}
        for source, consumer_pe in links:
            (producer, variable), (chosen, origin) = source, runs[source[0]]
            mode = self._spec.modules[producer].modes[chosen]
            route = self._everything.route(origin, consumer_pe) or ()
            if variable not in mode.gives:
                continue  # what runs may come from a plan for another spec
            for inward, outward in pairwise(route):
                forwards[self._gateways[inward, outward]].add((source, origin, outward))
            if route:
                buses = sends[origin].get(source, (0, frozenset[str]()))[1]
                sends[origin][source] = source_mbit_per_s(self._spec, variable, mode), buses | {route[0]}
        there: dict[str, set[tuple[str, str]]] = {pe: set() for pe in self._spec.pes}
        for module, (chosen, pe) in runs.items():
            there[pe].add((module, chosen))
        return {pe: Part(frozenset(there[pe]), sends[pe], frozenset(forwards[pe])) for pe in self._spec.pes}

    def _exclusive(
        self, runs: Placement, wanted: Placement, left: Survivors
    ) -> tuple[dict[str, tuple[str, ...]], tuple[str, ...]]:
        """Return the PEs that give up something exclusive to another PE, each with the reasons.

        The second result names the DEMUXes that a silent PE may still drive.
        """
        driver_on = {thing: pe for m, (_, pe) in wanted.items() for thing in self._things.get(m, ())}
        reasons: dict[str, tuple[str, ...]] = {}
        hold = set[str]()
        for module, (_, pe) in runs.items():
            lost = [thing for thing in self._things.get(module, ()) if driver_on.get(thing, pe) != pe]
            moved_to = wanted[module][1] if module in wanted else pe
            if lost and pe not in left.pe_cpu_millis:
                hold.update(lost)
                continue
            if lost:
                why = f"{module} gives {lost[0]} up to {driver_on[lost[0]]}"
            elif moved_to != pe and pe in left.pe_cpu_millis:
                why = f"{module} moves to {moved_to}"
            else:
                continue
            reasons[pe] = (*reasons.get(pe, ()), why)
        return reasons, tuple(d.name for d in self._spec.demuxes.values() if not hold.isdisjoint(d.exclusives))

    def _interrupted(self, before: Configuration | Placement, after: Configuration, now: Situation) -> Iterator[str]:
        runs, wanted = placement(before), placement(after)
        for function, output in serving_modules(self._spec, after):
            served_before = any(one in runs for one in function.outputs)
            if output is None or not served_before or now.priority_of(function) == 0:
                continue
            behind = _behind(after, output)
            moved = any(runs.get(module) != wanted[module] for module in behind)
            if moved or (isinstance(before, Configuration) and any(_rewired(before, after, m) for m in behind)):
                yield function.name


class _Mixtures:
    """The highest possible load of each bus while some PEs run the old configuration and other PEs the new one."""

    def __init__(
        self,
        old: Mapping[str, Sequence[Part]],
        new: Mapping[str, Part],
        left: Survivors,
        gateways: Mapping[tuple[str, str], str],
    ) -> None:
        """Take what each PE may do before the transition (`old`), and what it does after the transition (`new`).

        gateways: the PE that forwards from one bus to another, by (from, to).
        """
        self._old, self._new, self._left, self._gateways = old, new, left, gateways
        self._gone = {pe: [part.broken(new[pe]) for part in parts] for pe, parts in old.items()}

    def limits(self, *, known: bool) -> dict[str, int]:
        """Limit of each bus, in thousandths of a bit/s: what its budget allows, or its present load if that is higher.

        known: whether the wires of the running configuration are known. If not, only the budget gives the limit.
        """
        carried = self._peaks(self._old) if known else {}
        return {bus: max(room, carried.get(bus, 0)) for bus, room in self._left.bus_mbit_per_s.items()}

    def peaks(self, waited_for: Collection[str]) -> dict[str, int]:
        """Return the highest load of each bus in thousandths of bit/s, if the PEs in `waited_for` report BROKEN first.

        So each of these PEs has reported BROKEN before any PE gets GO; every other PE may be in any of its states.
        """
        states = {
            pe: [*([] if pe in waited_for else self._old[pe]), *self._gone[pe], self._new[pe]] for pe in self._old
        }
        return self._peaks(states)

    def makes_room(
        self, waited_for: Collection[str], limits: Mapping[str, int], preferred: Collection[str]
    ) -> dict[str, tuple[str, ...]]:
        """Find a minimal set of further PEs to wait for, with the buses on which each of these PEs makes room.

        waited_for: PEs for which the manager waits anyway.
        limits: the limit of each bus, in thousandths of a bit/s.
        preferred: PEs to choose first; other PEs are added only if the preferred ones do not suffice.
        """
        over = self._over(waited_for, limits)
        added: list[str] = []
        rest = [pe for pe in preferred if pe not in waited_for and self._old[pe] != [self._new[pe]]]
        if over and self._over([*waited_for, *rest], limits):
            rest += [pe for pe in self._old if pe not in waited_for and pe not in rest]
        while over and rest:
            best = min(rest, key=lambda pe: sum(self._over([*waited_for, *added, pe], limits).values()))
            rest.remove(best)
            added.append(best)
            over = self._over([*waited_for, *added], limits)
        reasons = {}
        for pe in added.copy():
            without = self._over([*waited_for, *(other for other in added if other != pe)], limits)
            if without.keys() <= over.keys():
                added.remove(pe)
            else:
                reasons[pe] = tuple(bus for bus in without if bus not in over)
        return reasons

    def _over(self, waited_for: Collection[str], limits: Mapping[str, int]) -> dict[str, int]:
        peaks = self.peaks(waited_for)
        return {bus: peaks[bus] - limit for bus, limit in limits.items() if peaks[bus] > limit}

    def _peaks(self, states: Mapping[str, Sequence[Part]]) -> dict[str, int]:
        peaks = dict.fromkeys(self._left.bus_mbit_per_s, 0)
        forwards = {(pe, *entry) for pe, parts in states.items() for part in parts for entry in part.forwards}
        for pe, parts in states.items():
            loads = [self._loads(pe, part, forwards) for part in parts]
            for bus in peaks:
                peaks[bus] += max(load.get(bus, 0) for load in loads)
        return peaks

    def _loads(self, pe: str, part: Part, forwards: Collection[tuple[str, Source, str, str]]) -> dict[str, int]:
        """Return the load that a PE in the state `part` causes on each bus, in thousandths of a bit/s.

        The result includes the copies of the PE's frames that gateways forward.

        forwards: (gateway, source, sending PE, bus) for each source that a gateway forwards to a bus.
        """
        loads: dict[str, int] = {}
        for source, (mbit_per_s, buses) in part.sends.items():
            reached = set(buses)
            frontier = list(buses)
            while frontier:
                inward = frontier.pop()
                for outward in self._left.bus_mbit_per_s:
                    gateway = self._gateways.get((inward, outward))
                    if outward not in reached and (gateway, source, pe, outward) in forwards:
                        reached.add(outward)
                        frontier.append(outward)
            for bus in reached:
                loads[bus] = loads.get(bus, 0) + mbit_per_s
        return loads


def _links(configuration: Configuration, runs: Placement) -> Iterator[tuple[Source, str]]:
    """Yield the source and the consumer's PE of each wire whose ends both run."""
    for consumer, _, wire in configuration.wires():
        if wire.producer in runs and consumer in runs:
            yield (wire.producer, wire.variable), runs[consumer][1]


def _behind(configuration: Configuration, output: str) -> set[str]:
    """Return a module and all modules from which its data come, directly or through others."""
    found, frontier = set[str](), [output]
    while frontier:
        module = frontier.pop()
        if module not in found and module in configuration.modules:
            found.add(module)
            frontier.extend(wire.producer for wire in configuration.modules[module].inputs.values())
    return found


def _rewired(before: Configuration, after: Configuration, module: str) -> bool:
    return dict(before.modules[module].inputs) != dict(after.modules[module].inputs)
