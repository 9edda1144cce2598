"""Code comes over the bus in simulated flights, whatever fails meanwhile."""

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.code import CodeCheck
from heronry_tools.sim.world.steps_seen import Driven
from lab.code_flights import bundle_for, fly, main
from thoroughness import mostly_soak

SPEC = load(shipped_spec_path("elevator_and_chute"))


@pytest.mark.parametrize("seed", mostly_soak(range(1, 41), [3, 15]))  # 15: a manager takes over while code is lacking
def test_code_comes_whatever_fails_meanwhile(seed: int) -> None:
    violations, brought = fly(SPEC, seed)
    assert violations == []
    assert brought


def test_with_a_key_it_comes_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--runs", "1", "--seed", "2", "--keyed"]) == 0
    assert capsys.readouterr().out == "1 flights of elevator_and_chute, 0 with a violation; code came in 1\n"


def test_an_arrival_of_which_the_disk_knows_nothing_ends_no_lack() -> None:
    simulation = Simulation(SPEC, 1, bundles=(bundle_for(SPEC, 1),))
    pe, module = next((pe, entry.name) for pe, table in simulation.fleet.tables.items() for entry in table.modules)
    simulation.fleet.lacks(pe, module)
    down = simulation.truth.situation.down
    assert any(one.startswith(f"module:{module}") for one in down)
    simulation.managers.code_brought(pe)
    assert simulation.truth.situation.down == down
    assert [one.rule for one in simulation.broken() if one.rule == "code"] == ["code"]


def step(pe: str, module: str, t_ns: int) -> Driven:
    return Driven(t_ns, pe, module, {}, t_ns)


def test_the_oracle_finds_a_step_without_code_and_a_bundle_that_is_not_whole() -> None:
    check = CodeCheck([b"bundle"])
    check.lacks(5, "nav", "estimator")
    check.driven(step("nav", "estimator", 4))
    check.looked(step("nav", "other", 9))
    check.looked(step("air", "estimator", 9))
    assert check.violations == []
    check.driven(step("nav", "estimator", 9))
    assert [one.story for one in check.violations] == ["estimator computes on nav, which lacks its code"]
    check.came(10, "nav", b"bundle")
    check.looked(step("nav", "estimator", 11))
    assert len(check.violations) == 1
    assert check.brought(11, "nav", b"bundle")
    assert len(check.violations) == 1
    assert not check.brought(11, "nav", None)
    assert "disk has no whole bundle in use" in check.violations.pop().story
    check.came(12, "nav", b"bund")
    assert check.violations[1].story == "nav runs code that is no whole bundle of the managers"
