"""The planner on the shipped aircraft: every single fault, some double ones, a bad radio link; too large to enumerate.

Three things can be checked without brute force: the verifier accepts every plan, the proof is complete, and with fewer
resources no plan is better at levels 1 to 3 (each of its configurations was legal before).
"""

import itertools

import pytest

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.objective import placement
from heronry_dg.plan import Plan
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import elements, situation
from heronry_dg.verify import verify
from heronry_manager.planner.exact import plan
from thoroughness import sample


@pytest.fixture(scope="module")
def spec() -> Spec:
    return load(shipped_spec_path("big_blue"))


@pytest.fixture(scope="module")
def healthy(spec: Spec) -> dict[str, Plan]:
    return {phase: plan(spec, situation(spec, phase=phase)) for phase in spec.phases}


def worth(found: Plan) -> tuple[int, ...]:
    return (*found.objective.critical, found.objective.utility, found.objective.inputs)


def check(spec: Spec, before: Plan, down: tuple[str, ...], limits: tuple[str, ...] = ()) -> Plan:
    now = situation(spec, down, limits, before.now.phase)
    found = plan(spec, now, placement(before.configuration))
    assert verify(spec, now, found.configuration) == []
    assert found.optimal
    assert worth(found) <= worth(before)
    return found


def test_every_phase_has_a_plan_that_serves_all_that_is_critical(spec: Spec, healthy: dict[str, Plan]) -> None:
    for phase, found in healthy.items():
        assert found.optimal
        assert verify(spec, found.now, found.configuration) == []
        wanted = [f for f in spec.functions.values() if f.priority_in(phase) and f.criticality_in(phase) == "A"]
        assert all(found.functions[function.name].served for function in wanted)


def test_no_fault_of_one_element_leaves_the_planner_without_a_proven_legal_plan(
    spec: Spec, healthy: dict[str, Plan]
) -> None:
    for element in sample(elements(spec)):
        check(spec, healthy["glide"], (element,))


def test_two_processors_at_once(spec: Spec, healthy: dict[str, Plan]) -> None:
    for pair in itertools.combinations(["pe:flight", "pe:nav", "pe:comms", "pe:payload"], 2):
        check(spec, healthy["landing"], pair)


def test_a_radio_that_fades_carries_less_and_less_and_never_too_much(spec: Spec, healthy: dict[str, Plan]) -> None:
    before = worth(healthy["glide"])
    for percent in (80, 50, 20, 5, 0):
        found = check(spec, healthy["glide"], (), (f"bus:radio={percent}%",))
        assert worth(found) <= before
        before = worth(found)
        assert found.buses["radio"].bits_per_s <= 78_750 * percent // 100  # of 112 500 bit/s at 70 %
