"""Whole systems: probabilities against adding up every set of elements that are down, and against sampling.

    PYTHONPATH=tests python -m reliability.systems 0 200                200 systems of up to 16 elements, added up
    PYTHONPATH=tests python -m reliability.systems 0 50 --sampled       50 larger systems, sampled

Systems have common causes, replicated buses, drivers that share an actuator, and PEs and buses that are too small. No
planner and no diagram is asked here: every legal configuration that serves the function is enumerated once
(`planner.enumerator`), and a function is lost with some elements down if each of these configurations has a module on a
PE on which it cannot run then. So is the logic of the graph, by trying every choice of modes (`brute_force`). A
disagreement is printed with its seed, and makes the exit code 1.
"""

import random
import sys
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice, product
from math import expm1, fsum, sqrt

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, elements
from heronry_tools.analysis.reliability.bounds import Bounds, loss_bounds
from heronry_tools.analysis.reliability.chances import CommonCause, Hazards
from heronry_tools.analysis.reliability.mission import Reliability
from heronry_tools.analysis.reliability.resource_sets import resource_sets
from lab.compared_seeds import report, seed_parser
from planner.enumerator import Enumerator
from planner.random_specs import random_spec, with_shared_actuator
from reliability.brute_force import Losing

MOST_CONFIGURATIONS = 20_000  # of a system, or another one is drawn
RELATIVE = 1e-9
DEVIATIONS = 4.5  # of a sampled share from the exact one: by chance once in 150 000 systems
MUST_APPEAR = ("common cause", "replicated bus", "shared actuator", "bound by resources", "on demand")

Placed = tuple[str, str]  # a module, and the PE on which it runs


@dataclass(frozen=True)
class System:
    """A spec, a function of it, and the elements that may fail, of which each has a rate or a probability.

    ways: the smallest sets of placed modules with which a legal configuration serves the function.
    """

    spec: Spec
    function: str
    named: tuple[str, ...]
    hazards: Hazards
    hours: float
    ways: tuple[frozenset[Placed], ...]

    @cached_property
    def hosts(self) -> Mapping[str, Sequence[str]]:
        """The PEs on which each module may run with nothing down."""
        return Enumerator(self.spec, Situation()).hosts

    def without(self, down: Collection[str]) -> frozenset[Placed]:
        """Return the modules that cannot run where they otherwise could."""
        left = Enumerator(self.spec, Situation(frozenset(down))).hosts
        return frozenset((name, pe) for name, pes in self.hosts.items() for pe in pes if pe not in left[name])

    @cached_property
    def _bits(self) -> Mapping[Placed, int]:
        placed = [(name, pe) for name, pes in self.hosts.items() for pe in pes]
        return {one: 1 << number for number, one in enumerate(placed)}

    @cached_property
    def _dead(self) -> tuple[list[int], list[tuple[int, int]]]:
        """What each element takes down, as bits; and what a bus without any channel takes down, after these elements.

        Nothing else comes of several elements together, since there is one route from each PE to the manager.
        """
        alone = [self._mask(self.without((element,))) for element in self.named]
        together = []
        for bus in self.spec.buses.values():
            channels = [f"channel:{bus.name}.{number + 1}" for number in range(bus.channels)]
            if bus.channels > 1 and set(channels) <= set(self.named):
                elements_of_it = sum(1 << self.named.index(channel) for channel in channels)
                together.append((elements_of_it, self._mask(self.without(channels))))
        return alone, together

    def _mask(self, placed: Collection[Placed]) -> int:
        return sum(self._bits[one] for one in placed)

    def dead(self, down: int) -> int:
        """Return, as bits, the modules that cannot run where they otherwise could; `down`: a bit for each element."""
        alone, together = self._dead
        found = 0
        for number, its in enumerate(alone):
            if down >> number & 1:
                found |= its
        for elements_of_it, its in together:
            if down & elements_of_it == elements_of_it:
                found |= its
        return found

    def lost(self, dead: int) -> bool:
        """Tell whether no legal configuration is left that serves the function."""
        return all(way & dead for way in self._ways)

    @cached_property
    def _ways(self) -> tuple[int, ...]:
        return tuple(map(self._mask, self.ways))

    @cached_property
    def _losing(self) -> Losing:
        return Losing(self.spec, self.function)

    def lost_by_logic(self, dead: int) -> bool:
        """Tell whether the graph cannot serve the function any more."""
        left = (name for name, pes in self.hosts.items() if any(not self._bits[name, pe] & dead for pe in pes))
        return self._losing.without(frozenset(left))


