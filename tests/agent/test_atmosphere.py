"""The standard atmosphere against the printed one, and against itself."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_tools.aircraft.images import atmosphere

# ICAO Doc 7488, geopotential altitude (m) and pressure (hPa).
PRINTED = [(0, 1013.25), (1_000, 898.745), (5_000, 540.199), (11_000, 226.321), (20_000, 54.749), (32_000, 8.680)]


@pytest.mark.parametrize(("altitude_m", "pressure_hpa"), PRINTED)
def test_it_is_the_printed_one(altitude_m: float, pressure_hpa: float) -> None:
    assert atmosphere.pressure_hpa(altitude_m) == pytest.approx(pressure_hpa, rel=1e-4)


@given(st.floats(-2_000, 47_000))
def test_altitude_undoes_pressure(altitude_m: float) -> None:
    assert atmosphere.altitude_m(atmosphere.pressure_hpa(altitude_m)) == pytest.approx(altitude_m, abs=0.01)


@given(st.floats(-2_000, 46_999), st.floats(0.1, 1_000))
def test_pressure_falls_with_altitude(altitude_m: float, step_m: float) -> None:
    higher_m = min(altitude_m + step_m, 47_000)
    assert atmosphere.pressure_hpa(higher_m) < atmosphere.pressure_hpa(altitude_m)


@pytest.mark.parametrize(("pressure_hpa", "end_m"), [(1e-300, 47_000), (1e-9, 47_000), (5_000.0, -2_000)])
def test_a_pressure_that_no_air_has_gives_an_end_of_the_table(pressure_hpa: float, end_m: float) -> None:
    assert atmosphere.altitude_m(pressure_hpa) == pytest.approx(end_m)


def test_density_at_sea_level_and_in_the_stratosphere() -> None:
    assert atmosphere.density_kg_per_m3(1013.25) == pytest.approx(1.225, rel=1e-4)
    assert atmosphere.density_kg_per_m3(54.749) == pytest.approx(0.0880, rel=1e-3)


@given(st.floats(0, 100))
def test_airspeed_undoes_the_differential_pressure(speed: float) -> None:
    assert atmosphere.indicated_airspeed_m_per_s(atmosphere.differential_hpa(speed)) == pytest.approx(speed, abs=1e-6)


def test_suction_is_no_airspeed() -> None:
    assert atmosphere.indicated_airspeed_m_per_s(-1.0) == 0.0
