"""The plant: the same for all PEs, consistent with itself, moved by actuators, with faults on command."""

import math
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_tools.aircraft.images import atmosphere
from heronry_tools.aircraft.plant import Plant
from heronry_tools.aircraft.plant.devices import PUSHED_BY, SENSORS
from heronry_tools.aircraft.plant.flight import CUTDOWN_S, TOUCHDOWN_S, moment
from heronry_tools.aircraft.plant.noise import noise

SECOND_NS = 1_000_000_000
ORIGIN_NS = 77 * SECOND_NS + 123


def at(seconds: float) -> int:
    return ORIGIN_NS + round(seconds * SECOND_NS)


def test_the_tables_know_the_devices_of_the_shipped_specs_and_no_others() -> None:
    specs = [load(shipped_spec_path(name)) for name in shipped_spec_names()]
    sensors = {d.name for spec in specs for d in spec.devices.values() if d.kind == "sensor"}
    actuators = {d.name for spec in specs for d in spec.devices.values() if d.kind == "actuator"}
    assert sensors == SENSORS.keys()
    assert PUSHED_BY.keys() <= actuators


@given(st.sampled_from(sorted(SENSORS)), st.integers(0, 300 * SECOND_NS))
def test_two_processes_read_the_same(device: str, after_ns: int) -> None:
    one, other = Plant(ORIGIN_NS), Plant(ORIGIN_NS)
    one.read("gps", ORIGIN_NS)  # what was read before leaves no trace
    assert one.read(device, ORIGIN_NS + after_ns) == other.read(device, ORIGIN_NS + after_ns)


def test_a_restarted_process_agrees_as_soon_as_it_has_heard_the_servo_for_a_while() -> None:
    old, new = Plant(ORIGIN_NS), Plant(ORIGIN_NS)
    for tick in range(400):
        angle = 10.0 * math.sin(tick / 20)
        old.write("elevator_servo_1", angle, at(110 + tick / 40))
        if tick >= 200:
            new.heard("elevator_servo_1", angle, at(110 + tick / 40))
    for device in ("elevator_angle_sensor", "imu_1", "horizon_sensor"):
        assert new.read(device, at(120)) == pytest.approx(old.read(device, at(120)), abs=0.01)


def test_before_take_off_the_aircraft_stands_on_the_field() -> None:
    plant = Plant(ORIGIN_NS)
    assert plant.read("barometer", 0) == plant.read("barometer", ORIGIN_NS)
    assert moment(-5 * SECOND_NS) == moment(0)


def test_the_flight_goes_up_and_comes_back() -> None:
    heights = [moment(s * SECOND_NS).altitude_m for s in range(300)]
    top = heights.index(max(heights))
    assert heights[0] == heights[-1] == 300.0
    assert max(heights) == pytest.approx(20_000)
    assert top == pytest.approx(CUTDOWN_S, abs=3)
    assert heights[top:] == sorted(heights[top:], reverse=True)
    landed = moment(round((TOUCHDOWN_S + 1) * SECOND_NS))
    assert (landed.airspeed_m_per_s, landed.pitch_deg, landed.roll_deg) == pytest.approx((0, 0, 0), abs=1e-9)


