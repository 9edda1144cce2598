"""Deadlines that bind cost a search or two, not one for each set of messages that would be too many."""

import pytest

from heronry_dg.situation import Situation
from heronry_dg.traffic import Hop
from heronry_dg.verify import verify
from heronry_manager.planner.deadlines import Deadlines
from heronry_manager.planner.exact import Planner
from heronry_tools.planner_bench.generator import generate


def test_what_is_late_is_ruled_out_with_everything_that_could_delay_it(monkeypatch: pytest.MonkeyPatch) -> None:
    verdicts: list[bool] = []
    are_met = Deadlines.are_met

    def noted(self: Deadlines, published: frozenset[Hop]) -> bool:
        verdicts.append(are_met(self, published))
        return verdicts[-1]

    monkeypatch.setattr(Deadlines, "are_met", noted)
    spec = generate(6, 60, 12, 0.9)
    plan = Planner(spec).plan(Situation(), effort=4.0)
    assert plan.optimal
    assert verify(spec, Situation(), plan.configuration) == []
    assert 1 <= verdicts.count(False) <= 5
