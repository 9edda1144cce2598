"""The parts for fault tolerance: what each gives, which element it reports, and when it reports none.

Three files in tests/scenarios fly them: a monitored servo jams, a barometer is stuck, a voter hears a wrong channel.
"""

import math
import statistics
from itertools import pairwise
from typing import ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.rig import Rig
from heronry_agent.module import DISAGREEMENT, Datum, Inputs
from heronry_agent.parts.choosers import NVersion

MEDIAN, MAJORITY, FAIL_OVER = "pressure_median", "pressure_majority", "pressure_fail_over"
pressures = st.floats(100.0, 1100.0)


class ThreeWritten(NVersion):
    """Three programs."""

    variable, output, tolerance = "angle", "angle", 5.0
    authors: ClassVar = {1: "module:first", 2: "module:second", 3: "module:third"}


def written(rig: Rig, seconds: float, **by_version: float | None) -> object:
    """Feed versions v1, v2, v3 of `angle` for some time; gives the last output."""
    out: object = None
    data = [Datum(value, int(name[1:]), 0) for name, value in by_version.items() if value is not None]
    for _ in range(round(seconds * 40)):
        out = rig.module.step(Inputs({str(i): ("angle", datum) for i, datum in enumerate(data)})).get("angle")
    return out


# Comparators


def compared(rig: Rig, seconds: float, **by_version: float | None) -> object:
    """Feed versions v1, v2 of the pitch for some time; gives the last output."""
    out: object = None
    data = [Datum(value, int(name[1:]), 0) for name, value in by_version.items() if value is not None]
    for _ in range(round(seconds * 40)):
        inputs = Inputs({str(i): ("pitch_angle", datum) for i, datum in enumerate(data)})
        out = rig.module.step(inputs).get("checked_pitch")
    return out


@pytest.mark.parametrize(
    ("image", "chosen"), [("comparator_better", 9.0), ("comparator_safer", 2.0), ("comparator_none", None)]
)
def test_a_comparator_tells_a_drifting_twin_blames_none_and_lets_go_on_what_it_is_made_for(
    image: str, chosen: float | None
) -> None:
    rig = Rig(image)
    assert compared(rig, 0.9, v1=9.0, v2=2.0) == 9.0  # it has to last
    assert rig.host.reports == []
    assert compared(rig, 0.2, v1=9.0, v2=2.0) == chosen
    assert rig.host.reports == [(DISAGREEMENT, 140)]
    compared(rig, 2.0, v1=9.0, v2=2.0)
    assert set(rig.host.reports) == {(DISAGREEMENT, 140)}
    assert compared(rig, 0.9, v1=6.0, v2=2.0) == (None if chosen is None else 6.0 if chosen == 9.0 else 2.0)
    assert compared(rig, 0.2, v1=6.0, v2=2.0) == 6.0
    assert len(rig.host.reports) == 3


@pytest.mark.parametrize("image", ["comparator_better", "comparator_safer", "comparator_none"])
def test_a_comparator_with_one_version_gives_that_and_compares_nothing(image: str) -> None:
    rig = Rig(image)
    assert compared(rig, 3.0, v1=9.0) == 9.0
    assert compared(rig, 3.0, v2=2.0) == 2.0
    assert compared(rig, 3.0, v1=math.nan, v2=2.0) == 2.0
    assert compared(rig, 1.0) is None
    assert rig.host.reports == []


# Voters


@given(st.lists(pressures, min_size=3, max_size=3))
def test_the_median_is_the_middle_and_one_channel_never_leads(values: list[float]) -> None:
    named = {f"pressure_{i}": value for i, value in enumerate(values, 1)}
    assert Rig(MEDIAN).step(**named) == {"median_pressure": statistics.median(values)}


