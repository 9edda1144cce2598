"""The questions of the full check grow with the spec, and not with its square: calls are counted, not time."""

import re
from collections.abc import Callable
from itertools import chain as chain_of
from itertools import combinations
from random import Random
from typing import Any

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.loader import loads
from heronry_dg.verify import verify
from heronry_dg.why_not import Feasible
from heronry_manager.planner import candidates
from heronry_manager.planner.exact import Search, plan
from heronry_tools.analysis.check.redundancy import Dependence
from heronry_tools.analysis.check.single_faults import losses
from heronry_tools.analysis.servable import Planning, parts_of
from lab.benches.check import chain
from planner.random_specs import random_case
from thoroughness import part_of


def test_what_a_fault_takes_away_is_followed_to_its_readers_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def count(modules: int) -> int:
        """Count how often the search for losses asks whether inputs can hold, over all single faults of the spec."""
        calls = 0
        asked: Callable[..., bool] = Feasible.can_hold

        def counted(*arguments: Any) -> bool:
            nonlocal calls
            calls += 1
            return asked(*arguments)

        with monkeypatch.context() as patch:
            patch.setattr(Feasible, "can_hold", counted)
            Dependence(loads(chain(modules), "chain"))
        return calls

    few = count(50)
    assert (
        0 < count(100) < 3 * few
    )  # chains have ten modules each: a fault costs the modes behind it, however many chains there are


def critical_chain(modules: int) -> Planning:
    """Chains of ten modules whose outputs are of class B: a fault of any module loses its own chain."""
    text = chain(modules)
    return Planning(loads(re.sub(r"(output: m\d+)", r"\1, criticality: B", text), "chain"))


def test_a_fault_is_planned_for_no_function_that_it_does_not_touch(monkeypatch: pytest.MonkeyPatch) -> None:
    searches, looked_at = 0, 0
    searched, possible = Search.__init__, candidates._possible

    def counted_search(*arguments: Any, **named: Any) -> None:
        nonlocal searches
        searches += 1
        searched(*arguments, **named)

    def counted_modules(placeable: dict[str, Any]) -> dict[str, Any]:
        nonlocal looked_at
        looked_at += len(placeable)
        return possible(placeable)

    monkeypatch.setattr(Search, "__init__", counted_search)
    monkeypatch.setattr(candidates, "_possible", counted_modules)
    planning = critical_chain(100)
    found = list(losses(planning))
    assert {loss.element for loss in found} >= {"pe:p0", "module:m1", "module:m99", "device:d0"}
    assert searches == 1, "everything up; each fault leaves parts of that configuration"
    whole = 3 * 100  # with everything up, and for the losses of the PE and of the bus
    assert looked_at <= whole + 10 * len(found), "of a fault the chain that it touches"


@pytest.mark.parametrize("seed", range(part_of(400)))
def test_parts_of_a_legal_configuration_are_legal(seed: int) -> None:
    """What lets the check answer without a plan; the verifier is the judge."""
    case = random_case(Random(seed))
    spec, now = case.spec, case.now
    found = plan(spec, now, None, effort=0.1).configuration
    assert verify(spec, now, found) == []
    parts = parts_of(spec, found)
    for names in chain_of(combinations(parts, 1), combinations(parts, 2)):
        reduced = Configuration({m: one for m, one in found.modules.items() if any(m in parts[n] for n in names)})
        assert verify(spec, now, reduced) == []
