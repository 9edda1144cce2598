"""The verifier and the enumerator, written apart from the same page, agree on what is legal and on what it is worth."""

import random
from collections import Counter
from contextlib import suppress

from hypothesis import given, reject, settings
from hypothesis import strategies as st

from heronry_dg.configuration import Configuration
from heronry_dg.objective import score
from heronry_dg.situation import survivors
from heronry_dg.traffic import identifiers
from heronry_dg.verify import verify
from planner.enumerator import Enumerator, Structure, TooManyError
from planner.mutants import MUTATIONS, Tally, canonical, mutants_of_verifier, mutated
from planner.random_specs import features, random_case
from thoroughness import part_of

MOST = 300  # configurations of one spec that are looked at


def every_legal(enumerator: Enumerator) -> list[tuple[Configuration, Structure, dict[str, str]]]:
    """Return every legal configuration with its structure and places; a spec that has too many is not looked at."""
    try:
        return list(enumerator.every(most=MOST))
    except TooManyError:
        reject()


@given(st.randoms(use_true_random=False))
@settings(max_examples=part_of(150), deadline=None)
def test_they_agree_on_what_is_legal_and_on_its_worth(rng: random.Random) -> None:
    case = random_case(rng, modules=5)
    enumerator = Enumerator(case.spec, case.now)
    legal = every_legal(enumerator)
    known = {canonical(configuration) for configuration, _, _ in legal}
    assert len(known) == len(legal)
    for configuration, structure, places in rng.sample(legal, min(len(legal), 10)):
        assert verify(case.spec, case.now, configuration) == []
        objective = score(case.spec, case.now, configuration, case.running)
        assert objective.key() == enumerator.key(structure, places, case.running)
        changed = configuration
        for _ in range(rng.randint(1, 3)):
            changed = mutated(rng, case, changed)
            violations = verify(case.spec, case.now, changed)
            assert (violations == []) == (canonical(changed) in known), violations


def test_every_kind_of_mutation_makes_something_illegal_that_the_verifier_rejects() -> None:
    tally = Tally(Counter(), Counter(), Counter(), Counter(), [])
    for seed in range(160):
        with suppress(TooManyError):
            mutants_of_verifier(random.Random(seed), tally, origins=1)
    assert tally.wrong == []
    assert tally.rejected == tally.illegal
    assert {kind: tally.illegal[kind] for kind in MUTATIONS if not tally.illegal[kind]} == {}


@given(st.randoms(use_true_random=False))
@settings(max_examples=part_of(100), deadline=None)
def test_they_agree_on_what_faults_leave_and_on_the_order_of_urgency(rng: random.Random) -> None:
    case = random_case(rng)
    enumerator = Enumerator(case.spec, case.now)
    left = survivors(case.spec, case.now)
    assert list(left.pe_cpu_millis) == enumerator.pes_up
    assert {name: list(left.hosts(module)) for name, module in case.spec.modules.items()} == enumerator.hosts
    commanded = {ends: way for ends, way in enumerator.ways.items() if set(ends) <= set(enumerator.pes_up)}
    assert left.routes == commanded
    numbers = identifiers(case.spec)
    assert sorted(numbers, key=numbers.__getitem__) == enumerator.urgency


@given(st.randoms(use_true_random=False))
@settings(max_examples=part_of(60), deadline=None)
def test_nothing_legal_is_better_than_the_best(rng: random.Random) -> None:
    case = random_case(rng, modules=5)
    enumerator = Enumerator(case.spec, case.now)
    legal = every_legal(enumerator)
    key, configuration = enumerator.best(case.running)
    assert verify(case.spec, case.now, configuration) == []
    assert score(case.spec, case.now, configuration, case.running).key() == key
    assert key == max(enumerator.key(structure, places, case.running) for _, structure, places in legal)


def test_the_mixture_has_everything_in_it() -> None:
    seen, refused, served = Counter[str](), Counter[str](), 0
    for seed in range(300):
        case = random_case(random.Random(seed), modules=5)
        seen.update(features(case))
        enumerator = Enumerator(case.spec, case.now)
        _, best = enumerator.best(case.running)
        refused.update(set(enumerator.rejected))
        served += bool(best.modules)
    assert {name: count for name, count in seen.items() if count < 30} == {}
    assert all(refused[reason] >= 8 for reason in ("cpu", "ram", "flash", "separate", "together", "bus", "deadline"))
    assert served >= 150