@pytest.mark.parametrize("image", [MEDIAN, MAJORITY])
def test_the_odd_one_out_is_reported_for_every_second_without_a_break(image: str) -> None:
    rig = Rig(image)
    rig.run(0.9, pressure_1=900.0, pressure_2=905.0, pressure_3=700.0)
    assert rig.host.reported == []
    rig.run(0.5, pressure_1=900.0, pressure_2=905.0, pressure_3=700.0)
    assert rig.host.reported == ["device:pressure_sensor_3"]
    rig.run(1, pressure_1=900.0, pressure_2=905.0, pressure_3=700.0)
    assert rig.host.reported == ["device:pressure_sensor_3"] * 2
    rig.step(pressure_1=900.0, pressure_2=905.0, pressure_3=903.0)
    rig.run(0.9, pressure_1=900.0, pressure_2=905.0, pressure_3=700.0)
    assert rig.host.reported == ["device:pressure_sensor_3"] * 2


def test_of_two_channels_that_differ_none_is_reported_and_the_one_nearer_to_the_last_output_is_given() -> None:
    rig = Rig(MEDIAN)
    rig.run(1, pressure_1=900.0, pressure_2=900.0, pressure_3=900.0)
    assert rig.run(3, pressure_1=902.0, pressure_3=700.0) == {"median_pressure": 902.0}
    assert rig.host.reported == []


def test_a_majority_is_more_than_half_of_all_channels_there_should_be() -> None:
    rig = Rig(MAJORITY)
    assert rig.step(pressure_1=900.0, pressure_2=910.0, pressure_3=700.0) == {"agreed_pressure": 905.0}
    assert rig.step(pressure_1=900.0, pressure_2=800.0, pressure_3=700.0) == {}
    assert rig.step(pressure_1=900.0, pressure_2=910.0) == {"agreed_pressure": 905.0}
    assert rig.step(pressure_1=900.0) == {}
    assert rig.step() == {}


@pytest.mark.parametrize("image", [MEDIAN, MAJORITY])
@pytest.mark.parametrize("nonsense", [math.nan, math.inf, "word", None])
def test_what_is_no_number_counts_for_nothing(image: str, nonsense: float | str | None) -> None:
    rig = Rig(image)
    assert list(rig.run(3, pressure_1=900.0, pressure_2=900.0, pressure_3=nonsense).values()) == [900.0]
    assert rig.host.reported == []


# Fail-over and N-version


def test_a_fail_over_is_immediate_and_the_way_back_takes_patience() -> None:
    rig = Rig(FAIL_OVER)
    both = {"agreed_pressure": 1.0, "median_pressure": 2.0}
    assert rig.step(**both) == {"static_pressure": 1.0}
    assert rig.step(median_pressure=2.0) == {"static_pressure": 2.0}
    assert rig.run(0.9, **both) == {"static_pressure": 2.0}
    assert rig.step(median_pressure=2.0) == {"static_pressure": 2.0}, "it comes and goes"
    assert rig.run(0.9, **both) == {"static_pressure": 2.0}
    assert rig.run(0.2, **both) == {"static_pressure": 1.0}
    assert rig.step() == {}


def test_the_best_program_counts_unless_two_others_outvote_it() -> None:
    rig = Rig(f"{__name__}:ThreeWritten")
    assert written(rig, 1, v1=1.0, v2=2.0, v3=3.0) == 1.0
    assert written(rig, 1.5, v1=30.0, v2=2.0, v3=3.0) == 2.0
    assert rig.host.reported == ["module:first"]
    assert written(rig, 2, v2=2.0, v3=30.0) == 2.0
    assert written(rig, 0.1, v3=30.0) == 30.0
    assert written(rig, 0.1) is None
    assert rig.host.reported == ["module:first"]


def test_where_all_programs_disagree_the_middle_one_counts() -> None:
    rig = Rig(f"{__name__}:ThreeWritten")
    assert written(rig, 1, v1=100.0, v2=50.0, v3=0.0) == 50.0
    assert written(rig, 0.1, v1=math.nan, v2=50.0) == 50.0


# Limiter and monitors


