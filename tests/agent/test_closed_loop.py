"""All modules of a shipped spec in one loop on the plant, without a bus."""

import pytest

from agent.rig import Flight, best_modes
from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.aircraft.images.mission import Stage
from heronry_tools.aircraft.images.wing import WingState
from heronry_tools.aircraft.plant.flight import TOUCHDOWN_S, moment

PAPER = load(shipped_spec_path("elevator_and_chute"))
BIG_BLUE = load(shipped_spec_path("big_blue"))


def test_the_paper_s_elevator_follows_its_demand() -> None:
    flight = Flight(PAPER, best_modes(PAPER))
    demands = []
    for _ in range(400):
        flight.fly(0.05)
        demands.append(flight.value("elevator_demand"))
        assert flight.value("elevator_angle") == pytest.approx(demands[-1], abs=1.5)
    assert max(demands) > 8
    assert min(demands) < -8
    assert flight.reports == []


def test_a_stuck_servo_is_found_and_the_other_one_follows() -> None:
    flight = Flight(PAPER, best_modes(PAPER))
    flight.fly(10)
    flight.plant.fail("elevator_servo_1", "stuck", flight.now_ns)
    while not flight.reports:
        flight.fly(0.1)
    assert flight.now_ns < 15e9
    flight.stop("servo_driver_1")  # what the manager does
    flight.start("servo_driver_2", "only")
    flight.fly(20)
    assert flight.value("elevator_angle") == pytest.approx(flight.value("elevator_demand"), abs=1.5)
    assert flight.reports == ["device:elevator_servo_1"]


def test_the_paper_s_parachute_opens_when_neither_altitude_nor_command_is_left() -> None:
    flight = Flight(PAPER, best_modes(PAPER))
    flight.fly(30)
    for device in ("gps", "barometer"):
        flight.plant.fail(device, "dead", flight.now_ns)
    flight.fly(10)
    assert flight.plant.position("chute_solenoid") == 0
    flight.plant.fail("receiver", "dead", flight.now_ns)
    flight.fly(2)
    assert flight.plant.position("chute_solenoid") == 0
    flight.fly(2)
    assert flight.plant.position("chute_solenoid") == 1
    assert sorted(set(flight.reports)) == ["device:barometer", "device:gps", "device:receiver"]


def test_big_blue_flies_its_whole_mission() -> None:
    flight = Flight(BIG_BLUE, best_modes(BIG_BLUE))
    reached: dict[object, float] = {}
    while flight.now_ns < (TOUCHDOWN_S + 5) * 1e9:
        flight.fly(0.5)
        reached.setdefault(Stage(int(flight.value("mission_stage"))), flight.now_ns / 1e9)
        reached.setdefault(WingState(int(flight.value("wing_state"))).name, flight.now_ns / 1e9)
        if 110e9 < flight.now_ns < 220e9:
            assert abs(flight.value("pitch_angle") - flight.value("pitch_command")) < 6
            assert abs(flight.value("roll_angle")) < 20
    assert flight.reports == []
    assert 40 < reached[Stage.DEPLOYMENT] < reached["FIRM"] < reached["CURED"] < 93
    assert 95 < reached[Stage.GLIDE] < 100 < reached[Stage.LANDING] < TOUCHDOWN_S
    assert flight.plant.position("burn_wire_1") == 1
    assert flight.plant.position("chute_charge_1") == 0
    assert flight.value("altitude") == pytest.approx(moment(flight.now_ns).altitude_m, abs=5)


def test_the_loop_holds_the_nose_where_it_is_commanded() -> None:
    """The script alone would sway by five degrees around the glide; the elevator takes part of that away."""
    flown = Flight(BIG_BLUE, best_modes(BIG_BLUE))
    loose = Flight(BIG_BLUE, {name: mode for name, mode in best_modes(BIG_BLUE).items() if name != "elevator_driver_1"})
    swayed = []
    for flight in (flown, loose):
        flight.now_ns = 120_000_000_000
        flight.fly(15)
        angles = []
        for _ in range(200):
            flight.fly(0.1)
            angles.append(flight.value("pitch_angle"))
        swayed.append(max(angles) - min(angles))
    assert swayed[0] < 0.85 * swayed[1]


def test_big_blue_s_monitor_names_the_servo_that_sticks_in_the_glide() -> None:
    flight = Flight(BIG_BLUE, best_modes(BIG_BLUE))
    flight.now_ns = 120_000_000_000
    flight.fly(10)
    flight.stop("elevator_driver_1")
    flight.start("elevator_driver_2", "only")
    flight.fly(10)
    flight.plant.fail("elevator_servo_2", "stuck", flight.now_ns)
    flight.fly(12)
    assert flight.reports[:1] == ["device:elevator_servo_2"]
    assert "device:elevator_servo_1" not in flight.reports
