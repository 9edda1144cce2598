"""The planner and brute force agree on the value of the best plan, level by level; the verifier accepts the plan."""

import random
from collections import Counter

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from planner.comparison import MUST_APPEAR, compare, crossing_case
from planner.enumerator import TooManyError
from planner.random_specs import random_case, with_checkpoints
from thoroughness import part_of


@settings(max_examples=part_of(150), deadline=None)
@given(st.randoms(use_true_random=False), st.booleans())
def test_the_plan_is_legal_and_as_good_as_any(rng: random.Random, crossing: bool) -> None:
    case = crossing_case(rng, modules=5) if crossing else random_case(rng, modules=5)
    try:
        wrong, _ = compare(case)
    except TooManyError:
        assume(False)
    else:
        assert wrong is None


@pytest.mark.soak
def test_the_same_holds_on_cases_that_use_every_gate_rule_and_level() -> None:
    counts: Counter[str] = Counter()
    for seed in range(200):
        draw = crossing_case if seed % 2 else random_case
        try:
            wrong, used = compare(draw(random.Random(seed)))
        except TooManyError:
            continue
        assert wrong is None, f"seed {seed}: {wrong}"
        counts.update(used)
    assert {word: counts[word] for word in MUST_APPEAR if counts[word] < 2} == {}


@settings(max_examples=part_of(60), deadline=None)
@given(st.randoms(use_true_random=False), st.booleans())
def test_checkpoints_take_their_share_of_the_buses(rng: random.Random, crossing: bool) -> None:
    case = crossing_case(rng, modules=5) if crossing else random_case(rng, modules=5)
    try:
        wrong, _ = compare(with_checkpoints(rng, case))
    except TooManyError:
        assume(False)
    else:
        assert wrong is None


@pytest.mark.soak
def test_checkpoints_change_which_plan_is_the_best() -> None:
    counts: Counter[str] = Counter()
    for seed in range(100):
        draw = crossing_case if seed % 2 else random_case
        try:
            wrong, used = compare(with_checkpoints(random.Random(seed), draw(random.Random(seed))))
        except TooManyError:
            continue
        assert wrong is None, f"seed {seed}: {wrong}"
        counts.update(used)
    assert counts["checkpoints"] > 20
    assert counts["binding checkpoints"] > 5