@pytest.mark.parametrize("axis", ["pitch", "roll"])
def test_the_angular_rates_add_up_to_the_attitude(axis: str) -> None:
    angle = getattr(moment(20 * SECOND_NS), f"{axis}_deg")
    for tick in range(20 * 200, 200 * 200):
        angle += getattr(moment(tick * SECOND_NS // 200 + SECOND_NS // 400), f"{axis}_rate_deg_per_s") / 200
    assert angle == pytest.approx(getattr(moment(200 * SECOND_NS), f"{axis}_deg"), abs=0.05)


@pytest.mark.parametrize("seconds", [0, 20, 60, 94, 99, 130, 200, 228])
def test_the_sensors_tell_of_one_and_the_same_aircraft(seconds: float) -> None:
    plant, now = Plant(ORIGIN_NS), moment(round(seconds * SECOND_NS))
    latitude, longitude, height_mm, _ = plant.read("gps", at(seconds))
    pitch_rate, roll_rate, forward, right = plant.read("imu_1", at(seconds))
    assert height_mm / 1e3 == pytest.approx(now.altitude_m, abs=4 * 4)
    assert latitude / 1e7 == pytest.approx(now.latitude_deg, abs=1e-4)
    assert longitude / 1e7 == pytest.approx(now.longitude_deg, abs=1e-4)
    assert plant.read("barometer", at(seconds)) == pytest.approx(atmosphere.pressure_hpa(now.altitude_m), abs=0.5)
    assert plant.read("pitot", at(seconds)) == pytest.approx(
        atmosphere.differential_hpa(now.airspeed_m_per_s), abs=0.02
    )
    assert pitch_rate / 1e3 == pytest.approx(now.pitch_rate_deg_per_s, abs=0.4)
    assert roll_rate / 1e3 == pytest.approx(now.roll_rate_deg_per_s, abs=0.4)
    assert math.degrees(math.asin(forward / 1e3)) == pytest.approx(now.pitch_deg, abs=3)
    assert -math.degrees(math.asin(right / 1e3 / math.cos(math.radians(now.pitch_deg)))) == pytest.approx(
        now.roll_deg, abs=3
    )


def test_a_gps_receiver_repeats_its_fix_until_it_has_a_new_one() -> None:
    plant = Plant(ORIGIN_NS)
    assert plant.read("gps", at(30.01)) == plant.read("gps", at(30.09))
    assert plant.read("gps", at(30.01)) != plant.read("gps", at(30.11))


def test_the_surface_follows_whichever_servo_drives_with_a_lag() -> None:
    plant = Plant(ORIGIN_NS)
    plant.write("elevator_servo_1", 10.0, at(1))
    assert plant.read("elevator_angle_sensor", at(1)) == pytest.approx(0.0, abs=0.2)
    assert plant.read("elevator_angle_sensor", at(1.08)) == pytest.approx(10 * (1 - math.exp(-1)), abs=0.2)
    assert plant.read("elevator_angle_sensor", at(2)) == pytest.approx(10.0, abs=0.2)
    plant.heard("elevator_servo_2", -5.0, at(2))
    assert plant.read("elevator_angle_sensor", at(3)) == pytest.approx(-5.0, abs=0.2)


def test_an_elevator_that_goes_down_lowers_the_nose_in_the_glide_and_does_nothing_on_the_balloon() -> None:
    moved, still = Plant(ORIGIN_NS), Plant(ORIGIN_NS)
    for seconds, expected in ((60, 0.0), (130, -4.0)):
        moved.write("elevator_servo_1", 10.0, at(seconds))
        forward = [math.degrees(math.asin(b.read("imu_1", at(seconds + 8))[2] / 1e3)) for b in (moved, still)]
        assert forward[0] - forward[1] == pytest.approx(expected, abs=0.15)


def test_the_airframe_turns_as_fast_as_its_attitude_changes() -> None:
    plant, still = Plant(ORIGIN_NS), Plant(ORIGIN_NS)
    plant.write("rudder_servo_1", 15.0, at(130))
    rolled = sum(
        (plant.read("imu_1", at(130 + t / 100))[1] - still.read("imu_1", at(130 + t / 100))[1]) / 1e3 / 100
        for t in range(800)
    )
    assert rolled == pytest.approx(0.6 * 15.0, abs=0.1)


def test_gas_fills_the_wings_and_stays() -> None:
    plant = Plant(ORIGIN_NS)
    plant.write("inflation_valve", 1.0, at(60))
    assert plant.read("wing_pressure_sensor", at(60)) == pytest.approx(0, abs=4)
    plant.write("inflation_valve", 0.0, at(68))
    full = plant.read("wing_pressure_sensor", at(68))
    assert 450 < full < 550
    assert plant.read("wing_pressure_sensor", at(78)) == pytest.approx(full, abs=10)


def test_wings_of_a_process_restarted_in_flight_are_full() -> None:
    assert Plant(ORIGIN_NS).read("wing_pressure_sensor", at(150)) == pytest.approx(500, abs=4)
    assert Plant(ORIGIN_NS).read("wing_pressure_sensor", at(10)) == pytest.approx(0, abs=4)


def test_a_dead_sensor_says_nothing_a_stuck_one_always_the_same_and_a_biased_one_something_else() -> None:
    plant, healthy = Plant(ORIGIN_NS), Plant(ORIGIN_NS)
    plant.fail("pressure_sensor_1", "dead", at(10))
    plant.fail("pressure_sensor_2", "stuck", at(10))
    plant.fail("pressure_sensor_3", "bias", at(10), offset=25.0)
    assert plant.read("pressure_sensor_1", at(40)) is None
    assert plant.read("pressure_sensor_2", at(40)) == healthy.read("pressure_sensor_2", at(10))
    assert plant.read("pressure_sensor_3", at(40)) == pytest.approx(healthy.read("pressure_sensor_3", at(40)) + 25.0)
    for device in ("pressure_sensor_1", "pressure_sensor_2", "pressure_sensor_3"):
        plant.heal(device)
        assert plant.read(device, at(50)) == healthy.read(device, at(50))


def test_a_bias_shifts_every_number_of_a_tuple_and_keeps_integers() -> None:
    plant, healthy = Plant(ORIGIN_NS), Plant(ORIGIN_NS)
    plant.fail("gps", "bias", at(0), offset=1000.4)
    assert plant.read("gps", at(9)) == tuple(item + 1000 for item in healthy.read("gps", at(9)))


def test_a_stuck_servo_leaves_the_surface_where_it_is_is_not_echoed_and_the_other_one_takes_over() -> None:
    plant = Plant(ORIGIN_NS)
    assert plant.write("elevator_servo_1", 8.0, at(1)) == 8.0
    plant.fail("elevator_servo_1", "stuck", at(2))
    assert plant.write("elevator_servo_1", -8.0, at(2)) is None
    plant.heard("elevator_servo_1", -8.0, at(2))
    assert plant.read("elevator_angle_sensor", at(3)) == pytest.approx(8.0, abs=0.2)
    assert plant.write("elevator_servo_2", -8.0, at(3)) == -8.0
    assert plant.read("elevator_angle_sensor", at(4)) == pytest.approx(-8.0, abs=0.2)


def test_a_biased_servo_goes_to_the_wrong_place_and_the_echo_says_where() -> None:
    plant, elsewhere = Plant(ORIGIN_NS), Plant(ORIGIN_NS)
    plant.fail("elevator_servo_1", "bias", at(0), offset=3.0)
    echo = plant.write("elevator_servo_1", 4.0, at(1))
    assert echo == 7.0
    elsewhere.heard("elevator_servo_1", echo, at(1))
    assert elsewhere.read("elevator_angle_sensor", at(2)) == plant.read("elevator_angle_sensor", at(2))


def test_an_unknown_actuator_stores_and_an_unknown_sensor_reads_zero() -> None:
    plant = Plant(ORIGIN_NS)
    assert plant.read("my_own_sensor", at(1)) == 0.0
    assert plant.position("my_own_lamp") is None
    plant.write("my_own_lamp", "green", at(1))
    assert plant.position("my_own_lamp") == plant.read("my_own_lamp", at(2)) == "green"


def test_a_surface_does_not_move_by_a_text() -> None:
    with pytest.raises(TypeError, match="elevator_servo_1 needs a number as its command, not 'up'"):
        Plant(0).write("elevator_servo_1", "up", 0)


def test_the_ground_asks_for_the_cut_in_time_and_never_for_the_parachute() -> None:
    plant = Plant(ORIGIN_NS)
    for device in ("command_receiver", "console"):
        assert plant.read(device, at(CUTDOWN_S - 1)) == (0, 0)
        assert plant.read(device, at(CUTDOWN_S + 1)) == (0, 1)
    assert plant.read("receiver", at(100)) == 0


def test_noise_is_nearly_normal_and_devices_are_independent() -> None:
    draws = {name: [noise(name, t) for t in range(4000)] for name in ("one", "other")}
    for series in draws.values():
        assert statistics.fmean(series) == pytest.approx(0, abs=0.06)
        assert statistics.pstdev(series) == pytest.approx(1, abs=0.05)
        assert max(abs(draw) for draw in series) <= 3.5
    assert statistics.correlation(draws["one"], draws["other"]) == pytest.approx(0, abs=0.06)


def test_a_world_follows_the_actuators_that_its_sensors_feel() -> None:
    assert Plant.follows(["imu_2", "gps"]) == {
        "elevator_servo_1",
        "elevator_servo_2",
        "rudder_servo_1",
        "rudder_servo_2",
    }
    assert Plant.follows(["elevator_angle_sensor"]) == {"elevator_servo_1", "elevator_servo_2"}
    assert Plant.follows(["wing_pressure_sensor", "unknown"]) == {"inflation_valve"}
    assert Plant.follows(["pitot", "battery", "camera"]) == frozenset()
