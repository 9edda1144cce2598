"""An input that is wired in some phases only (`only_in`): both planners, the verifier, and the sentence why not."""

import pytest

from heronry_dg.check.examples import whole_spec
from heronry_dg.configuration import Configuration
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, situation
from heronry_dg.verify import verify
from heronry_manager.planner.exact import plan
from heronry_manager.planner.greedy.planner import Greedy

TEXT = """
dg: 1
name: watched
buses: {can0: {bitrate: 1000000}}
pes: {one: {node_id: 92, buses: [can0], cpu: 1, ram: 1KiB, flash: 1KiB}}
variables: {speed: {type: FLOAT}, height: {type: FLOAT}}
modules:
  pitot: {gives: {speed: 1}, cpu: 0.1, ram: 0, rate_hz: 10}
  barometer: {gives: {height: 1}, cpu: 0.1, ram: 0, rate_hz: 10}
  show: {needs: {or: {k: 0, of: [{var: speed, only_in: [glide, land]}, height]}}, cpu: 0.1, ram: 0, rate_hz: 10}
  warn: {needs: {var: speed@1, only_in: [land]}, cpu: 0.1, ram: 0, rate_hz: 10}
phases: {climb: {}, glide: {}, land: {}}
functions: {showing: {output: show, priority: 2}, warning: {output: warn}}
"""
SPEC = loads(TEXT, "watched.dg.yaml")


def running(spec: Spec, phase: str | None) -> set[str]:
    now = Situation(phase=phase)
    exact, greedy = plan(spec, now), Greedy(spec).plan(now)
    assert exact.optimal
    assert verify(spec, now, greedy.configuration) == verify(spec, now, exact.configuration) == []
    assert exact.configuration == greedy.configuration
    return set(exact.configuration.modules)


@pytest.mark.parametrize(
    ("phase", "runs"),
    [
        ("climb", {"show", "barometer"}),
        ("glide", {"show", "barometer", "pitot"}),
        ("land", {"show", "barometer", "pitot", "warn"}),
    ],
)
def test_an_input_is_wired_in_its_phases_alone(phase: str, runs: set[str]) -> None:
    assert running(SPEC, phase) == runs


def test_a_mode_that_needs_a_closed_input_says_so() -> None:
    assert plan(SPEC, Situation(phase="climb")).functions["warning"].why_not == "warn reads speed only in phase land"


def test_the_verifier_refuses_a_wire_in_another_phase() -> None:
    wired = plan(SPEC, Situation(phase="glide")).configuration
    said = [str(one) for one in verify(SPEC, Situation(phase="climb"), wired)]
    where = 'rule 2.phase, module show, input "0"'
    assert said == [f"{where}: the input is wired in phase climb, and may be wired only in glide and land"]
    assert verify(SPEC, Situation(phase="land"), wired) == []


def test_nobody_steers_big_blue_who_is_not_wanted() -> None:
    big_blue = load(shipped_spec_path("big_blue"))
    for phase in big_blue.phases:
        now = situation(big_blue, phase=phase)
        wanted = {f.output for f in big_blue.functions.values() if now.priority_of(f) > 0}
        unwanted = {f.output for f in big_blue.functions.values()} - wanted
        found: Configuration = Greedy(big_blue).plan(now).configuration
        assert found.modules.keys().isdisjoint(unwanted), phase


def test_a_spec_without_such_inputs_is_the_same_in_every_phase() -> None:
    spec = loads(whole_spec("phases: {climb: {}, glide: {}}\n").decode(), "whole.dg.yaml")
    assert all(spec.in_phase(phase) is spec for phase in (None, *spec.phases))
    assert SPEC.in_phase(None) is SPEC
