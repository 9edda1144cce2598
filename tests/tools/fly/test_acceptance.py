"""Acceptance of a landing: each limit from both sides, and the interval of a share against published figures."""

from dataclasses import replace

import pytest

from heronry_tools.fly.acceptance import CAUSES, Touchdown, causes, interval

GOOD = Touchdown(time_s=60.0, x_m=5.0, y_m=0.4, sink_m_per_s=0.6, bank_deg=1.0, pitch_deg=5.0, airspeed_m_per_s=15.0)


def test_a_good_landing_has_no_cause() -> None:
    assert causes(GOOD) == ()


@pytest.mark.parametrize(
    ("cause", "at_limit", "beyond"),
    [
        ("sink", {"sink_m_per_s": 1.5}, {"sink_m_per_s": 1.51}),
        ("offset", {"y_m": 7.2}, {"y_m": 7.21}),
        ("offset", {"y_m": -7.2}, {"y_m": -7.21}),
        ("short", {"x_m": -60.0}, {"x_m": -60.1}),
        ("long", {"x_m": 90.0}, {"x_m": 90.1}),
        ("bank", {"bank_deg": 10.0}, {"bank_deg": 10.1}),
        ("bank", {"bank_deg": -10.0}, {"bank_deg": -10.1}),
        ("nose low", {"pitch_deg": 0.0}, {"pitch_deg": -0.1}),
        ("nose high", {"pitch_deg": 14.0}, {"pitch_deg": 14.1}),
        ("structure", {"structure": ()}, {"structure": ("left_tip",)}),
    ],
)
def test_a_limit_itself_is_acceptable_and_beyond_it_is_a_cause(cause, at_limit, beyond) -> None:
    assert causes(replace(GOOD, **at_limit)) == ()
    assert causes(replace(GOOD, **beyond)) == (cause,)


def test_an_aircraft_that_has_not_touched_the_ground_has_not_landed() -> None:
    assert causes(None) == ("not landed",)


def test_a_landing_on_the_field_is_near_home_and_slow() -> None:
    on_field = replace(GOOD, x_m=300.0, y_m=-400.0, sink_m_per_s=3.0, bank_deg=25.0, pitch_deg=-5.0)
    assert causes(on_field, "field") == ()
    assert causes(replace(on_field, x_m=301.0), "field") == ("far",)
    assert causes(replace(on_field, sink_m_per_s=3.1, structure=("nose",)), "field") == ("structure", "sink")


def test_every_cause_is_told_in_one_order() -> None:
    crash = replace(GOOD, x_m=-80.0, y_m=9.0, sink_m_per_s=5.0, bank_deg=40.0, pitch_deg=-20.0, structure=("tail",))
    assert causes(crash) == ("structure", "sink", "offset", "short", "bank", "nose low")
    assert [cause for cause in CAUSES if cause in causes(crash)] == list(causes(crash))


@pytest.mark.parametrize(
    ("acceptable", "runs", "low", "high"),
    # Agresti and Coull (1998), Newcombe (1998), and both ends.
    [(0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (15, 148, 0.0624, 0.1605), (81, 263, 0.2553, 0.3662), (0, 0, 0, 1)],
)
def test_the_interval_is_that_of_wilson(acceptable, runs, low, high) -> None:
    assert interval(acceptable, runs) == pytest.approx((low, high), abs=5e-5)
