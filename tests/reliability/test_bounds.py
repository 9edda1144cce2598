"""Probabilities with common causes, replicated buses and resource limits, against adding up every set of failures."""

import random
from dataclasses import replace
from math import exp, expm1, sqrt

import pytest

from heronry_dg.loader import load
from heronry_dg.model import Bus
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import elements
from heronry_tools.analysis.reliability.chances import CommonCause, Hazards
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.mission import Reliability
from reliability.systems import MUST_APPEAR, compared
from thoroughness import IS_WHOLE, part_of


@pytest.mark.parametrize("share", range(2))
def test_exact_probabilities_are_those_of_adding_up_every_way_to_fail(share: int) -> None:
    """In `make test` small systems; all of up to 16 elements in `make soak`."""
    seeds = iter(range(share, part_of(200, 5), 2))
    has: set[str] = set()
    for seed, wrong, its in compared(seeds, most=16 if IS_WHOLE else 9, draws=None):
        assert wrong is None, f"PYTHONPATH=tests python -m reliability.systems {seed} {seed + 1}: {wrong}"
        has |= its
    assert {word for word in MUST_APPEAR if word not in has} == set()


def test_sampling_agrees_where_there_are_too_many_ways_to_fail() -> None:
    for seed, wrong, _ in compared(iter(range(part_of(48))), most=30, draws=part_of(100_000, 20)):
        assert wrong is None, f"PYTHONPATH=tests python -m reliability.systems {seed} {seed + 1} --sampled: {wrong}"


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
