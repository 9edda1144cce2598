"""Drivers of sensors and actuators: units, silence, limits, and what happens without a demand."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.rig import Rig
from heronry_agent.module import Datum, Value


def reading(rig: Rig, value: Value | None) -> None:
    rig.host.reading = lambda _now_ns: value


def test_a_gps_receiver_speaks_in_integers_and_its_driver_in_units() -> None:
    rig = Rig("gps_receiver", rate_hz=10)
    reading(rig, (380_300_000, -845_000_000, 20_000_123, 27_000_000))
    assert rig.step() == pytest.approx(
        {"gps_latitude": 38.03, "gps_longitude": -84.5, "gps_altitude": 20_000.123, "gps_track": 270.0}
    )


def test_the_paper_s_gps_driver_gives_its_height_alone() -> None:
    rig = Rig("gps_driver", rate_hz=10)
    reading(rig, (380_300_000, -845_000_000, 300_000, 0))
    assert rig.step() == {"gps_altitude": 300.0}


@pytest.mark.parametrize("image", ["gps_receiver", "gps_driver"])
def test_a_receiver_that_repeats_one_fix_for_three_seconds_is_stuck_until_the_next_fix(image: str) -> None:
    rig = Rig(image, rate_hz=10)
    reading(rig, (380_300_000, -845_000_000, 300_000, 0))
    assert rig.run(2.9)["gps_altitude"] == 300.0
    assert rig.host.reported == []
    assert rig.run(0.7) == {}
    assert rig.host.reported == ["device:device_under_test"]
    reading(rig, (380_300_000, -845_000_000, 300_001, 0))
    assert rig.step()["gps_altitude"] == pytest.approx(300.001)


def test_an_inertial_unit_gives_rates_and_accelerations() -> None:
    rig = Rig("inertial_unit")
    reading(rig, (1_500, -20, 70, -5))
    assert rig.step() == pytest.approx(
        {"pitch_rate": 1.5, "roll_rate": -0.02, "longitudinal_acceleration": 0.07, "lateral_acceleration": -0.005}
    )


def test_a_silent_device_is_reported_after_every_half_second() -> None:
    rig = Rig("gps_receiver", rate_hz=10)
    for _ in range(4):
        assert rig.step() == {}
    assert rig.host.reported == []
    rig.step()
    assert rig.host.reported == ["device:device_under_test"]
    rig.run(0.4)
    assert rig.host.reported == ["device:device_under_test"]
    rig.step()
    assert rig.host.reported == ["device:device_under_test"] * 2


def test_a_device_that_came_back_and_fell_silent_again_is_reported_again() -> None:
    rig = Rig("pressure_driver_2", rate_hz=20)
    rig.run(0.6)
    reading(rig, 500.0)
    assert rig.step() == {"pressure_2": 500.0}
    reading(rig, None)
    rig.run(0.6)
    assert rig.host.reported == ["device:device_under_test"] * 2


def test_a_device_that_takes_a_moment_to_wake_is_not_reported() -> None:
    rig = Rig("pressure_driver", rate_hz=80)
    rig.run(0.45)
    reading(rig, 1000.0)
    rig.run(5)
    assert rig.host.reported == []


@pytest.mark.parametrize(
    ("image", "nonsense"),
    [
        ("pressure_driver", "loud"),
        ("pressure_driver", (1, 2)),
        ("gps_receiver", (1, 2, 3)),
        ("inertial_unit", 4.0),
        ("horizon_driver", 0.0),
        ("camera_driver", 0.5),
        ("command_driver", 1),
        ("release_driver", "yes"),
    ],
)
def test_what_no_such_device_says_counts_as_silence(image: str, nonsense: Value) -> None:
    rig = Rig(image)
    reading(rig, nonsense)
    assert rig.run(0.5) == {}
    assert len(rig.host.reported) == 1


def test_a_horizon_too_bright_is_held_to_what_the_wire_carries() -> None:
    rig = Rig("horizon_driver")
    reading(rig, (99_999, -99_999))
    assert rig.step() == {"horizon_contrast": (32_767, -32_767)}


@pytest.mark.parametrize(("raw", "release", "cut"), [((0, 0), 0, 0), ((1, 0), 1, 0), ((0, 7), 0, 1)])
def test_commands_are_yes_or_no(raw: tuple[int, int], release: int, cut: int) -> None:
    for image in ("command_driver", "console_driver"):
        rig = Rig(image, rate_hz=10)
        reading(rig, raw)
        assert rig.step() == {"release_command": release, "cutdown_command": cut}


def test_a_servo_takes_its_first_demand_immediately_and_later_ones_at_its_own_speed() -> None:
    rig = Rig("elevator_servo")
    assert rig.step(elevator_demand=10.0) == {"elevator_servo_command": 10.0}
    assert rig.step(elevator_demand=-10.0) == {"elevator_servo_command": 7.0}  # 120 deg/s for 25 ms
    assert rig.host.written == [10.0, 7.0]


def test_a_servo_without_a_demand_stays_and_before_the_first_is_left_alone() -> None:
    rig = Rig("rudder_servo")
    assert rig.step() == {}
    assert rig.host.written == []
    rig.step(rudder_demand=4.0)
    rig.step()
    assert rig.host.written == [4.0, 4.0]


@pytest.mark.parametrize("taken", [None, 0.0])
def test_a_rudder_servo_that_takes_no_command_for_half_a_second_is_reported(taken: float | None) -> None:
    rig = Rig("rudder_servo")
    reading(rig, taken)
    rig.run(1.0)
    assert rig.host.reported == []  # it has been given no command yet
    rig.run(0.5, rudder_demand=4.0)
    assert rig.host.reported == []
    rig.step(rudder_demand=4.0)
    assert rig.host.reported == ["device:device_under_test"]
    rig.run(0.5, rudder_demand=4.0)
    assert rig.host.reported == ["device:device_under_test"] * 2


def test_a_rudder_servo_that_takes_its_commands_is_not_reported_nor_one_that_misses_some() -> None:
    rig = Rig("rudder_servo")
    rig.host.reading = lambda _now_ns: rig.host.written[-1] if rig.host.written else None
    for tick in range(200):
        rig.step(rudder_demand=10.0 * math.sin(tick / 10))
    missed = {step for step in range(200, 400) if step % 20 < 15}
    rig.host.reading = lambda now_ns: rig.host.written[-1] if now_ns // rig.host.period_ns not in missed else None
    for tick in range(200):
        rig.step(rudder_demand=10.0 * math.sin(tick / 10))
    assert rig.host.reported == []


@given(st.lists(st.none() | st.floats(allow_nan=True, allow_infinity=True), max_size=60))
def test_a_servo_never_passes_its_stops_nor_its_speed(demands: list[float | None]) -> None:
    rig = Rig("servo_driver_1")
    for demand in demands:
        assert rig.step(elevator_demand=demand) == {}
    angles = [float(angle) for angle in rig.host.written]
    assert all(abs(angle) <= 25.0 for angle in angles)
    assert all(abs(after - before) <= 3.0 + 1e-9 for before, after in itertools.pairwise(angles))


def test_a_demand_that_its_producer_does_not_trust_is_none() -> None:
    rig = Rig("servo_driver_1")
    rig.step(elevator_demand=5.0)
    rig.feed({"elevator_demand": Datum(20.0, 1, 0, valid=False)})
    assert rig.host.written == [5.0, 5.0]


@pytest.mark.parametrize(("image", "variable"), [("chute_charge", "chute_release"), ("burn_wire", "balloon_cut")])
def test_a_charge_takes_two_demands_in_a_row_and_no_word_back(image: str, variable: str) -> None:
    rig = Rig(image, rate_hz=10)
    for demand in (1, 0, 1, 0):
        rig.step(**{variable: demand})
    assert rig.host.written == [0, 0, 0, 0]
    for demand in (1, None, 1, 0, None):
        rig.step(**{variable: demand})
    assert rig.host.written[4:] == [0, 0, 1, 1, 1]


def test_the_gas_valve_follows_its_demand_and_closes_without_one() -> None:
    rig = Rig("inflation_driver", rate_hz=10)
    for demand in (1.0, 0.25, 7.0, -3.0, None):
        rig.step(valve_demand=demand)
    assert rig.host.written == [1.0, 0.25, 1.0, 0.0, 0.0]
