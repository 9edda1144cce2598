"""Altitude, attitude and air data: their estimates, and the error against the truth of the plant."""

import math
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.rig import Flight, Rig
from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.aircraft.images import atmosphere
from heronry_tools.aircraft.plant.flight import moment

BIG_BLUE = load(shipped_spec_path("big_blue"))
SENSORS = ("gps_driver", "pressure_driver_1", "pressure_driver_2", "pressure_driver_3", "horizon_driver")


def rms_error(modes: dict[str, str], variable: str, truth: str, start_s: float, end_s: float) -> float:
    """Error of an estimate against the truth at its time, over a part of the plant's flight."""
    flight = Flight(BIG_BLUE, dict.fromkeys(SENSORS, "only") | {"pressure_voter": "voted"} | modes)
    flight.now_ns = round((start_s - 10) * 1e9)  # ten seconds to settle
    flight.fly(10)
    errors = []
    while flight.now_ns < end_s * 1e9:
        flight.fly(0.1)
        ((value, made_ns, _),) = flight.data[variable].values()
        errors.append(value - getattr(moment(made_ns), truth))
    return math.sqrt(statistics.fmean(error**2 for error in errors))


def test_the_fused_altitude_is_better_than_either_of_its_sources() -> None:
    stretch = ("altitude", "altitude_m", 75, 92)  # near the balloon's ceiling
    fused = rms_error({"high_quality_altitude": "fused"}, *stretch)
    gps_only = rms_error({"high_quality_altitude": "gps_only"}, *stretch)
    pressure_only = rms_error({"low_quality_altitude": "only"}, *stretch)
    raw_gps = rms_error({}, "gps_altitude", *stretch[1:])
    assert fused < gps_only < raw_gps < pressure_only


def test_gps_alone_does_not_lag_behind_a_climb() -> None:
    rig = Rig("fused_altitude", mode="gps_only", rate_hz=10)
    for tick in range(100):
        outputs = rig.step(gps_altitude=300.0 + 40.0 * tick)  # 400 m/s
    assert outputs["altitude"] == pytest.approx(300.0 + 40.0 * 99, abs=0.5)


def test_the_fused_altitude_lives_through_a_missing_fix_but_not_through_a_missing_pressure() -> None:
    rig = Rig("high_quality_altitude", mode="fused", rate_hz=10)
    pressure = atmosphere.pressure_hpa(1000.0)
    assert rig.step(absolute_pressure=pressure) == {}  # no fix yet
    rig.run(60, absolute_pressure=pressure, gps_altitude=1050.0)
    assert rig.step(absolute_pressure=pressure)["altitude"] == pytest.approx(1050.0, abs=0.1)
    assert rig.step(absolute_pressure=atmosphere.pressure_hpa(1100.0))["altitude"] == pytest.approx(1150.0, abs=0.1)
    assert rig.step(gps_altitude=1050.0) == {}


def test_the_estimator_of_figure_3_works_with_pressure_alone() -> None:
    rig = Rig("high_quality_altitude", mode="pressure_only", rate_hz=10)
    assert rig.step(absolute_pressure=atmosphere.pressure_hpa(1000.0))["altitude"] == pytest.approx(1000.0, abs=0.1)
    assert rig.step() == {}


@given(st.floats(-1000, 40_000))
def test_pressure_altitude_is_the_standard_atmosphere(altitude_m: float) -> None:
    outputs = Rig("low_quality_altitude", rate_hz=10).step(absolute_pressure=atmosphere.pressure_hpa(altitude_m))
    assert outputs["altitude"] == pytest.approx(altitude_m, abs=0.01)


@pytest.mark.parametrize(("variable", "truth"), [("pitch_angle", "pitch_deg"), ("roll_angle", "roll_deg")])
def test_each_version_of_the_attitude_is_worse_than_the_one_before(variable: str, truth: str) -> None:
    stretch = (variable, truth, 125, 155)
    fused = rms_error({"imu_driver_1": "only", "attitude_filter": "fused"}, *stretch)
    gyro_only = rms_error({"imu_driver_2": "only", "attitude_filter": "gyro_only"}, *stretch)
    horizon = rms_error({"horizon_attitude": "only"}, *stretch)
    assert fused < 0.2
    assert fused < gyro_only < horizon < 3


@given(st.floats(-60, 60), st.floats(-60, 60))
def test_a_filter_with_gravity_starts_at_the_true_attitude(pitch_deg: float, roll_deg: float) -> None:
    pitch, roll = math.radians(pitch_deg), math.radians(roll_deg)
    outputs = Rig("attitude_filter", mode="fused").step(
        pitch_rate=0.0,
        roll_rate=0.0,
        longitudinal_acceleration=math.sin(pitch),
        lateral_acceleration=-math.sin(roll) * math.cos(pitch),
    )
    assert outputs == pytest.approx({"pitch_angle": pitch_deg, "roll_angle": roll_deg}, abs=1e-6)


def test_a_filter_that_loses_its_accelerations_in_a_turn_keeps_the_bank() -> None:
    rig = Rig("attitude_filter", mode="fused")
    turn = {"longitudinal_acceleration": 0.0, "lateral_acceleration": -math.sin(math.radians(20.0))}
    rig.run(1, pitch_rate=0.0, roll_rate=0.0, **turn)
    rig.host.mode = "gyro_only"
    assert rig.module.mode_changed()
    assert rig.step(pitch_rate=0.0, roll_rate=0.0)["roll_angle"] == pytest.approx(20.0, abs=0.1)


