"""The oracle of silences finds a PE that reports what is not silent, one that reports too late, and a mute one."""

from collections.abc import Iterable
from pathlib import Path

import pytest

from heronry_agent.core.modules import silence_watch
from heronry_agent.core.modules.silence_watch import SilenceWatch
from heronry_agent.core.reports import SilenceReports
from heronry_dg.loader import load
from heronry_manager.events import InputSilent, OutputSilent, SilenceOver
from heronry_tools.sim.faults.fault import Fault, read_fault
from heronry_tools.sim.flight.outcome import Outcome, Scenario, play
from heronry_tools.sim.flight.simulation import Simulation
from heronry_wire.frame import Frame
from heronry_wire.silence import Silence
from lab import stale
from scenarios.flights import elevator_and_chute

SPARE = load(Path(__file__).parents[1] / "scenarios/spare_barometer.dg.yaml")
FAIL_OVER = load(Path(__file__).parents[2] / "dg_specs/examples/fail_over.dg.yaml")
DEATH = "0.4 crash pe:right"
SILENT = "0.5 silent module:state_estimator for 1.5"


def flown(*faults: str, seed: int = 3, seconds: float = 3.0) -> tuple[Outcome, Simulation]:
    spec = elevator_and_chute()
    begun: list[Simulation] = []
    scenario = Scenario(seed, seconds, tuple(read_fault(spec, one) for one in faults), drawn=True)
    outcome = play(spec, scenario, lambda simulation, _: begun.append(simulation))
    return outcome, begun[0]


def rules(outcome: Outcome) -> set[str]:
    return {one.rule for one in outcome.violations}


def test_a_silence_is_told_and_its_end_and_nothing_is_violated() -> None:
    outcome, simulation = flown(SILENT)
    assert outcome.violations == ()
    outputs, inputs = simulation.events_of(OutputSilent), simulation.events_of(InputSilent)
    assert [(one.module, one.variable) for one in outputs] == [("state_estimator", "state_info")]
    assert ("elevator_control", "state_info", "state_estimator") in {
        (one.module, one.variable, one.producer) for one in inputs
    }
    assert len(simulation.events_of(SilenceOver)) == len(outputs) + len(inputs)


def test_one_output_of_several_may_be_silent() -> None:
    spec = elevator_and_chute()
    assert read_fault(spec, "1 silent module:gps_driver level 1").level == 1


def test_it_finds_a_pe_that_does_not_wait_long_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(silence_watch, "silent_after_ns", lambda period_ns, _: 2 * period_ns)
    assert rules(flown(SILENT)[0]) == {"stale"}


def test_it_finds_a_pe_that_reports_what_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    def look(self: SilenceWatch, _modes: object, now_ns: int, *, is_steady: bool) -> Iterable[Frame]:
        if is_steady and self._inputs:
            self._reports.begun(self._inputs[0].module, self._inputs[0].silence, now_ns)
        return self._reports.tick(now_ns)

    monkeypatch.setattr(SilenceWatch, "look", look)
    assert "stale" in rules(flown(SILENT)[0])


def test_it_finds_a_pe_that_reports_too_late(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        silence_watch, "silent_after_ns", lambda period_ns, lease_ns: 12 * max(period_ns, lease_ns // 5)
    )
    assert rules(flown(SILENT)[0]) == {"stale"}


def test_it_finds_a_pe_that_reports_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SilenceReports, "tick", lambda *_: ())
    assert rules(flown(SILENT)[0]) == {"stale"}
    assert flown(SILENT, "2.5 reboot pe:control_pe for 0.03")[0].violations == ()  # not promised beside other faults


def test_it_finds_a_pe_that_gives_a_new_producer_no_time_to_load(monkeypatch: pytest.MonkeyPatch) -> None:
    """A silent module moves to another PE, where it never gives a datum."""

    def flown() -> tuple[set[str], list[int]]:
        begun: list[Simulation] = []
        faults = tuple(read_fault(FAIL_OVER, one) for one in ("0.2 silent module:chute_logic", DEATH))
        outcome = play(FAIL_OVER, Scenario(39, 7.0, faults), lambda simulation, _: begun.append(simulation))
        return rules(outcome), [one.t_ns // 10**9 for one in begun[0].events_of(InputSilent)]

    assert flown() == (set(), [6])
    monkeypatch.setattr(silence_watch, "START_UP_WINDOW_NS", 0)
    assert flown() == ({"stale"}, [1])


def test_it_finds_an_input_that_is_not_wired(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = SilenceReports.begun

    def shifted(self: SilenceReports, module: int, silence: Silence, since_ns: int) -> None:
        begun(self, module, Silence(silence.number + 7, silence.is_output), since_ns)

    monkeypatch.setattr(SilenceReports, "begun", shifted)
    assert "stale" in rules(flown(SILENT)[0])


def test_a_dead_pe_is_not_told_as_silent() -> None:
    for seed in range(4):
        outcome, simulation = flown("0.5 crash pe:sensor_pe for 0.8", seed=seed)
        assert outcome.violations == ()
        assert simulation.events_of(InputSilent) == []
        assert simulation.events_of(OutputSilent) == []


def test_undisturbed_flights_tell_nothing_and_those_with_one_silence_are_in_time() -> None:
    """A few flights of the campaign `python -m lab.stale`."""
    flights = [stale.Flight(seed, kind) for kind in ("undisturbed", "one silence") for seed in range(2)]
    for spec in (elevator_and_chute(), SPARE):
        results = [stale.fly(spec, flight) for flight in flights]
        assert not any(map(stale.is_wrong, results)), results
        assert any(one.told for one in results)
        assert len(list(stale.report("any", results))) == 6


def test_a_silence_leads_to_a_failure_only_where_the_spec_says_so() -> None:
    fault = Fault(500, "silent", "module:pressure_driver")
    outcome = play(SPARE, Scenario(1, 2.0, (fault,), drawn=True))
    assert outcome.violations == ()
    assert len(outcome.reconfigurations) == 2
