"""A sweep gives for every fault set the plan that a search would give, with few searches."""

import random
from collections.abc import Iterable, Iterator
from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load
from heronry_dg.losses import lost_elements, used_elements
from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, elements, situation
from heronry_dg.verify import verify
from heronry_manager.planner.exact import plan
from heronry_manager.planner.safe_mode import safe_mode
from heronry_manager.planner.sweep import Answer, Outcome, Question, Scope, Sweep
from planner.comparison import crossing_case
from planner.random_specs import random_spec
from thoroughness import part_of

CHUTE = load(shipped_spec_path("elevator_and_chute"))


class Asked:
    """Answers with the planner, and keeps the questions."""

    def __init__(self, spec: Spec, *, proven: bool = True) -> None:
        self.spec, self.proven = spec, proven
        self.questions: list[Question] = []

    def __call__(self, size: int, questions: Iterable[Question]) -> Iterator[Answer]:
        for question in questions:
            assert len(question.down) == size
            self.questions.append(question)
            found = plan(self.spec, Situation(question.down, {}, question.phase), question.running)
            yield question, Outcome(found.configuration, found.objective, found.optimal and self.proven)


def scope_of(spec: Spec, faults: int) -> Scope:
    return Scope(elements(spec), faults, tuple(spec.phases) or (None,))


def assert_exact(spec: Spec, scope: Scope) -> Sweep:
    """Every outcome is legal, and worth what a search of its own finds, level by level."""
    swept = Sweep(spec, scope)
    swept.run(Asked(spec))
    unpruned = Sweep(spec, scope, prune=False)
    unpruned.run(Asked(spec))
    assert swept.outcomes.keys() == unpruned.outcomes.keys()
    for (phase, down), outcome in swept.outcomes.items():
        now = Situation(down, {}, phase)
        assert verify(spec, now, outcome.configuration) == [], (phase, down)
        assert outcome.objective == unpruned.outcomes[phase, down].objective, (phase, down)
        running = swept.running(phase) if down else None
        assert outcome.objective == score(spec, now, outcome.configuration, running), (phase, down)
    assert unpruned.tally.pruned_share() == 0.0
    return swept


def test_pruning_changes_nothing_on_figure_3() -> None:
    swept = assert_exact(CHUTE, scope_of(CHUTE, 2))
    assert swept.tally.pruned_share() > 0.7


@settings(max_examples=part_of(12))
@given(st.randoms(use_true_random=False), st.booleans())
def test_pruning_changes_nothing_on_random_specs(rng: random.Random, crossing: bool) -> None:
    spec = crossing_case(rng, modules=4).spec if crossing else random_spec(rng, modules=4)
    assert_exact(spec, scope_of(spec, 2))


def test_pruning_changes_nothing_where_a_bus_is_doubled() -> None:
    spec = replace(CHUTE, buses={"can0": replace(CHUTE.buses["can0"], channels=2)})
    wires = tuple(one for one in elements(spec) if one.startswith(("bus:", "channel:", "pe:")))
    swept = assert_exact(spec, Scope(wires, 2, (None,)))
    both = frozenset({"channel:can0.1", "channel:can0.2"})
    assert swept.outcomes[None, frozenset({"channel:can0.1"})] is swept.outcomes[None, frozenset()]
    assert swept.outcomes[None, both].configuration == Configuration()


def test_what_follows_from_a_fault_is_not_asked_again() -> None:
    asked = Asked(CHUTE)
    swept = Sweep(CHUTE, scope_of(CHUTE, 2))
    swept.run(asked)
    downs = [question.down for question in asked.questions]
    assert frozenset({"pe:tail_pe"}) in downs
    assert frozenset({"pe:tail_pe", "device:elevator_servo_1"}) not in downs  # it went with its PE
    assert (frozenset({"device:gps"}) in downs) != (frozenset({"module:gps_driver"}) in downs)  # twins
    assert len(asked.questions) == swept.tally.searched
    total = swept.tally.searched + swept.tally.by_plan + swept.tally.by_twin
    assert total == len(swept.outcomes) == scope_of(CHUTE, 2).set_count()


def test_a_missing_proof_is_inherited() -> None:
    swept = Sweep(CHUTE, Scope(("module:low_quality_altitude",), 1, (None,)))
    swept.run(Asked(CHUTE, proven=False))
    assert swept.tally.by_plan == 1
    assert not any(outcome.optimal for outcome in swept.outcomes.values())


def test_more_faults_than_elements_are_all_of_them() -> None:
    scope = Scope(("device:gps",), 5, (None,))
    assert list(scope.fault_sets()) == [frozenset(), frozenset({"device:gps"})]
    assert scope.set_count() == 2


@settings(max_examples=part_of(40))
@given(st.randoms(use_true_random=False), st.booleans(), st.data())
def test_a_plan_stays_legal_exactly_as_long_as_nothing_it_uses_is_lost(
    rng: random.Random, crossing: bool, data: st.DataObject
) -> None:
    spec = crossing_case(rng, modules=5).spec if crossing else random_spec(rng, modules=5)
    found = plan(spec, situation(spec)).configuration
    down = frozenset(data.draw(st.sets(st.sampled_from(elements(spec)), max_size=3)))
    now = situation(spec, down)
    lives_on = used_elements(spec, found).isdisjoint(lost_elements(spec, now))
    assert lives_on == (verify(spec, now, found) == [])
    if lives_on:
        assert score(spec, now, found, None) == score(spec, situation(spec), found, None)


def test_safe_mode_serves_what_is_critical_and_moves_nothing_without_need() -> None:
    spec = load(shipped_spec_path("big_blue"))
    healthy = plan(spec, Situation(phase="glide")).configuration
    running = {name: (one.mode, one.pe) for name, one in healthy.modules.items()}
    safe = safe_mode(spec, "glide", running)
    assert verify(spec, Situation(phase="glide"), safe) == []
    assert score(spec, Situation(phase="glide"), safe, None).critical == (
        score(spec, Situation(phase="glide"), healthy, None).critical
    )
    assert "experimental_autopilot" in healthy.modules
    assert "experimental_autopilot" not in safe.modules
    assert {name: (one.mode, one.pe) for name, one in safe.modules.items()}.items() <= running.items()


def test_the_managers_bus_takes_everything_along() -> None:
    lost = lost_elements(CHUTE, Situation(frozenset({"bus:can0"})))
    assert {f"pe:{pe}" for pe in CHUTE.pes} <= lost
    assert {f"device:{device}" for device in CHUTE.devices} <= lost
