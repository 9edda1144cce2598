"""Operators who give random scripts under faults: no oracle is violated, and a defect is found."""

import json

import pytest

from heronry_manager.core.situation import HeldScript
from heronry_tools.console.spec_files import load_spec
from lab.scripts_in_flight import FlightOfScripts, fly, main
from thoroughness import part_of


def test_flights_of_random_scripts_violate_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    specs = ["elevator_and_chute", "dg_specs/examples/demux_actuators.dg.yaml"]
    options = ["--runs", str(part_of(40, 13)), "--standby", "--seconds", "4", "--seed", "77", "--json"]
    assert main([*specs, *options]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["violations"] == []
    assert {"broken refused", "legal taken", "stale taken"} <= told["orders"].keys()


def test_the_same_seed_gives_the_same_flight() -> None:
    spec, flight = load_spec("elevator_and_chute"), FlightOfScripts(3, 3.0, standby=False)
    assert fly(spec, flight).digest == fly(spec, flight).digest


def test_a_manager_that_holds_on_to_a_released_script_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(HeldScript, "release", lambda _: True)
    spec = load_spec("elevator_and_chute")
    flown = (fly(spec, FlightOfScripts(seed, 5.0, standby=False)) for seed in range(3, 30))
    assert any("announces a script" in violation for result in flown for violation in result.violations)