def drawn_system(rng: random.Random, *, least: int, most: int) -> System:
    """Draw a system of `least` to `most` elements; one with too many configurations, or with none, is not drawn."""
    while True:
        spec = with_shared_actuator(rng, random_spec(rng, modules=rng.choice((4, 5, 6) if least < 16 else (6, 7, 8))))
        spec = _with_channels(rng, spec).in_phase(None)
        wanted = [function.name for function in spec.functions.values() if function.priority_in(None) > 0]
        possible = elements(spec)
        if not wanted or len(possible) < least:
            continue
        named = rng.sample(possible, rng.randint(least, min(most, len(possible))))
        function = rng.choice(wanted)
        ways = _ways_to_serve(spec, function)
        if ways:
            hours = rng.choice((0.5, 1.0, 20.0))
            return System(spec, function, tuple(named), _drawn_hazards(rng, named), hours, ways)


def _ways_to_serve(spec: Spec, function: str) -> tuple[frozenset[Placed], ...] | None:
    """Return the smallest sets of placed modules with which a legal configuration serves a function; None: too many."""
    others = {name: 0 for name in spec.functions if name != function}
    every = Enumerator(spec, Situation(priorities=others))
    structures = list(islice(every.structures(), MOST_CONFIGURATIONS + 1))
    serving = [one for one in structures if not one.modes.keys().isdisjoint(spec.functions[function].outputs)]
    placed = (frozenset(places.items()) for structure in serving for places in every.placements(structure))
    found = list(islice(placed, MOST_CONFIGURATIONS + 1))
    if max(len(structures), len(found)) > MOST_CONFIGURATIONS:
        return None
    kept: list[frozenset[Placed]] = []
    for way in sorted(set(found), key=len):
        if not any(one <= way for one in kept):
            kept.append(way)
    return tuple(kept)


def _with_channels(rng: random.Random, spec: Spec) -> Spec:
    buses = {
        name: replace(bus, channels=rng.choice((1, 2, 2))) if bus.kind == "wired" else bus
        for name, bus in spec.buses.items()
    }
    return replace(spec, buses=buses)


def _drawn_hazards(rng: random.Random, names: Collection[str]) -> Hazards:
    """Draw rates for some elements and probabilities for the others, and common causes within each kind."""
    rates = {name: 10 ** rng.uniform(-4, -0.5) for name in names if rng.random() < 0.7}
    demands = {name: 10 ** rng.uniform(-4, -0.5) for name in names if name not in rates}
    common = [
        CommonCause(tuple(rng.sample(group, min(rng.choice((2, 3)), len(group)))), rng.uniform(0.01, 0.4))
        for group in (list(rates), list(demands))
        if len(group) > 1 and rng.random() < 0.7
    ]
    if len(rates) > 2 and rng.random() < 0.3:
        common.append(CommonCause(tuple(rng.sample(list(rates), 2)), 0.1))
    return Hazards(rates, demands, tuple(common))


@dataclass(frozen=True, slots=True)
class Failing:
    """How elements fail, by the words of `chances`: each by itself, and causes that take down several."""

    alone: Mapping[str, float]
    causes: Sequence[tuple[float, Collection[str]]]

    @classmethod
    def of(cls, hazards: Hazards, hours: float) -> "Failing":
        """Read hazards after some hours."""
        shares = dict.fromkeys([*hazards.rates, *hazards.demands], 0.0)
        causes = []
        for cause in hazards.common:
            its = hazards.rates if cause.elements[0] in hazards.rates else hazards.demands
            share = cause.beta * min(its[one] for one in cause.elements)
            causes.append((-expm1(-share * hours) if its is hazards.rates else share, cause.elements))
            for one in cause.elements:
                shares[one] += share
        alone = {name: -expm1(-(rate - shares[name]) * hours) for name, rate in hazards.rates.items()}
        return cls(alone | {name: chance - shares[name] for name, chance in hazards.demands.items()}, causes)

    def of_each_set(self, named: Sequence[str]) -> list[float]:
        """Return the probability of each set of elements that exactly these are down; a set is a number, by bits."""
        total = [0.0] * (1 << len(named))
        for happening in product((False, True), repeat=len(self.causes)):
            weight, struck = 1.0, set[str]()
            for happens, (chance, members) in zip(happening, self.causes, strict=True):
                weight *= chance if happens else 1.0 - chance
                struck.update(members if happens else ())
            shares = [weight]
            for name in named:
                chance = 1.0 if name in struck else self.alone[name]
                shares = [*(one * (1.0 - chance) for one in shares), *(one * chance for one in shares)]
            total = [one + more for one, more in zip(total, shares, strict=True)]
        return total

    def drawn(self, rng: random.Random, named: Sequence[str]) -> int:
        """Draw a set of elements that are down."""
        down = {name for name in named if rng.random() < self.alone[name]}
        for chance, members in self.causes:
            if rng.random() < chance:
                down.update(members)
        return sum(1 << number for number, name in enumerate(named) if name in down)


