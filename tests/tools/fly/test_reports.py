"""The pages of a flight and of many: well-formed, without the network, complete, and equal for equal records."""

import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from heronry_tools.fly.acceptance import Touchdown
from heronry_tools.fly.plant import Truth
from heronry_tools.fly.record import FlightRecord, Recorder
from heronry_tools.fly.report import dispersion_page, flight_page
from heronry_tools.fly.report.axes import Scale, number, span
from heronry_tools.fly.report.dispersion_page import Landing


def _record(site="runway", end_s=40, **more) -> FlightRecord:
    recorder = Recorder("eav", "with <the> rover", 7, site)
    for step in range(end_s + 1):
        height = 40.0 * (1.0 - step / end_s)
        truth = Truth(
            step, -600.0 + 15.2 * step, 2.0 * math.sin(step / 5), height, 17.0, 0.0, -1.0, 1.0, 3.0, 0.0, 17.0, 1.0,
            () if height else ("left_wheel",),
        )  # fmt: skip
        known = {name: value + truth.x_m if name == "estimate_x_m" else value for name, value in more.items()}
        recorder.sample(truth, known)
        recorder.state(step, "mode", "fms", "approach" if step < 20 else "flare")
        recorder.state(step, "place", "filter", "rover (vision)" if step < 10 else "flight (vision)")
        recorder.state(step, "place", "fms", "flight (precise)")
    recorder.mark(9.0, "fault", "pe:rover fails")
    recorder.mark(10.0, "reconfigured", "configuration 2 runs")
    return recorder.finished()


FULL = {"estimate_x_m": 0.3, "estimate_y_m": 0.0, "sigma_x_m": 0.2, "load_can0": 0.31, "elevator_deg": 1.0}


def _pictures(page: str) -> list[ET.Element]:
    parts = page.split("<svg")[1:]
    return [ET.fromstring("<svg" + part.split("</svg>")[0] + "</svg>") for part in parts]


def _words(page: str) -> str:
    return " ".join("".join(picture.itertext()) + " " for picture in _pictures(page))


def test_a_page_of_a_flight_has_its_panels_with_units_and_nothing_from_the_network() -> None:
    page = flight_page(_record(**FULL))
    words = _words(page)
    for label in ("height (m)", "speed (m/s)", "angle (deg)", "error, along (m)", "bus load (%)", "time (s)"):
        assert label in words
    assert "the filter's 3 sigma" in words
    assert "filter: rover (vision)" in words
    assert "fms: flight (precise)" not in words  # it never moved
    assert "http" not in page
    assert "src=" not in page
    assert "with &lt;the&gt; rover" in page
    assert "acceptable" in page
    assert "pe:rover fails" in page


def test_a_panel_without_data_is_left_out() -> None:
    words = _words(flight_page(_record()))
    assert "error" not in words
    assert "bus load" not in words
    assert "3 sigma" not in words


def test_a_long_flight_has_its_time_in_minutes_and_a_far_one_its_map_in_km() -> None:
    record = _record("field", end_s=1000)
    far = replace(record, columns={**record.columns, "x_m": tuple(50.0 * x for x in record.columns["x_m"])})
    words = _words(flight_page(far))
    assert "time (min)" in words
    assert "(km)" in words
    assert "distance from home" in flight_page(far)


def test_a_flight_without_a_landing_says_so() -> None:
    page = flight_page(replace(_record(), touchdown=None))
    assert "not acceptable: not landed" in page


def test_equal_records_give_equal_bytes() -> None:
    assert flight_page(_record(**FULL)) == flight_page(_record(**FULL))


def test_an_empty_record_has_a_page() -> None:
    assert "not landed" in flight_page(Recorder("eav", "", 0).finished())


@pytest.mark.parametrize("site", ["runway", "field"])
def test_a_page_of_many_landings_tells_share_interval_causes_and_bias(site) -> None:
    good = Touchdown(30.0, 5.0, 0.5, 0.6, 1.0, 5.0, 15.0)
    landings = [Landing(seed, good, 3.0, 0.1 * seed, site) for seed in range(30)]
    landings += [Landing(30, replace(good, sink_m_per_s=4.0, x_m=600.0), 3.0, 4.0, site), Landing(31, None, site=site)]
    page = dispersion_page("eav: 32 flights", landings)
    assert "30 of 32 landings are acceptable: 93.8 %, 95 % interval 79.9 to 98.3 %" in page
    words = _words(page)
    assert ("y from the centre line (m)" if site == "runway" else "north of home (m)") in words
    assert "bias of height, without its sign (m)" in words
    circles = [element for picture in _pictures(page)[:1] for element in picture.iter("circle")]
    assert len(circles) >= 30


def test_a_page_without_a_touchdown_or_a_bias_has_neither_picture() -> None:
    assert _pictures(dispersion_page("none", [Landing(1, None)])) == []


@pytest.mark.parametrize(("value", "written"), [(0.0, "0"), (-0.0, "0"), (-60.0, "-60"), (0.25, "0.25"), (3e3, "3000")])
def test_ticks_are_written_plainly(value, written) -> None:
    assert number(value) == written


def test_ticks_are_round_and_inside_and_a_flat_range_is_widened() -> None:
    assert Scale(-7.0, 11.0, 0, 100).ticks(5) == pytest.approx([-5.0, 0.0, 5.0, 10.0])
    low, high = span([3.0, 3.0, None])
    assert low < 3.0 < high
    assert span([]) != (0.0, 0.0)