@given(st.lists(st.one_of(st.none(), st.floats(-90, 90)), min_size=1, max_size=50))
def test_a_limited_output_never_steps_further_than_its_rate(demands: list[float | None]) -> None:
    rig, outputs = Rig("elevator_limiter"), []
    for demand in demands:
        out = rig.step(elevator_demand=demand)
        assert (demand is None) == (out == {})
        outputs += out.values()
    steps = [abs(float(b) - float(a)) for a, b in pairwise(outputs)]  # type: ignore[arg-type]
    assert max(steps, default=0) <= 30 / 40 + 1e-9


def test_a_limited_output_arrives() -> None:
    rig = Rig("elevator_limiter")
    assert rig.step(elevator_demand=0.0) == {"elevator_demand": 0.0}
    assert rig.run(0.5, elevator_demand=9.0) == {"elevator_demand": 9.0}


# Parts with a state


def test_a_filter_follows_its_input_with_its_lag() -> None:
    rig = Rig("pitch_filter")
    assert rig.module.save() == ()
    assert rig.step(pitch_angle=None) == {}
    assert rig.step(pitch_angle=2.0) == {"pitch_angle": 2.0}
    covered = (float(rig.run(0.5, pitch_angle=3.0)["pitch_angle"]) - 2.0) / 1.0  # type: ignore[arg-type]
    assert covered == pytest.approx(1 - math.exp(-1), abs=0.02)


def test_an_integrator_adds_up_within_its_limits() -> None:
    rig = Rig("pitch_trim")
    assert rig.run(2.0, pitch_angle=5.0)["elevator_demand"] == pytest.approx(-2.0)
    assert rig.run(1.0, pitch_angle=None)["elevator_demand"] == pytest.approx(-2.0)
    assert rig.run(60.0, pitch_angle=5.0)["elevator_demand"] == -15.0
    assert rig.run(60.0, pitch_angle=-30.0)["elevator_demand"] == 15.0


@pytest.mark.parametrize("image", ["pitch_filter", "pitch_trim"])
def test_another_object_goes_on_from_the_state(image: str) -> None:
    here, there = Rig(image), Rig(image)
    here.run(3.0, pitch_angle=4.0)
    there.module.restore(here.module.save(), 200_000_000)
    assert there.step(pitch_angle=4.0) == here.step(pitch_angle=4.0)


def test_a_state_beyond_the_limits_is_limited() -> None:
    rig = Rig("pitch_trim")
    rig.module.restore((99.0,), 0)
    assert rig.module.save() == (15.0,)


def test_a_sensor_that_says_the_same_for_long_is_stuck() -> None:
    rig = Rig("pressure_stuck")
    for tick in range(100):
        assert rig.step(absolute_pressure=900.0 + tick % 2) == {"pressure_health": 0}
    assert rig.run(0.9, absolute_pressure=900.0) == {"pressure_health": 0}
    rig.step(absolute_pressure=None)
    assert rig.run(0.9, absolute_pressure=900.0) == {"pressure_health": 0}
    assert rig.run(0.3, absolute_pressure=900.0) == {"pressure_health": 1}
    assert rig.host.reported == ["device:barometer"]


def test_an_actuator_that_follows_with_its_lag_is_well_and_one_that_does_not_is_accused() -> None:
    rig, position = Rig("elevator_follows"), 0.0
    for tick in range(400):
        command = 10.0 * math.sin(tick / 40)
        position += (command - position) * 0.2
        assert rig.step(elevator_demand=command, elevator_angle=position) == {"elevator_health": 0}
    assert rig.run(0.9, elevator_demand=20.0, elevator_angle=0.0) == {"elevator_health": 0}
    rig.step(elevator_demand=20.0)
    assert rig.run(0.3, elevator_demand=20.0, elevator_angle=0.0) == {"elevator_health": 0}
    assert rig.run(1.5, elevator_demand=20.0, elevator_angle=0.0) == {"elevator_health": 1}
    assert rig.host.reported == ["device:elevator_servo_1"]
