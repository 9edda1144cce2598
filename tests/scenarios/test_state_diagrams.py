"""The state diagrams of docs/protocol.md, held against flights: whatever a core does is drawn.

That all that is drawn can be done is shown for the PE in tests/tools/test_docs_tables.py.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import Any

import pytest

from heronry_manager.core import ManagerCore, Reign
from heronry_manager.health import Health, Standing
from heronry_manager.reconfiguration import Reconfiguration, Stage
from heronry_tools.scenario.in_simulator import fly
from heronry_tools.scenario.script import read_script
from heronry_tools.simulator.chaos import drawn_acts
from heronry_tools.simulator.scenario import Scenario, play
from scenarios.flights import two_tails

PAGE = Path("docs/protocol.md").read_text(encoding="utf-8")
SEEDS = range(4)
Changes = set[tuple[str, str]]


def drawn(kind: type[Enum]) -> Changes:
    """Arrows of the diagram whose states are those of a kind."""
    for block in re.findall(r"```mermaid\nstateDiagram-v2\n(.*?)```", PAGE, re.DOTALL):
        arrows = set(re.findall(r"(\w+) --> (\w+)", block))
        if {state for arrow in arrows for state in arrow} <= set(kind.__members__):
            return arrows
    raise AssertionError(f"no diagram draws {kind.__name__}")


@contextmanager
def watched(owner: type, attribute: str, seen: Changes) -> Iterator[None]:
    """Note every change of a state that some object of a class keeps."""

    def change(self: Any, name: str, value: object) -> None:
        held = getattr(self, "__dict__", None)  # a default of the class is no state that this object was in
        before = getattr(self, attribute, None) if held is None or attribute in held else None
        if name == attribute and isinstance(before, Enum) and isinstance(value, Enum) and before is not value:
            seen.add((before.name, value.name))
        object.__setattr__(self, name, value)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(owner, "__setattr__", change)
        yield


def test_whatever_happens_in_flights_with_faults_is_drawn() -> None:
    record = type(next(iter(Health(two_tails(), 0, 0)._records.values())))
    stages, standings, reigns = Changes(), Changes(), Changes()
    with (
        watched(Reconfiguration, "stage", stages),
        watched(record, "standing", standings),
        watched(ManagerCore, "_reign", reigns),
    ):
        for seed in SEEDS:
            assert play(two_tails(), Scenario(seed, 6.0, drawn_acts(two_tails(), seed, 6.0))).violations == ()
        for name in ("both_managers_restart", "a_paused_manager_returns", "the_bus_between_two_managers_is_cut"):
            assert fly(read_script(Path(f"tests/scenarios/{name}.scenario"))).holds
    assert stages <= drawn(Stage)
    assert standings <= drawn(Standing)
    assert reigns <= drawn(Reign)
    assert min(len(stages), len(standings), len(reigns)) >= 5