def test_a_gyro_with_a_bias_pulls_the_fused_attitude_little_and_the_other_one_much() -> None:
    still = {"pitch_rate": 0.5, "roll_rate": 0.0}
    gravity = {"longitudinal_acceleration": 0.0, "lateral_acceleration": 0.0}
    fused = Rig("attitude_filter", mode="fused").run(120, **still, **gravity)
    gyro_only = Rig("attitude_filter", mode="gyro_only").run(240, **still)
    assert fused["pitch_angle"] == pytest.approx(1.0, abs=0.1)  # bias times the pull's time constant
    assert gyro_only["pitch_angle"] == pytest.approx(-4.0 + 12.5, abs=0.2)  # and it takes the glide for granted


def test_without_rates_there_is_no_attitude_and_without_accelerations_there_is() -> None:
    rig = Rig("attitude_filter", mode="fused")
    complete = {"pitch_rate": 0.0, "roll_rate": 8.0, "longitudinal_acceleration": 0.0, "lateral_acceleration": 0.0}
    rig.step(**complete)
    assert rig.step(longitudinal_acceleration=0.0, lateral_acceleration=0.0) == {}
    assert rig.step(pitch_rate=0.0, roll_rate=8.0)["roll_angle"] == pytest.approx(0.2)


pressures = st.floats(5.0, 1100.0)


@given(pressures, pressures, pressures)
def test_three_pressures_are_voted_to_the_middle_one(one: float, two: float, three: float) -> None:
    voted = Rig("pressure_voter", mode="voted", rate_hz=20).step(pressure_1=one, pressure_2=two, pressure_3=three)
    assert voted == {"static_pressure": sorted((one, two, three))[1]}


@given(st.sampled_from("123"), st.floats(60.0, 900.0), st.booleans())
def test_only_the_sensor_that_differs_is_reported(odd: str, pressure: float, high: bool) -> None:
    rig = Rig("pressure_voter", mode="voted", rate_hz=20)
    given = {f"pressure_{c}": pressure + 0.1 * int(c) for c in "123"}
    given[f"pressure_{odd}"] = pressure * (1.2 if high else 0.8)
    rig.run(2.5, **given)
    assert rig.host.reported == [f"device:pressure_sensor_{odd}"]
    rig.run(1, **given)
    assert rig.host.reported == [f"device:pressure_sensor_{odd}"] * 2


def test_the_report_says_by_how_much() -> None:
    rig = Rig("pressure_voter", mode="voted", rate_hz=20)
    rig.run(2.5, pressure_1=500.0, pressure_2=500.0, pressure_3=550.0)
    assert rig.host.reports == [("device:pressure_sensor_3", 500)]  # 0.1 hPa each


def test_no_sensor_is_reported_in_the_first_second_nor_for_a_disagreement_with_breaks() -> None:
    rig = Rig("pressure_voter", mode="voted", rate_hz=20)
    rig.run(1, pressure_1=500.0, pressure_2=500.0, pressure_3=550.0)
    for _ in range(20):
        rig.run(0.9, pressure_1=500.0, pressure_2=500.0, pressure_3=550.0)
        rig.run(0.1, pressure_1=500.0, pressure_2=500.0, pressure_3=500.0)
    assert rig.host.reported == []


def test_of_two_sensors_none_is_reported_and_the_one_that_goes_on_as_before_is_taken() -> None:
    rig = Rig("pressure_voter", mode="voted", rate_hz=20)
    assert rig.step(pressure_1=500.0, pressure_2=501.0) == {"static_pressure": 500.5}
    assert rig.run(10, pressure_1=500.0, pressure_2=900.0) == {"static_pressure": 500.0}
    assert rig.host.reported == []


def test_the_last_pressure_is_believed_and_none_gives_none() -> None:
    rig = Rig("pressure_voter", mode="single", rate_hz=20)
    assert rig.step(pressure_2=432.1) == {"static_pressure": 432.1}
    assert rig.step() == {}


def test_healthy_sensors_on_three_processors_are_never_reported() -> None:
    drivers = dict.fromkeys(("pressure_driver_1", "pressure_driver_2", "pressure_driver_3"), "only")
    flight = Flight(BIG_BLUE, drivers | {"pressure_voter": "voted"})
    flight.fly(240)
    assert flight.reports == []


def test_airspeed_at_sea_level_and_in_thin_air() -> None:
    differential = atmosphere.differential_hpa(18.0)
    low = Rig("air_data", mode="compensated", rate_hz=20).step(
        differential_pressure=differential, static_pressure=1013.25
    )
    high = Rig("air_data", mode="compensated", rate_hz=20).step(
        differential_pressure=differential, static_pressure=54.75
    )
    basic = Rig("air_data", mode="basic", rate_hz=20).step(differential_pressure=differential, static_pressure=54.75)
    assert low == pytest.approx({"indicated_airspeed": 18.0, "true_airspeed": 18.0}, rel=1e-4)
    assert high == pytest.approx({"indicated_airspeed": 18.0, "true_airspeed": 67.1}, rel=1e-2)
    assert basic == pytest.approx({"indicated_airspeed": 18.0})


@pytest.mark.parametrize("static", [None, 0.0, -3.0, math.nan])
def test_a_static_pressure_that_is_none_costs_the_true_airspeed_alone(static: float | None) -> None:
    outputs = Rig("air_data", mode="compensated", rate_hz=20).step(differential_pressure=2.0, static_pressure=static)
    assert list(outputs) == ["indicated_airspeed"]
