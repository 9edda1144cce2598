"""BIG BLUE in JSBSim: ascent, inflation, release, glide, parachute, and the same for equal seeds."""

import math

import pytest

from agent.rig import Flight, best_modes
from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path

pytest.importorskip("jsbsim")

from heronry_tools.fly.atmosphere import Wind
from heronry_tools.fly.dynamics.big_blue import BigBluePlant
from heronry_tools.fly.dynamics.moving_air import MovingAir

S = 1_000_000_000
SPEC = load(shipped_spec_path("big_blue"))


def _moving(plant: BigBluePlant, begin_s: float, end_s: float) -> tuple[float, float]:
    """Advance; gives the change of height per second of the world, and the horizontal distance."""
    plant.advance(round(begin_s * S))
    before, before_s = plant.truth(), plant.world_s
    plant.advance(round(end_s * S))
    after = plant.truth()
    return (after.height_m - before.height_m) / (plant.world_s - before_s), math.hypot(
        after.x_m - before.x_m, after.y_m - before.y_m
    )


def test_the_balloon_carries_it_up_with_5_m_per_s_and_with_the_wind() -> None:
    plant = BigBluePlant(1, air=MovingAir(1, Wind(4.0, 270.0)))
    climb, drift = _moving(plant, 20.0, 60.0)
    assert climb == pytest.approx(5.0, abs=0.4)
    assert 40.0 * 4.0 < drift < 40.0 * 10.0
    truth = plant.truth()
    assert abs(truth.roll_deg) < 5
    assert abs(truth.pitch_deg) < 8


def test_time_passes_faster_on_the_line_alone() -> None:
    plant = BigBluePlant(1, pace=30)
    plant.advance(15 * S)
    assert plant.world_s > 60
    glide = BigBluePlant(1, start="glide", pace=30)
    glide.advance(5 * S)
    assert glide.world_s == pytest.approx(5.0)


def test_the_climb_is_faster_in_thin_air() -> None:
    climb, _ = _moving(BigBluePlant(1, start="deployment"), 5.0, 15.0)
    assert climb == pytest.approx(6.8, abs=0.5)


def test_a_released_aircraft_without_wings_falls_and_one_with_wings_glides() -> None:
    sinks = []
    for start, wire in (("deployment", 1), ("glide", 0)):
        plant = BigBluePlant(1, start=start)
        plant.write("burn_wire_1", wire, 2 * S)
        sinks.append(-_moving(plant, 12.0, 22.0)[0])
    assert sinks[0] > 40.0
    assert 1.5 < sinks[1] < 4.0


def test_the_valve_fills_the_wings_and_they_stay_firm_once_cured() -> None:
    plant = BigBluePlant(1, start="deployment")
    assert plant.read("wing_pressure_sensor", 1 * S) < 5
    plant.write("inflation_valve", 1.0, 1 * S)
    plant.advance(12 * S)
    assert plant.read("wing_pressure_sensor", 12 * S) > 430
    plant.advance(26 * S)
    plant.write("inflation_valve", 0.0, 26 * S)
    plant.write("burn_wire_2", 1, 26 * S)
    climb, _ = _moving(plant, 46.0, 56.0)
    assert -20.0 < climb < 5.0  # it has pulled out, and glides in thin air


def test_a_wire_that_has_failed_does_not_burn_and_the_other_one_does() -> None:
    plant = BigBluePlant(1, start="deployment")
    plant.fail("burn_wire_1", "dead", 1 * S)
    assert plant.write("burn_wire_1", 1, 2 * S) is None
    assert plant.hangs
    assert plant.write("burn_wire_2", 1, 2 * S) == 1
    assert not plant.hangs


def test_a_servo_reads_the_last_command_that_it_took() -> None:
    plant = BigBluePlant(1, start="glide")
    assert plant.read("rudder_servo_1", 1 * S) is None
    assert plant.write("rudder_servo_1", 5.0, 1 * S) == plant.read("rudder_servo_1", 2 * S) == 5.0
    plant.fail("rudder_servo_1", "stuck", 2 * S)
    assert plant.write("rudder_servo_1", 9.0, 3 * S) is None
    assert plant.read("rudder_servo_1", 3 * S) == 5.0
    plant.fail("rudder_servo_1", "dead", 3 * S)
    assert plant.read("rudder_servo_1", 4 * S) is None


def test_the_parachute_lets_it_down_with_about_5_m_per_s() -> None:
    plant = BigBluePlant(1, start="glide")
    plant.write("chute_charge_1", 1, 2 * S)
    climb, _ = _moving(plant, 12.0, 20.0)
    assert climb == pytest.approx(-5.2, abs=0.8)


def test_faults_of_sensors_are_those_of_other_plants() -> None:
    plant = BigBluePlant(1, start="glide")
    healthy = plant.read("pitot", 1 * S)
    plant.fail("pitot", "stuck", 1 * S)
    assert plant.read("pitot", 3 * S) == healthy
    plant.fail("gps", "dead", 3 * S)
    assert plant.read("gps", 4 * S) is None
    plant.fail("pressure_sensor_1", "bias", 4 * S, 40.0)
    assert plant.read("pressure_sensor_1", 5 * S) > plant.read("pressure_sensor_2", 5 * S) + 35
    plant.heal("gps")
    assert len(plant.read("gps", 6 * S)) == 4


def _glided(seed: int) -> tuple[Flight, BigBluePlant]:
    modes = best_modes(SPEC)
    for idle in ("experimental_autopilot", "imaging", "image_archive", "pilot_view", "ground_display", "telemetry"):
        del modes[idle]
    plant = BigBluePlant(seed, start="landing", air=MovingAir(seed, Wind(3.0, 250.0)))
    flight = Flight(SPEC, modes, plant)
    flight.fly(40)
    return flight, plant


def test_the_shipped_avionics_fly_it_home_and_an_equal_seed_flies_to_the_bit_the_same() -> None:
    flight, plant = _glided(7)
    truth = plant.truth()
    assert abs(flight.value("pitch_angle") - truth.pitch_deg) < 2
    assert abs(truth.pitch_deg - flight.value("pitch_command")) < 2
    assert 15 < truth.airspeed_m_per_s < 24
    bearing = math.degrees(math.atan2(-truth.y_m, -truth.x_m))
    track = math.degrees(math.atan2(truth.east_m_per_s, truth.north_m_per_s))
    assert abs((bearing - track + 180) % 360 - 180) < 15  # it flies home
    assert flight.reports == []
    assert _glided(7)[1].truth() == truth
    assert _glided(8)[1].truth() != truth
