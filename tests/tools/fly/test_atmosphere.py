"""Wind and turbulence against the figures of MIL-F-8785C: profile, scales, intensities, spectrum; equal for a seed."""

import math
import statistics

import pytest

from heronry_tools.fly.atmosphere import M_PER_FT, Air, Turbulence, Wind, intensities_m_per_s, scales_m


def test_the_wind_at_20_ft_is_the_given_one_and_grows_with_the_logarithm_of_the_height() -> None:
    wind = Wind(6.0, from_deg=90.0)
    north, east = wind.at(20 * M_PER_FT)
    assert (north, east) == pytest.approx((0.0, -6.0), abs=1e-12)
    assert wind.at(200 * M_PER_FT)[1] == pytest.approx(-6.0 * math.log(200 / 0.15) / math.log(20 / 0.15))
    assert wind.at(0.0) == wind.at(3 * M_PER_FT)
    assert wind.at(5_000.0) == wind.at(1_000 * M_PER_FT)


def test_above_the_boundary_layer_the_wind_goes_through_the_points_aloft() -> None:
    wind = Wind(4.0, 270.0, aloft=((10_000.0, 20.0, 270.0), (20_000.0, 5.0, 180.0)))
    assert wind.at(10_000.0) == pytest.approx((0.0, 20.0), abs=1e-9)
    assert wind.at(15_000.0) == pytest.approx((2.5, 10.0), abs=1e-9)
    assert wind.at(30_000.0) == pytest.approx((5.0, 0.0), abs=1e-9)
    low, high = wind.at(1_000 * M_PER_FT)[1], wind.at(1_000.001 * M_PER_FT)[1]
    assert high == pytest.approx(low, abs=1e-3)


def test_scales_and_intensities_are_those_of_the_standard() -> None:
    assert scales_m(1_000 * M_PER_FT) == pytest.approx((304.8, 304.8))
    horizontal, vertical = scales_m(100 * M_PER_FT)
    assert vertical == pytest.approx(100 * M_PER_FT)
    assert horizontal / M_PER_FT == pytest.approx(100 / (0.177 + 0.0823) ** 1.2)
    assert scales_m(9_000.0) == pytest.approx((1_750 * M_PER_FT,) * 2)
    assert intensities_m_per_s(1_000 * M_PER_FT, 7.0) == pytest.approx((0.7, 0.7))
    assert intensities_m_per_s(100 * M_PER_FT, 7.0) == pytest.approx((0.7 / (0.177 + 0.0823) ** 0.4, 0.7))
    assert intensities_m_per_s(12_000.0, 7.0)[0] < 0.05


@pytest.mark.parametrize("step_s", [0.02, 0.1, 2.0])
def test_gusts_have_their_intensity_at_any_step(step_s) -> None:
    gusts = Turbulence(1, 8.0)
    rows = [gusts.step(step_s, 30.0, 60.0) for _ in range(round(3_000 / step_s**0.5))]
    horizontal, vertical = intensities_m_per_s(30.0, 8.0)
    for axis, intensity in zip(zip(*rows, strict=True), (horizontal, horizontal, vertical), strict=True):
        assert statistics.pstdev(axis) == pytest.approx(intensity, rel=0.12)
        assert statistics.mean(axis) == pytest.approx(0.0, abs=0.15 * intensity)


@pytest.mark.parametrize(("axis", "expected"), [(0, math.exp(-1.0)), (2, 0.5 * math.exp(-1.0))])
def test_gusts_are_correlated_as_dryden_has_it(axis, expected) -> None:
    """Longitudinal gusts are correlated by exp(-x / L), transverse ones by (1 - x / 2L) exp(-x / L)."""
    gusts, step_s = Turbulence(3, 8.0), 0.1
    height_m, flow = 30.0, 60.0
    lag = round(scales_m(height_m)[0 if axis == 0 else 1] / flow / step_s)
    row = [gusts.step(step_s, height_m, flow)[axis] for _ in range(40_000)]
    assert statistics.correlation(row[:-lag], row[lag:]) == pytest.approx(expected, abs=0.1)


def test_equal_seeds_give_equal_air_and_other_seeds_other_air() -> None:
    def flown(seed: int) -> list[tuple[float, float, float]]:
        air = Air(seed, Wind(7.0, 30.0))
        return [air.step(1 / 120, 50.0 - 0.1 * n, 17.0, 0.0) for n in range(300)]

    assert flown(5) == flown(5)
    assert flown(5) != flown(6)


def test_calm_air_does_not_move() -> None:
    assert Air(1, Wind()).step(0.01, 10.0, 17.0, 1.0) == pytest.approx((0.0, 0.0, 0.0))


def test_gusts_turn_with_the_heading() -> None:
    north, east = (Air(9, Wind(5.0, 0.0)).step(0.1, 30.0, 17.0, heading) for heading in (0.0, math.pi / 2))
    mean = Wind(5.0, 0.0).at(30.0)[0]
    assert east[1] == pytest.approx(north[0] - mean)
    assert east[2] == north[2]
