"""Deadlines that bind cost a search or two, not one search for each set of messages that is too large."""

import pytest

from heronry_dg.situation import situation
from heronry_dg.traffic import Hop
from heronry_dg.verify import verify
from heronry_manager.planner.deadlines import Deadlines
from heronry_manager.planner.exact import Planner
from lab.planner_race.generator import fault_cases, generate


@pytest.fixture
def verdicts(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether each solution that was looked at met all deadlines."""
    found: list[bool] = []
    are_met = Deadlines.are_met

    def noted(self: Deadlines, published: frozenset[Hop]) -> bool:
        found.append(are_met(self, published))
        return found[-1]

    monkeypatch.setattr(Deadlines, "are_met", noted)
    return found


def test_what_is_late_is_ruled_out_with_everything_that_could_delay_it(verdicts: list[bool]) -> None:
    spec = generate(6, 60, 12, 0.9)
    plan = Planner(spec).plan(situation(spec), effort=4.0)
    assert plan.optimal
    assert verify(spec, situation(spec), plan.configuration) == []
    assert 1 <= verdicts.count(False) <= 5


@pytest.mark.soak  # the test above rules out in every run; test_planner_against_enumerator.py has gateways
def test_what_comes_late_over_a_gateway_is_ruled_out_with_what_delays_it_on_both_buses(verdicts: list[bool]) -> None:
    spec = generate(11, 60, 12, 0.9)
    *_, case = fault_cases(spec, 11, 10)
    assert case.now.down == {"device:loop4_servo_a_device"}
    search = Planner(spec).serve(case.now, case.running)
    assert search.proven
    assert verify(spec, case.now, search.best) == []
    assert 1 <= verdicts.count(False) <= 5
