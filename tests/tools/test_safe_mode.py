"""`without_manager: safe_mode`: what is marked as expendable, and the oracle of what stops."""

from dataclasses import replace
from functools import cache

import pytest

from heronry_agent.core.configuration import ActiveConfiguration
from heronry_dg.expendable import expendable
from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_manager.core.tables.compilation import Compiler
from heronry_tools.recording.commanded import Commanded
from heronry_tools.sim.oracles.oracle import StateSaid
from heronry_tools.sim.oracles.safe_mode import SafeModeCheck, rests
from heronry_tools.sim.world.planning import best_plan
from heronry_wire.configuration_slice import decode_slice
from heronry_wire.state_frames import PeFlags, PeState, StatePage0
from scenarios.flights import MS, flying

RECORDING = {"flight_recorder", "battery_driver"}


@cache
def recorder() -> Spec:
    return load("tests/scenarios/safe_mode.dg.yaml")


def marked(spec: Spec) -> set[str]:
    """Modules that the slices of the best configuration mark, on any PE."""
    compiler, names = Compiler(spec), list(spec.modules)
    slices = compiler.configuration(best_plan(spec, Situation(), None).configuration).slices
    leaves = {pe.node_id: compiler.table(pe.name).leaf_counts() for pe in spec.pes.values()}
    return {names[module] for node, body in slices.items() for module in decode_slice(body, leaves[node]).expendable}


def test_what_serves_nothing_critical_is_marked_where_the_policy_is_safe_mode() -> None:
    assert marked(recorder()) == RECORDING
    assert marked(replace(recorder(), manager=replace(recorder().manager, without_manager="keep"))) == set()


@pytest.mark.parametrize("phase", ["ascent", "glide", "landing"])
def test_the_planner_s_side_and_the_verifier_agree_on_what_is_expendable(phase: str) -> None:
    spec = load(shipped_spec_path("big_blue"))
    configuration = best_plan(spec, Situation(phase=phase), None).configuration
    found = expendable(spec, configuration)
    assert found == rests(spec, configuration)
    assert found
    assert not any(wire.producer in found for consumer, _, wire in configuration.wires() if consumer not in found)


def alone_for_a_second(seed: int) -> list[str]:
    simulation = flying(recorder(), seed)
    simulation.managers.kill()
    simulation.run_for(1_000 * MS)
    return [violation.story for violation in simulation.broken() if violation.rule == "policy"]


def test_a_flight_in_which_expendable_modules_stop_breaks_nothing() -> None:
    assert alone_for_a_second(4) == []


def test_a_flight_that_goes_on_with_everything_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ActiveConfiguration, "expendable_live", lambda _: frozenset[int]())
    stories = alone_for_a_second(4)
    assert {story.split(" without")[0].split(" of ")[-1].split(" drives")[0] for story in stories} == RECORDING


def test_nothing_is_verified_where_the_configuration_is_not_known() -> None:
    check = SafeModeCheck(recorder(), Commanded(recorder()))
    check.leased(0)
    check.told(StateSaid(500 * MS, "can0", 0, "flight", StatePage0(PeState.ACTIVE, PeFlags(0), 1, 9, 0, 7)))
    assert check.violations == []
