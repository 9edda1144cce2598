"""The logic of the flight: parachute, balloon line, wings, mission stage, steering, and what is sent to the ground."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.rig import Rig
from heronry_agent.module import Datum
from heronry_tools.aircraft.images.guidance import (
    HOME_LATITUDE_DEG,
    HOME_LONGITUDE_DEG,
    home_bearing_and_distance,
    turn_deg,
)
from heronry_tools.aircraft.images.imaging import HEAD_WORDS, WORDS, ImageArchive
from heronry_tools.aircraft.images.mission import Stage
from heronry_tools.aircraft.images.wing import WingState

altitudes = st.floats(-100, 30_000)


# ---- the parachute -----------------------------------------------------------------------------------------------


def test_the_parachute_opens_by_default_only_when_neither_input_has_come_for_three_seconds() -> None:
    rig = Rig("chute_logic", rate_hz=10)
    assert rig.run(2.9) == {"chute_release": 0}
    assert rig.run(0.2) == {"chute_release": 1}


@given(st.lists(st.tuples(st.none() | st.just(0), st.none() | altitudes), min_size=1, max_size=80))
def test_as_long_as_one_input_comes_now_and_then_nothing_opens_by_default(
    steps: list[tuple[int | None, float | None]],
) -> None:
    rig = Rig("chute_logic", rate_hz=10)
    for command, altitude in steps:
        assert rig.step(release_command=command, altitude=altitude) == {"chute_release": 0}
        assert rig.step(release_command=0) == {"chute_release": 0}


@given(altitudes | st.none())
def test_a_command_opens_it_at_any_altitude_and_for_good(altitude: float | None) -> None:
    rig = Rig("chute_logic", rate_hz=10)
    rig.step(release_command=0, altitude=altitude)
    assert rig.step(release_command=1, altitude=altitude) == {"chute_release": 1}
    assert rig.run(5, release_command=0, altitude=altitude) == {"chute_release": 1}


def test_without_a_command_link_it_opens_for_an_aircraft_that_comes_down_from_high_up() -> None:
    rig = Rig("chute_logic", rate_hz=10)
    assert rig.run(5, altitude=300.0) == {"chute_release": 0}  # on the field, before the flight
    rig.run(5, altitude=9_000.0)
    assert rig.run(5, altitude=850.0) == {"chute_release": 0}
    assert rig.step(altitude=790.0) == {"chute_release": 1}


def test_with_a_command_link_it_lands_as_it_flies() -> None:
    rig = Rig("chute_logic", rate_hz=10)
    for altitude in (300.0, 9_000.0, 790.0, 300.0):
        assert rig.run(5, altitude=altitude, release_command=0) == {"chute_release": 0}


def test_the_link_may_be_gone_for_a_moment_in_the_landing() -> None:
    rig = Rig("chute_logic", rate_hz=10)
    rig.run(5, altitude=9_000.0, release_command=0)
    rig.run(1, altitude=700.0, release_command=0)
    assert rig.run(2, altitude=700.0) == {"chute_release": 0}
    assert rig.run(2, altitude=700.0) == {"chute_release": 1}


# ---- the balloon's line -------------------------------------------------------------------------------------------


def test_the_line_is_cut_on_command_and_stays_cut() -> None:
    rig = Rig("cutdown_logic", rate_hz=10)
    assert rig.step(cutdown_command=0) == {"balloon_cut": 0}
    assert rig.step(cutdown_command=1) == {"balloon_cut": 1}
    assert rig.step() == {"balloon_cut": 1}


@pytest.mark.parametrize(
    ("altitude", "wings", "cut"),
    [
        (19_900.0, WingState.CURED, 1),
        (19_900.0, WingState.FIRM, 1),
        (19_900.0, None, 1),
        (19_900.0, WingState.INFLATING, 0),
        (19_900.0, WingState.LEAKING, 0),
        (24_100.0, WingState.STOWED, 1),
        (19_000.0, WingState.CURED, 0),
    ],
)
def test_the_altitude_cuts_it_when_the_wings_allow(altitude: float, wings: WingState | None, cut: int) -> None:
    rig = Rig("cutdown_logic", rate_hz=10)
    assert rig.run(5, altitude=altitude, wing_state=wings) == {"balloon_cut": cut}


def test_one_wrong_altitude_cuts_nothing() -> None:
    rig = Rig("cutdown_logic", rate_hz=10)
    for _ in range(20):
        rig.run(0.9, altitude=25_000.0)
        assert rig.step(altitude=5_000.0) == {"balloon_cut": 0}


# ---- the wings -----------------------------------------------------------------------------------------------------


def test_the_valve_opens_below_one_pressure_and_shuts_above_another() -> None:
    rig = Rig("inflation_control", rate_hz=10)
    seen = [
        rig.step(wing_pressure=p, wing_state=WingState.INFLATING)["valve_demand"]
        for p in (0.0, 480.0, 501.0, 480.0, 469.0)
    ]
    assert seen == [1.0, 1.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("state", [WingState.CURED, WingState.LEAKING])
def test_no_gas_for_wings_that_are_hard_or_torn(state: WingState) -> None:
    assert Rig("inflation_control").step(wing_pressure=10.0, wing_state=state) == {"valve_demand": 0.0}


@pytest.mark.parametrize(
    ("altitude", "state", "demand"),
    [
        (300.0, WingState.STOWED, 0.0),
        (300.0, None, 0.0),
        (300.0, WingState.INFLATING, 1.0),
        (17_000.0, WingState.STOWED, 1.0),
        (None, None, 0.0),
    ],
)
def test_folded_wings_stay_folded_near_the_ground(
    altitude: float | None, state: WingState | None, demand: float
) -> None:
    outputs = Rig("inflation_control").step(wing_pressure=0.0, wing_state=state, altitude=altitude)
    assert outputs == {"valve_demand": demand}


def test_without_any_altitude_the_wings_are_filled_once_it_is_lost_for_good() -> None:
    rig = Rig("inflation_control", rate_hz=10)
    assert rig.run(60, wing_pressure=0.0) == {"valve_demand": 0.0}
    assert rig.step(wing_pressure=0.0) == {"valve_demand": 1.0}


def test_an_altitude_that_is_missing_for_a_while_fills_no_wings_on_the_ground() -> None:
    rig = Rig("inflation_control", rate_hz=10)
    for _ in range(3):
        rig.run(5, wing_pressure=0.0, altitude=300.0)
        assert rig.run(40, wing_pressure=0.0) == {"valve_demand": 0.0}


def test_without_a_pressure_the_valve_shuts() -> None:
    rig = Rig("inflation_control")
    rig.step(wing_pressure=0.0)
    assert rig.step() == {"valve_demand": 0.0}


def test_wings_are_stowed_then_filling_then_firm_then_cured_by_the_sun() -> None:
    rig = Rig("wing_monitor", mode="cure", rate_hz=10)
    states = [
        rig.step(wing_pressure=0.0, uv_irradiance=50.0, valve_demand=0.0),
        rig.step(wing_pressure=0.0, uv_irradiance=50.0, valve_demand=1.0),
        rig.run(1, wing_pressure=480.0, uv_irradiance=50.0, valve_demand=1.0),
        rig.run(10.8, wing_pressure=480.0, uv_irradiance=50.0),
        rig.run(0.3, wing_pressure=480.0, uv_irradiance=50.0),
        rig.run(1, wing_pressure=0.0, uv_irradiance=50.0),
    ]
    expected = [WingState.STOWED, WingState.INFLATING, WingState.FIRM, WingState.FIRM, WingState.CURED, WingState.CURED]
    assert states == [{"wing_state": int(state)} for state in expected]


def test_firm_wings_that_lose_their_gas_before_they_are_hard_leak() -> None:
    rig = Rig("wing_monitor", mode="pressure_only", rate_hz=10)
    assert rig.step(wing_pressure=200.0) == {"wing_state": WingState.INFLATING}
    rig.step(wing_pressure=480.0)
    assert rig.step(wing_pressure=200.0) == {"wing_state": WingState.LEAKING}


def test_the_monitor_without_light_never_calls_wings_cured() -> None:
    rig = Rig("wing_monitor", mode="pressure_only", rate_hz=10)
    assert rig.run(600, wing_pressure=480.0) == {"wing_state": WingState.FIRM}


# ---- the stage of the mission -------------------------------------------------------------------------------------


def test_a_whole_flight_passes_through_its_stages() -> None:
    rig = Rig("mission_sequencer", rate_hz=5)
    flight = [
        (300.0, 0.0, 0),
        (17_000.0, 1.0, 0),
        (20_000.0, 1.0, 3),
        (19_500.0, 18.0, 3),
        (1_400.0, 18.0, 3),
        (300.0, 0.0, 3),
    ]
    seen = [rig.run(2, altitude=a, indicated_airspeed=v, wing_state=w)["mission_stage"] for a, v, w in flight]
    assert seen == [Stage.ASCENT, Stage.DEPLOYMENT, Stage.DEPLOYMENT, Stage.GLIDE, Stage.LANDING, Stage.LANDING]


def test_without_a_pitot_a_long_way_down_means_released() -> None:
    rig = Rig("mission_sequencer", rate_hz=5)
    rig.run(2, altitude=20_000.0)
    assert rig.run(2, altitude=19_800.0) == {"mission_stage": Stage.DEPLOYMENT}
    assert rig.run(2, altitude=19_600.0) == {"mission_stage": Stage.GLIDE}


def test_restarted_in_the_glide_it_knows_the_glide() -> None:
    rig = Rig("mission_sequencer", rate_hz=5)
    assert rig.run(2, altitude=9_000.0, indicated_airspeed=18.0) == {"mission_stage": Stage.GLIDE}


def test_two_wrong_values_move_nothing_and_no_values_neither() -> None:
    rig = Rig("mission_sequencer", rate_hz=5)
    rig.run(2, altitude=300.0, indicated_airspeed=0.0)
    rig.step(indicated_airspeed=30.0)
    assert rig.step(indicated_airspeed=30.0) == {"mission_stage": Stage.ASCENT}
    assert rig.run(10) == {"mission_stage": Stage.ASCENT}


@given(
    st.lists(st.tuples(st.none() | altitudes, st.none() | st.floats(0, 40), st.none() | st.integers(0, 4)), max_size=60)
)
def test_the_stage_never_goes_back(steps: list[tuple[float | None, float | None, int | None]]) -> None:
    rig = Rig("mission_sequencer", rate_hz=5)
    stages = [
        rig.step(altitude=a, indicated_airspeed=v, wing_state=w)["mission_stage"] for a, v, w in steps for _ in range(3)
    ]
    assert stages == sorted(stages)


# ---- steering -----------------------------------------------------------------------------------------------------


@given(st.floats(-180, 180), st.floats(-180, 180))
def test_a_turn_is_the_shorter_way(wanted: float, present: float) -> None:
    turn = turn_deg(wanted, present)
    assert -180 <= turn <= 180
    assert (present + turn - wanted + 180) % 360 - 180 == pytest.approx(0, abs=1e-6) or turn == -180


def test_home_lies_where_it_lies() -> None:
    east, distance = home_bearing_and_distance(HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG - 0.01)
    north, _ = home_bearing_and_distance(HOME_LATITUDE_DEG - 0.01, HOME_LONGITUDE_DEG)
    assert (east, north) == pytest.approx((90.0, 0.0))
    assert distance == pytest.approx(877, abs=1)


@pytest.mark.parametrize(("track", "bank"), [(0.0, 0.0), (-10.0, 8.0), (10.0, -8.0), (90.0, -20.0), (270.0, 20.0)])
def test_guidance_banks_towards_home(track: float, bank: float) -> None:
    place = {"gps_latitude": HOME_LATITUDE_DEG - 0.1, "gps_longitude": HOME_LONGITUDE_DEG}
    outputs = Rig("guidance", mode="route", rate_hz=10).step(gps_track=track, altitude=5_000.0, **place)
    assert outputs == pytest.approx({"pitch_command": -4.0, "roll_command": bank})


@pytest.mark.parametrize(
    ("turns_deg_per_s", "least", "most"), [(5.0, 20.0, 20.0), (11.2, 19.0, 20.0), (20.0, 0.0, 5.0)]
)
def test_guidance_commands_less_bank_while_the_track_turns_tighter_than_it_wants(
    turns_deg_per_s: float, least: float, most: float
) -> None:
    """Around home at 18 m/s; 11.2 degrees per second are a bank of 20 degrees."""
    rig, outputs = Rig("guidance", mode="route", rate_hz=10), {}
    for step in range(300):
        track = 0.1 * step * turns_deg_per_s
        north, east = math.cos(math.radians(track + 90.0)), math.sin(math.radians(track + 90.0))
        place = {"gps_latitude": HOME_LATITUDE_DEG - 0.001 * north, "gps_longitude": HOME_LONGITUDE_DEG - 0.001 * east}
        outputs = rig.step(gps_track=track % 360.0, true_airspeed=18.0, mission_stage=Stage.GLIDE, **place)
    assert least <= outputs["roll_command"] <= most


def test_guidance_flares_with_level_wings_wherever_home_is() -> None:
    rig = Rig("guidance", "route")
    east = {"gps_latitude": 38.03, "gps_longitude": -84.6, "gps_track": 0.0, "mission_stage": 3}
    assert rig.step(altitude=320.0, **east)["roll_command"] == 20.0
    assert rig.step(altitude=305.0, **east) == {"pitch_command": 4.0, "roll_command": 0.0}


def test_guidance_without_a_position_flies_straight_on_and_flares_at_the_end() -> None:
    rig = Rig("guidance", mode="level", rate_hz=10)
    assert rig.step() == {"pitch_command": -4.0, "roll_command": 0.0}
    assert rig.step(altitude=305.0, mission_stage=Stage.LANDING) == {"pitch_command": 4.0, "roll_command": 0.0}
    assert rig.step(altitude=305.0, mission_stage=Stage.ASCENT) == {"pitch_command": -4.0, "roll_command": 0.0}


TELEMETRY = {
    "telemetry_altitude": 5_000.0,
    "telemetry_attitude": (-400, 0),
    "telemetry_latitude": HOME_LATITUDE_DEG - 0.5,
    "telemetry_longitude": HOME_LONGITUDE_DEG,
    "telemetry_course": 0.0,
    "telemetry_status": (Stage.GLIDE, 3, 0, 120),
}


def test_the_experiment_flies_home_from_afar_and_circles_when_there() -> None:
    rig = Rig("experimental_autopilot", rate_hz=20)
    assert rig.step(**TELEMETRY)["roll_command"] == pytest.approx(0, abs=1)
    on_the_circle = TELEMETRY | {"telemetry_latitude": HOME_LATITUDE_DEG - 400 / 111_320, "telemetry_course": 270.0}
    assert rig.step(**on_the_circle)["roll_command"] == pytest.approx(0, abs=1)


def test_the_experiment_leaves_an_aircraft_on_its_balloon_alone() -> None:
    status = (Stage.ASCENT, 0, 0, 120)
    outputs = Rig("experimental_autopilot").step(**TELEMETRY | {"telemetry_status": status, "telemetry_course": 90.0})
    assert outputs == {"pitch_command": -4.0, "roll_command": 0.0}


@pytest.mark.parametrize("missing", [name for name in TELEMETRY if name != "telemetry_status"])
def test_the_experiment_says_nothing_when_anything_is_missing(missing: str) -> None:
    assert Rig("experimental_autopilot").step(**TELEMETRY | {missing: None}) == {}


@given(
    st.floats(-90, 90), st.none() | st.floats(-1e6, 1e6), st.none() | st.floats(-200, 200), st.none() | st.floats(0, 60)
)
def test_a_demand_is_within_the_surface_s_reach_whatever_is_commanded(
    angle: float, command: float | None, rate: float | None, speed: float | None
) -> None:
    pitch, roll = Rig("pitch_control", mode="scheduled"), Rig("rudder_control", mode="damped")
    elevator = pitch.run(1, pitch_angle=angle, pitch_command=command, pitch_rate=rate, indicated_airspeed=speed)
    rudder = roll.run(1, roll_angle=angle, roll_command=command, roll_rate=rate)
    assert abs(elevator["elevator_demand"]) <= 20
    assert abs(rudder["rudder_demand"]) <= 20


def test_a_nose_too_high_asks_the_elevator_down_and_a_right_wing_too_low_the_rudder_left() -> None:
    assert Rig("pitch_control", mode="basic").step(pitch_angle=1.0)["elevator_demand"] > 0
    assert Rig("rudder_control", mode="basic").step(roll_angle=5.0)["rudder_demand"] < 0


def test_a_glide_too_fast_for_its_pitch_shows_that_gyros_alone_have_the_nose_too_high() -> None:
    demands = []
    for version in (1, 2):
        rig = Rig("pitch_control", mode="scheduled")
        for _ in range(200):
            demand = rig.feed({"pitch_angle": Datum(-4.0, version, 0), "indicated_airspeed": Datum(24.0, 1, 0)})
        demands.append(demand["elevator_demand"])
    assert demands[0] == 0.0
    assert demands[1] < -1.0  # up


def test_without_an_attitude_nothing_is_demanded() -> None:
    assert Rig("pitch_control", mode="basic").step(pitch_command=3.0) == {}
    assert Rig("rudder_control", mode="basic").step(roll_command=3.0) == {}
    assert Rig("elevator_control").step() == {}


def test_surfaces_bite_harder_in_fast_air_so_the_loop_is_weaker_there() -> None:
    fast, slow = (
        Rig("pitch_control", mode="scheduled").step(pitch_angle=0.0, indicated_airspeed=speed)["elevator_demand"]
        for speed in (25.0, 15.0)
    )
    assert 0 < fast < slow


def test_no_trim_is_learned_on_the_balloon_s_line() -> None:
    rig = Rig("pitch_control", mode="scheduled")
    first = rig.step(pitch_angle=0.0, indicated_airspeed=1.0)
    assert rig.run(60, pitch_angle=0.0, indicated_airspeed=1.0) == first
    assert rig.run(60, pitch_angle=0.0, indicated_airspeed=18.0)["elevator_demand"] == pytest.approx(4.8 + 5.0)


# ---- for those on the ground --------------------------------------------------------------------------------------


def test_telemetry_repeats_what_it_has_and_says_what_it_lacks() -> None:
    full = Rig("telemetry", mode="live").step(
        altitude=5_000.0,
        pitch_angle=-4.321,
        roll_angle=400.0,
        gps_latitude=38.0,
        gps_longitude=-84.0,
        gps_track=9.0,
        battery_voltage=11.97,
        wing_state=3,
        servo_health=0,
        mission_stage=2,
    )
    assert full == {
        "telemetry_altitude": 5_000.0,
        "telemetry_attitude": (-432, 32_767),
        "telemetry_latitude": 38.0,
        "telemetry_longitude": -84.0,
        "telemetry_course": 9.0,
        "telemetry_status": (2, 3, 0, 120),
    }
    assert Rig("telemetry", mode="slow").step(pitch_angle=1.0, wing_state=1) == {"telemetry_status": (255, 1, 255, 255)}


def test_the_display_and_the_recorder_write_what_is_there() -> None:
    display, recorder = Rig("ground_display", mode="live"), Rig("flight_recorder")
    display.step(**TELEMETRY | {"telemetry_latitude": None, "telemetry_status": (2, 255, 0, 120)})
    recorder.step(altitude=5_000.0, wing_state=3)
    place = "telemetry_altitude=5000 telemetry_longitude=-84.5 telemetry_course=0"
    assert display.host.written == [f"0 {place} pitch=-4 roll=0 stage=2 servos=0 battery=120"]
    assert recorder.host.written == ["0 altitude=5000 wing_state=3"]


def test_the_pilot_sees_the_glide_path() -> None:
    rig = Rig("pilot_view")
    rig.step(
        **TELEMETRY
        | {"telemetry_latitude": HOME_LATITUDE_DEG - 0.1, "telemetry_altitude": 1_178.4, "telemetry_course": 350.0}
    )
    (line,) = rig.host.written
    assert line.endswith("distance=11132 above=100 turn=10")


@pytest.mark.parametrize("mode", ["full", "preview"])
def test_a_picture_sent_word_by_word_arrives_whole(mode: str) -> None:
    sender, archive = Rig("imaging", mode=mode, rate_hz=80), Rig("image_archive", rate_hz=80)
    for _ in range(WORDS * 5):
        archive.step(**sender.step(frame_count=1234, gps_latitude=38.03, altitude=5_000.0))
    assert isinstance(archive.module, ImageArchive)
    per_picture = WORDS if mode == "full" else HEAD_WORDS + (WORDS - HEAD_WORDS) // 4
    assert (archive.module.whole_frames, archive.module.spoilt_frames) == (WORDS * 5 // per_picture, 0)


@given(lost=st.integers(0, 3 * WORDS - 1))
def test_a_lost_word_spoils_one_picture_and_no_other(lost: int) -> None:
    sender, archive = Rig("imaging", mode="full", rate_hz=80), Rig("image_archive", rate_hz=80)
    for tick in range(5 * WORDS):
        words = sender.step(frame_count=tick)
        archive.step(**({} if tick == lost else words))
    assert isinstance(archive.module, ImageArchive)
    assert archive.module.whole_frames == 4
    assert archive.module.spoilt_frames <= 1


def test_a_word_that_stays_for_several_periods_counts_once() -> None:
    sender, archive = Rig("imaging", mode="preview", rate_hz=20), Rig("image_archive", rate_hz=80)
    for _ in range(WORDS):
        words = sender.step(frame_count=9)
        for _ in range(4):
            archive.step(**words)
    assert isinstance(archive.module, ImageArchive)
    assert (archive.module.whole_frames, archive.module.spoilt_frames) == (WORDS // 19, 0)


def test_no_frame_no_picture() -> None:
    assert Rig("imaging", mode="full").run(3) == {}
