"""A process that is stopped for a while says afterwards that its computer stood still; a failing module says why."""

from collections.abc import Iterator
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest

from heronry_dg.loader import load
from heronry_manager.core.vocabulary import AskStatus, AskTraceback
from heronry_manager.events import ModuleFailed, StoodStill
from heronry_manager.events.line import to_object
from heronry_manager.shell.control_client import call
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.fleet import Fleet, run_folder
from live.told_events import E

pytestmark = [pytest.mark.live, pytest.mark.timing]  # a busy PE answers the reading of its objects too late
STOPPED_S, PATIENCE_S = 0.5, 30.0
SICK = """
from heronry_agent.module import Module


class Estimator(Module):
    def step(self, inputs):
        raise ValueError("no estimate \\x1b[2J")
"""


class Flight:
    """A manager and all PEs of a spec as processes, and the manager's events."""

    def __init__(self, fleet: Fleet, events: AwaitedEvents) -> None:
        self.fleet, self._events = fleet, events

    def until(self, kind: type[E], **fields: Any) -> E:
        while True:
            told = self._events.wait(kind)  # raises SystemExit if none comes
            if fields.items() <= to_object(told).items():
                return told

    def until_stood_still(self, by: str) -> None:
        """Wait for a standstill of about STOPPED_S; shorter ones are those of this computer."""
        end_s = monotonic() + PATIENCE_S
        while self.until(StoodStill, by=by).for_ns < STOPPED_S * 1e9 / 2:
            assert monotonic() < end_s

    def status(self) -> dict[str, Any]:
        found = call(self.fleet.control_socket(126), AskStatus()).status
        assert found is not None
        return dict(found)


@pytest.fixture
def flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Flight]:
    """Figure 3 of the paper, whose state estimator fails in its first step."""
    (tmp_path / "no_estimate.py").write_text(SICK)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    text = Path("dg_specs/elevator_and_chute.dg.yaml").read_text()
    file = tmp_path / "sick.dg.yaml"
    file.write_text(text.replace("state_estimator: {", "state_estimator: {image: 'no_estimate:Estimator', "))
    spec, folder = load(file), run_folder()
    with Fleet(spec, file, folder) as fleet:
        fleet.start_buses(choose(spec, folder, {}, None, prefer_vcan=False))
        events = AwaitedEvents(fleet, fleet.start_manager())
        for pe in spec.pes:
            fleet.start_pe(pe)
        yield Flight(fleet, events)


def test_what_only_the_nodes_know_comes_to_the_manager(flight: Flight) -> None:
    failed = flight.until(ModuleFailed, element="module:state_estimator")
    assert failed.text == "ValueError: no estimate \\x1b[2J (no_estimate.py:7)"
    end_s, ask = monotonic() + PATIENCE_S, AskTraceback("module:state_estimator")
    while not (traceback := call(flight.fleet.control_socket(126), ask)).done:  # a busy PE answers a read too late
        assert monotonic() < end_s, traceback.sentence
    assert 'no_estimate.py", line 7, in step' in traceback.sentence
    assert {one["text"] for one in flight.status()["failures"]} == {failed.text}
    flight.fleet.stop("tail_pe")
    sleep(STOPPED_S)
    flight.fleet.go_on("tail_pe")
    flight.until_stood_still("tail_pe")
    flight.fleet.stop(126)
    sleep(STOPPED_S)
    flight.fleet.go_on(126)
    flight.until_stood_still("manager 126")
    assert flight.status()["manager"]["standstills"]["longest_ms"] >= STOPPED_S * 1e3 / 2
    end_s = monotonic() + PATIENCE_S
    while any((cost := pe["cost"]) is None for pe in flight.status()["pes"].values() if pe["state"] == "up"):
        assert monotonic() < end_s
        sleep(STOPPED_S)
    assert 0 < cost["agent_per_mille"] < 1000 * cost["wake_ups_per_s"]
    assert cost["longest_turn_us"] > 0
