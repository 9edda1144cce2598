"""The questions of the full check grow with the spec, and not with its square: calls are counted, not time."""

from collections.abc import Callable
from typing import Any

import pytest

from heronry_dg.loader import loads
from heronry_dg.why_not import Feasible
from heronry_tools.analysis.check.redundancy import Dependence
from lab.benches.check import chain


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
