"""The choice of functions and modes without places: an upper bound of the served functions, often exact."""

import random

import pytest

from heronry_dg.situation import situation
from heronry_manager.planner.candidates import candidates
from heronry_manager.planner.choosing import Choosing
from heronry_manager.planner.cp_sat import CpModel
from heronry_manager.planner.exact import Planner
from heronry_manager.planner.levels import bounds_of, serving_levels
from heronry_manager.planner.placing import Placing
from lab.planner_race.generator import generate
from planner.random_specs import random_case


def test_nothing_legal_serves_more_than_can_be_chosen() -> None:
    reached = 0
    for seed in range(60):
        case = random_case(random.Random(seed))
        possible = candidates(case.spec, case.now)
        group = [level for level in serving_levels(Placing(CpModel(), possible)) if level.low < level.high]
        if group:
            key = Planner(case.spec).plan(case.now).objective.key()
            bound = Choosing(possible, group, key).bound()
            assert bound is not None
            most = list(bounds_of(group, bound, key))
            served = [level.value(key) for level in group]
            assert all(value <= bounded for value, bounded in zip(served, most, strict=True)), f"seed {seed}"
            reached += most == served
    assert reached > 30


@pytest.mark.parametrize("lost", ["pe:pe00", "pe:pe01", "pe:pe09"])
def test_a_crowded_aircraft_is_served_as_well_as_can_be_with_little_effort(lost: str) -> None:
    spec = generate(4, 60, 12, 1.5)
    planner, now = Planner(spec), situation(spec, [lost])
    search = planner.serve(now, effort=0.3)
    assert search.proven
    assert search.objective.key() > planner.immediate(now).objective.key()
