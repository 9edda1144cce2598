"""BIG BLUE through agents, frames and plans: phases by their own rules, home; whole flights are in the long tests."""

import json
from itertools import pairwise

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main

pytest.importorskip("jsbsim")

from heronry_tools.fly.glider_campaign import figures, line, missions, summary
from heronry_tools.fly.glider_flight import GliderFlight, fly_glider
from heronry_tools.fly.glider_mission import GliderMission
from heronry_tools.fly.mission import Blow

SPEC = load(shipped_spec_path("big_blue"))


def test_a_released_aircraft_enters_its_phases_by_their_own_rules_and_is_guided() -> None:
    mission = GliderMission(3, "landing", blows=(Blow("pe:flight", at_s=4.0),), judged=True, longest_s=8.0)
    landing, record = GliderFlight(SPEC, mission).fly()
    assert [phase for phase, _ in landing.phases] == ["landing"]
    assert landing.phases[0][1] < 2.0
    assert landing.guided
    assert landing.violations == ()
    assert landing.touchdown is None
    assert "has not landed" in line(landing)
    kinds = [mark.kind for mark in record.marks]
    assert kinds.index("fault") < len(kinds) - 1 - kinds[::-1].index("reconfigured")
    assert record.site == "field"
    loads = [load for load in record.columns["load_can0"] if load is not None]
    assert 0.05 < max(loads) < 0.8
    abrupt = [after - before for before, after in pairwise(record.columns["roll_deg"])]
    assert max(map(abs, abrupt)) < 10.0  # the dead PE is not felt as a jerk


@pytest.mark.soak
def test_whole_flights_from_the_ground_to_the_ground() -> None:
    for mission in missions(SPEC, GliderMission(judged=True), 2, one_fault=False):
        landing = fly_glider(SPEC, mission)
        assert landing.causes == (), line(landing)
        assert [phase for phase, _ in landing.phases] == ["deployment", "glide", "landing"]
        assert landing.released_m > 19_000
        assert landing.violations == ()
        assert not landing.chute


@pytest.mark.soak
def test_where_guidance_is_kept_a_single_fault_lets_it_come_home() -> None:
    flown = [
        fly_glider(SPEC, one) for one in missions(SPEC, GliderMission(start="glide", judged=True), 5, one_fault=True)
    ]
    found = summary(flown)
    assert found["violations"] == 0
    assert found["kept"]["acceptable"] == found["kept"]["runs"], figures(found)


@pytest.mark.soak
@pytest.mark.parametrize("how", ["dead", "stuck"])
def test_a_rudder_servo_that_fails_in_the_glide_is_replaced_by_the_other_one(how: str) -> None:
    blow = Blow("device:rudder_servo_1", at_s=15.0, how=how)
    landing = fly_glider(SPEC, GliderMission(seed=147, start="glide", judged=True, blows=(blow,)))
    assert landing.guided
    assert (landing.causes, landing.violations) == ((), ()), line(landing)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["elevator_and_chute"], "does not have the devices of an aircraft"),
        (["eav", "--phase", "glide"], "only big_blue can begin in another phase"),
        (["big_blue", "--without-rover"], "are for the EAV"),
        (["big_blue", "--wind", "40"], "0 to 15 m/s"),
        (["big_blue", "--live"], "only the EAV"),
        (["eav", "--runs", "2", "--record", "x.json"], "of one flight"),
    ],
)
def test_what_an_aircraft_does_not_have_is_refused(arguments, message, capsys) -> None:
    assert main(["fly", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_the_figures_of_many_flights_are_those_of_the_criteria() -> None:
    landing = fly_glider(SPEC, GliderMission(3, "glide", longest_s=0.5))
    found = summary([landing, landing])
    assert (found["runs"], found["acceptable"], found["causes"]) == (2, 0, {"not landed": 2})
    assert json.loads(json.dumps(landing.document()))["phases"] == {}
    assert "0 of 2 landings" in figures(found)