def compare(rng: random.Random, *, most: int) -> tuple[str | None, set[str]]:
    """Add up one drawn system: what differs (None: nothing), and what the system has."""
    system = drawn_system(rng, least=min(4, most), most=most)
    shares = Failing.of(system.hazards, system.hours).of_each_set(system.named)
    dead = [system.dead(down) for down in range(len(shares))]
    by_dead = {one: (system.lost_by_logic(one), system.lost(one)) for one in set(dead)}
    by_logic = fsum(share for share, one in zip(shares, dead, strict=True) if by_dead[one][0])
    exact = fsum(share for share, one in zip(shares, dead, strict=True) if by_dead[one][1])
    found, bounds = _computed(system, None)
    has = _has(system) | ({"bound by resources"} if exact > by_logic * 1.001 else set())
    if not _equal(found.loss(system.hours), by_logic) or not _equal(found.survival(system.hours), 1.0 - by_logic):
        return f"logic: {found.loss(system.hours)}, but {by_logic}", has
    if not bounds.exact or not _equal(bounds.low, exact):
        return f"with real resources: {bounds}, but {exact}", has
    for order in (1, 2):
        partly = _computed(system, order)[1]
        if partly.high is None or not partly.low * (1 - RELATIVE) <= exact <= partly.high * (1 + RELATIVE):
            return f"to order {order}: {partly}, but {exact}", has
    return None, has


def compare_sampled(rng: random.Random, *, draws: int) -> tuple[str | None, set[str]]:
    """Sample one larger system: what differs (None: nothing), and what the system has."""
    system = drawn_system(rng, least=17, most=30)
    failing = Failing.of(system.hazards, system.hours)
    drawn = Counter(system.dead(failing.drawn(rng, system.named)) for _ in range(draws))
    found, bounds = _computed(system, 2)
    by_logic = sum(times for dead, times in drawn.items() if system.lost_by_logic(dead)) / draws
    with_resources = sum(times for dead, times in drawn.items() if system.lost(dead)) / draws
    has = _has(system) | ({"bound by resources"} if with_resources > by_logic else set())
    loss = found.loss(system.hours)
    if abs(by_logic - loss) > _deviation(loss, draws):
        return f"logic: {loss}, but sampled {by_logic}", has
    assert bounds.high is not None
    low, high = (bound * (1.0 - bound) and _deviation(bound, draws) for bound in (bounds.low, bounds.high))
    if not bounds.low - low <= with_resources <= bounds.high + high:
        return f"with real resources: {bounds}, but sampled {with_resources}", has
    return None, has


def _computed(system: System, order: int | None) -> tuple[Reliability, Bounds]:
    """Ask the product: the logic, and the bounds with real resources by cut sets of up to `order` (None: all)."""
    found = Reliability(system.spec, system.function, system.named, system.hazards)
    reach = [one for one in system.named if one in found.failure.reach]
    upto = len(reach) if order is None else order
    cuts = resource_sets(system.spec, system.function, reach, upto, list(found.sets.sets(10**6, upto)))
    return found, loss_bounds(found.failure, cuts, upto, system.hazards, system.hours)


def _equal(found: float, exact: float) -> bool:
    return abs(found - exact) <= RELATIVE * abs(exact) + 1e-14


def _deviation(share: float, draws: int) -> float:
    return DEVIATIONS * sqrt(share * (1.0 - share) / draws) + 1.0 / draws


def _has(system: System) -> set[str]:
    shown = {
        "common cause": bool(system.hazards.common),
        "replicated bus": any(one.startswith("channel:") for one in system.named),
        "shared actuator": bool(system.spec.drivers_of_one_actuator()),
        "on demand": bool(system.hazards.demands),
        f"{len(system.named)} elements": True,
    }
    return {word for word, holds in shown.items() if holds}


def compared(seeds: Iterator[int], *, most: int, draws: int | None) -> Iterator[tuple[int, str | None, set[str]]]:
    """Compare the systems of some seeds: added up, or sampled with so many draws."""
    for seed in seeds:
        rng = random.Random(seed)
        wrong, has = compare(rng, most=most) if draws is None else compare_sampled(rng, draws=draws)
        yield seed, wrong, has


def main() -> int:
    """Compare a range of seeds; returns the exit code."""
    parser = seed_parser(__doc__)
    parser.add_argument("--most", type=int, default=16, help="most elements of a system that is added up")
    parser.add_argument("--sampled", action="store_true", help="sample larger systems instead")
    parser.add_argument("--draws", type=int, default=100_000)
    arguments = parser.parse_args()
    draws = arguments.draws if arguments.sampled else None
    seeds = iter(range(arguments.first, arguments.end))
    found = compared(seeds, most=arguments.most, draws=draws)
    return report((seed, wrong, [*has, "compared"]) for seed, wrong, has in found)


if __name__ == "__main__":
    sys.exit(main())
