"""The EAV's images around its plant, without a bus: what laws, filter and monitors are worth."""

import pytest

from heronry_tools.fly.atmosphere import Wind
from heronry_tools.fly.avionics.flight_management import (
    DECISION_M,
    FlightManagement,
    Situation,
    Stage,
)
from heronry_tools.fly.dynamics.eav import EavPlant
from heronry_tools.fly.dynamics.moving_air import MovingAir
from heronry_tools.fly.record import Recorder
from lab.flights.loop import PERIOD_NS, Loop


def landed(position, seed=3, **plant):
    recorder = Recorder("eav", "", seed)
    air = MovingAir(seed, Wind(5.0, 40.0))
    loop = Loop(EavPlant(seed, air=air, watch=recorder.watch, start_m=(-420.0, 0.0, 32.0), **plant), position)
    while recorder.touchdown is None and loop.now_ns < 80e9:
        loop.step()
    return loop, recorder.finished()


def test_the_filter_lands_what_the_receiver_alone_does_not():
    (loop, by_filter), by_receiver = landed("filter"), landed("coarse")[1]
    assert by_filter.causes == ()
    assert not any(context.reported for context in loop.contexts.values()), "a filter that fits reports nothing"
    assert by_receiver.causes != ()


def test_the_monitor_finds_a_receiver_that_has_lost_its_corrections():
    loop, _ = landed_with_monitor(corrections_lost_s=2.0, seconds=4)
    assert loop.contexts["eav_accuracy_monitor"].reported == {"device:differential_receiver"}


@pytest.mark.parametrize("seed", range(3))
def test_the_monitor_leaves_a_healthy_receiver_alone(seed):
    loop, _ = landed_with_monitor(corrections_lost_s=None, seconds=20, seed=seed)
    assert loop.contexts["eav_accuracy_monitor"].reported == set()


def landed_with_monitor(*, corrections_lost_s, seconds, seed=1):
    plant = EavPlant(seed, corrections_lost_s=corrections_lost_s, air=MovingAir(seed, Wind(6.0, 20.0)))
    loop = Loop(plant, "coarse", also=("eav_accuracy_monitor", "eav_elevator_monitor"))
    while loop.now_ns < seconds * 1e9:
        loop.step()
    return loop, plant


@pytest.mark.parametrize("how", ["stuck", "loose"])
def test_the_monitor_finds_a_servo_that_does_not_follow(how):
    loop, plant = landed_with_monitor(corrections_lost_s=None, seconds=5)
    assert loop.contexts["eav_elevator_monitor"].reported == set()
    plant.fail("elevator_1", how, loop.now_ns)
    while loop.now_ns < 15e9:
        loop.step()
    assert loop.contexts["eav_elevator_monitor"].reported == {"device:elevator_1"}


def test_the_stages_follow_one_another():
    management = FlightManagement()
    seen = []
    for x_m in range(-700, 60):
        height_m = min(45.0, max(0.0, -(x_m + 40) * 0.0875))
        management.step(Situation(float(x_m), 0.0, height_m, 17.0, 0.0), mode="precise")
        if management.stage not in seen:
            seen.append(management.stage)
    assert seen == [Stage.APPROACH, Stage.GLIDE_SLOPE, Stage.TRANSITION, Stage.FLARE]


def test_a_position_that_is_not_good_enough_refuses_the_landing_above_the_decision_height():
    management = FlightManagement()
    management.step(Situation(-400.0, 0.0, 32.0, 17.0, 0.0), mode="precise")
    commands = management.step(Situation(-380.0, 0.0, 30.0, 17.0, 0.0), mode="waiting")
    assert management.stage is Stage.GO_AROUND
    assert commands.vertical_speed_m_per_s > 0.0


def test_on_approach_it_waits_for_a_better_position_until_it_is_too_far():
    management = FlightManagement()
    for x_m, stage in [(-620.0, Stage.APPROACH), (-500.0, Stage.APPROACH), (-380.0, Stage.GO_AROUND)]:
        management.step(Situation(x_m, 0.0, 45.0, 17.0, 0.0), mode="waiting")
        assert management.stage is stage


def test_a_position_that_becomes_good_enough_begins_the_glide_slope():
    management = FlightManagement()
    management.step(Situation(-520.0, 0.0, 45.0, 17.0, 0.0), mode="waiting")
    management.step(Situation(-519.0, 0.0, 45.0, 17.0, 0.0), mode="precise")
    assert management.stage is Stage.GLIDE_SLOPE


def test_below_the_decision_height_the_landing_goes_on():
    management = FlightManagement()
    height_m = DECISION_M - 1.0
    management.step(Situation(-250.0, 0.0, height_m, 17.0, 0.0), mode="precise")
    management.step(Situation(-248.0, 0.0, height_m, 17.0, 0.0), mode="waiting")
    assert management.stage is Stage.GLIDE_SLOPE


def test_one_that_begins_below_the_decision_height_is_committed():
    management = FlightManagement()
    management.step(Situation(-60.0, 0.0, 4.0, 17.0, 0.0), mode="waiting")
    assert management.stage is Stage.TRANSITION


def test_one_that_begins_beyond_the_runway_goes_around():
    management = FlightManagement()
    management.step(Situation(60.0, 0.0, 25.0, 17.0, 0.0), mode="precise")
    assert management.stage is Stage.GO_AROUND


def test_a_landing_point_that_is_too_far_is_refused():
    management = FlightManagement()
    management.step(Situation(-150.0, 0.0, 15.0, 17.0, 0.0), mode="precise")
    management.step(Situation(-20.0, 0.0, 15.0, 17.0, 0.0), mode="precise")
    assert management.stage is Stage.GO_AROUND


def test_a_device_that_is_dead_gives_nothing_and_a_biased_one_something_wrong():
    plant = EavPlant(1)
    before = plant.read("pitot_1", 0)
    plant.fail("pitot_1", "bias", 0, 3.0)
    plant.fail("gps", "dead", 0)
    plant.fail("ins_1", "stuck", 0)
    frozen = plant.read("ins_1", 0)
    assert plant.read("pitot_1", 0) == before + 3.0
    assert plant.read("gps", PERIOD_NS) is None
    assert plant.read("ins_1", 40 * PERIOD_NS) == frozen
    plant.heal("ins_1")
    assert plant.read("ins_1", 40 * PERIOD_NS) != frozen
