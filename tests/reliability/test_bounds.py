"""Probabilities with common causes, replicated buses and resource limits, against adding up every set of failures."""

import itertools
import random
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import cache
from math import exp, expm1, sqrt

import pytest

from heronry_dg.loader import load
from heronry_dg.model import Bus, Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import elements
from heronry_tools.analysis.reliability.bounds import loss_bounds
from heronry_tools.analysis.reliability.chances import CommonCause, Hazards
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.mission import Reliability
from heronry_tools.analysis.reliability.resource_sets import resource_sets
from heronry_tools.analysis.servable import Planning
from planner.random_specs import random_spec
from reliability.brute_force import Losing, subsets
from thoroughness import part_of


def added_up(hazards: Hazards, hours: float, lost: Callable[[frozenset[str]], bool]) -> float:
    """Add the probabilities of all ways to fail after which something is lost; causes by the words of `chances`."""
    own = {name: 1.0 - exp(-rate * hours) for name, rate in hazards.rates.items()} | dict(hazards.demands)
    shares = dict.fromkeys(own, 0.0)
    causes = []
    for cause in hazards.common:
        if cause.elements[0] in hazards.rates:
            shared = cause.beta * min(hazards.rates[one] for one in cause.elements)
            causes.append((-expm1(-shared * hours), cause.elements))
        else:
            shared = cause.beta * min(hazards.demands[one] for one in cause.elements)
            causes.append((shared, cause.elements))
        for one in cause.elements:
            shares[one] += shared
    for name, share in shares.items():
        own[name] = (
            -expm1(-(hazards.rates[name] - share) * hours) if name in hazards.rates else hazards.demands[name] - share
        )
    total = 0.0
    for happening in itertools.product((False, True), repeat=len(causes)):
        weight = 1.0
        struck: set[str] = set()
        for happens, (chance, members) in zip(happening, causes, strict=True):
            weight *= chance if happens else 1.0 - chance
            struck |= set(members) if happens else set()
        for down in subsets(list(own)):
            if lost(frozenset(down | struck)):
                its = weight
                for name, chance in own.items():
                    its *= chance if name in down else 1.0 - chance
                total += its
    return total


def drawn_hazards(rng: random.Random, names: Collection[str]) -> Hazards:
    """Draw rates for some elements and probabilities for the others, and common causes within each kind."""
    listed = list(names)
    rated = [name for name in listed if rng.random() < 0.7]
    rates = {name: 10 ** rng.uniform(-4, -0.5) for name in rated}
    demands = {name: 10 ** rng.uniform(-4, -0.5) for name in listed if name not in rates}
    common = []
    for group in (list(rates), list(demands)):
        if len(group) > 1 and rng.random() < 0.7:
            common += [
                CommonCause(tuple(rng.sample(group, min(rng.choice((2, 3)), len(group)))), rng.uniform(0.01, 0.4))
            ]
    if len(rates) > 2 and rng.random() < 0.3:
        common.append(CommonCause(tuple(rng.sample(list(rates), 2)), 0.1))
    return Hazards(rates, demands, tuple(common))


def with_channels(rng: random.Random, spec: Spec) -> Spec:
    buses = {
        name: replace(bus, channels=rng.choice((1, 2, 2))) if bus.kind == "wired" else bus
        for name, bus in spec.buses.items()
    }
    return replace(spec, buses=buses)


def unservable(spec: Spec, function: str) -> Callable[[frozenset[str]], bool]:
    """Tell by a plan whether a function cannot be served with real resources; each set is planned for once."""
    planning = Planning(spec)
    return cache(lambda down: planning.all_at_once((function,), down).configuration is None)


@pytest.mark.parametrize("share", range(4))
def test_exact_probabilities_are_those_of_adding_up_every_way_to_fail(share: int) -> None:
    bound_by_resources = 0
    for seed in range(share, part_of(200, 5), 4):
        rng = random.Random(seed)
        spec = with_channels(rng, random_spec(rng, modules=4)).in_phase(None)
        function = rng.choice(list(spec.functions))
        possible = elements(spec)
        most = 14 if seed % 20 == 0 else 9
        chosen = rng.sample(possible, min(len(possible), most))
        hazards = drawn_hazards(rng, chosen)
        found = Reliability(spec, function, chosen, hazards)
        hours = rng.choice((0.5, 1.0, 20.0))
        lost = Losing(spec, function)
        assert found.loss(hours) == pytest.approx(added_up(hazards, hours, lost), rel=1e-9), seed
        assert found.survival(hours) == pytest.approx(1.0 - found.loss(hours), rel=1e-9, abs=1e-12)
        reach = [one for one in chosen if one in found.failure.reach]
        cuts = resource_sets(spec, function, reach, len(reach), list(found.sets.sets(10**6)))
        bounds = loss_bounds(found.failure, cuts, len(reach), hazards, hours)
        exact = added_up(hazards, hours, unservable(spec, function))
        assert bounds.exact
        assert bounds.low == pytest.approx(exact, rel=1e-9), seed
        bound_by_resources += bounds.low > found.loss(hours) * 1.001
        for order in (1, 2):
            some = [cut for cut in cuts if len(cut) <= order]
            partly = loss_bounds(found.failure, some, order, hazards, hours)
            assert partly.low <= exact * (1 + 1e-9), seed
            assert partly.high is not None
            assert partly.high >= exact * (1 - 1e-9), seed
    assert bound_by_resources


