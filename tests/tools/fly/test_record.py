"""The record of a flight: written while it is flown, kept as JSON, read again without loss."""

import json
from dataclasses import replace

import pytest

from heronry_tools.fly.plant import Truth
from heronry_tools.fly.record import FlightRecord, Mark, Recorder, Stretch

HIGH = Truth(
    time_s=0.0, x_m=-500.0, y_m=1.0, height_m=50.0, north_m_per_s=17.0, east_m_per_s=0.0, up_m_per_s=-1.4,
    roll_deg=0.5, pitch_deg=2.0, heading_deg=0.0, airspeed_m_per_s=17.0, load_factor_g=1.0, touching=(),
)  # fmt: skip
DOWN = replace(HIGH, time_s=30.0, x_m=3.0, height_m=0.0, up_m_per_s=-0.6, touching=("left_wheel",))


def _landing() -> FlightRecord:
    recorder = Recorder("eav", "a landing", 7)
    recorder.sample(HIGH, {"estimate_x_m": -499.0})
    recorder.state(0.0, "mode", "fms", "approach")
    recorder.state(0.0, "place", "filter", "rover")
    recorder.mark(10.0, "fault", "device:gps is reported failed")
    recorder.state(10.2, "place", "filter", "flight")
    recorder.state(20.0, "mode", "fms", "flare")
    recorder.state(25.0, "mode", "fms", "flare")
    recorder.watch(replace(DOWN, time_s=29.9))
    recorder.sample(DOWN, {"load_can0": 0.1})
    return recorder.finished()


def test_columns_are_of_one_length_and_what_was_not_known_is_none() -> None:
    record = _landing()
    assert record.times_s == (0.0, 30.0)
    assert record.columns["x_m"] == (-500.0, 3.0)
    assert record.columns["estimate_x_m"] == (-499.0, None)
    assert record.columns["load_can0"] == (None, 0.1)
    assert record.known("load_can0")
    assert not record.known("load_radio")


def test_a_stretch_ends_where_the_next_begins_and_the_last_with_the_record() -> None:
    assert _landing().stretches == (
        Stretch("mode", "fms", "approach", 0.0, 20.0),
        Stretch("place", "filter", "rover", 0.0, 10.2),
        Stretch("place", "filter", "flight", 10.2, 30.0),
        Stretch("mode", "fms", "flare", 20.0, 30.0),
    )


def test_a_subject_without_a_state_has_no_stretch() -> None:
    recorder = Recorder("eav", "", 0)
    recorder.state(1.0, "place", "filter", "rover")
    recorder.state(2.0, "place", "filter", None)
    recorder.state(3.0, "place", "filter", None)
    recorder.sample(DOWN, {})
    assert recorder.finished().stretches == (Stretch("place", "filter", "rover", 1.0, 2.0),)


def test_the_first_contact_is_the_touchdown_and_later_structure_counts() -> None:
    recorder = Recorder("eav", "", 0)
    recorder.watch(HIGH)
    assert recorder.touchdown is None
    recorder.watch(DOWN)
    recorder.watch(replace(DOWN, time_s=31.0, up_m_per_s=-9.0, touching=("left_wheel", "right_tip")))
    landed = recorder.touchdown
    assert landed is not None
    assert (landed.time_s, landed.sink_m_per_s, landed.structure) == (30.0, 0.6, ("right_tip",))
    assert recorder.finished().causes == ("structure",)
    assert recorder.finished().marks == (Mark(30.0, "touchdown", "the aircraft touches the ground"),)


def test_an_empty_record_has_its_time_and_no_landing() -> None:
    record = Recorder("eav", "", 0).finished()
    assert record.times_s == ()
    assert record.causes == ("not landed",)


def test_the_json_form_is_read_again_without_loss() -> None:
    record = _landing()
    assert FlightRecord.from_json(record.as_json()) == record
    empty = Recorder("eav", "", 0).finished()
    assert FlightRecord.from_json(empty.as_json()) == empty


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "format None; this version of heronry reads 1"),
        ("[]", "not the record of a flight"),
        (json.dumps({"format": 1, "touchdown": None}), "'spec'"),
    ],
)
def test_a_text_that_is_no_record_is_refused_with_a_reason(text, message) -> None:
    with pytest.raises(ValueError, match=message):
        FlightRecord.from_json(text)