def test_sampling_agrees_where_nothing_can_be_added_up() -> None:
    """The elevator of the big aircraft, with common causes of the servos and of the PEs in the tail."""
    spec = load(shipped_spec_path("big_blue")).in_phase(None)
    rng = random.Random(3)
    named = [one for one in elements(spec) if not one.startswith("channel")]
    rates = {name: 10 ** rng.uniform(-2, -0.8) for name in named}
    drawn = (
        CommonCause(("device:elevator_servo_1", "device:elevator_servo_2"), 0.1),
        CommonCause(("pe:tail_a", "pe:tail_b"), 0.05),
    )
    found = Reliability(spec, "elevator", named, Hazards(rates, {}, drawn))
    causes = found.hazards.common
    chances = found.hazards.chances(1.0)
    formula, root = found.failure.formula, found.failure.root
    draws, lost = part_of(40_000), 0
    for _ in range(draws):
        happened = {name for name, chance in chances.items() if rng.random() < chance}
        for cause in causes:
            if cause.event in happened:
                happened |= set(cause.elements)
        lost += formula.evaluate(root, happened.__contains__)
    exact = found.loss(1.0)
    assert abs(lost / draws - exact) < 4.5 * sqrt(exact * (1 - exact) / draws)


def test_a_common_cause_leaves_each_element_as_likely_as_before() -> None:
    spec = load(shipped_spec_path("big_blue")).in_phase(None)
    pair = ("pe:tail_a", "pe:tail_b")
    hazards = Hazards({pair[0]: 2e-3, pair[1]: 1e-3}, {}, (CommonCause(pair, 0.1),))
    found = Reliability(spec, "elevator", pair, hazards)
    both = -expm1(-1e-4) + exp(-1e-4) * -expm1(-1.9e-3) * -expm1(-0.9e-3)
    assert found.loss(1.0) == pytest.approx(both, rel=1e-12)
    alone = Reliability(spec, "elevator", [pair[0], "pe:nav", "bus:can0"], hazards)
    assert [cause.elements for cause in alone.hazards.common] == [(pair[0],)]
    assert alone.hazards.chances(1.0)[alone.hazards.common[0].event] == -expm1(-1e-4)
    assert hazards.exactly([frozenset({pair[0]}), frozenset(pair)], 1.0) == pytest.approx(-expm1(-2e-3), rel=1e-12)


def test_mean_time_to_failure_of_a_chain_and_of_a_pair() -> None:
    spec = load(shipped_spec_path("big_blue")).in_phase(None)
    pair = {"pe:tail_a": 1e-3, "pe:tail_b": 1e-3}
    assert Reliability(spec, "elevator", pair, Hazards(pair)).mean_time_to_failure() == pytest.approx(1500.0, rel=1e-9)
    chain = {"pe:payload": 2e-4, "device:recorder": 3e-4}
    found = Reliability(spec, "flight_log", chain, Hazards(chain))
    assert found.mean_time_to_failure() == pytest.approx(2000.0, rel=1e-9)
    assert [value for _, value in found.curve(10.0, 2)] == pytest.approx([1.0, exp(-5e-4 * 5), exp(-5e-4 * 10)])
    never = Reliability(spec, "flight_log", chain, Hazards({}, {"pe:payload": 0.5}))
    assert never.mean_time_to_failure() == float("inf")
    assert never.loss(1e6) == 0.5


def test_a_bus_with_two_channels_is_down_when_both_are() -> None:
    spec = load(shipped_spec_path("elevator_and_chute"))
    bus: Bus = replace(spec.buses["can0"], channels=2)
    spec = replace(spec, buses={"can0": bus})
    found = Reliability(spec, "parachute", ["bus:can0", "channel:can0.1", "channel:can0.2"], Hazards())
    assert set(found.sets.sets(9)) == {frozenset({"bus:can0"}), frozenset({"channel:can0.1", "channel:can0.2"})}
    assert isinstance(found.sets, Solution)
