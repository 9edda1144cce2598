"""Wind and turbulence in which an aircraft flies: a logarithmic profile near the ground, gusts after Dryden.

Source: MIL-F-8785C, section 3.7 (also MIL-HDBK-1797A, appendix). The wind at 20 ft, W20, determines the mean
wind in the boundary layer and the intensity of the turbulence. The index u is along the heading, v is across
the heading, and w is vertical. Below 1 000 ft, with the height h in ft:

    mean wind     W20 ln(h / z0) / ln(20 / z0), z0 = 0.15 ft
    scales        L_w = h, L_u = L_v = h / (0.177 + 0.000823 h)^1.2
    intensities   s_w = 0.1 W20, s_u = s_v = s_w / (0.177 + 0.000823 h)^0.4

At 1 000 ft all three scales are 1 000 ft, and all three intensities are 0.1 W20. Above 1 000 ft:

    mean wind     interpolated between the points `aloft`; if there are none, the wind at 1 000 ft
    scales        grow to 1 750 ft at 2 000 ft, and are constant above
    intensities   constant up to 2 000 ft; fall exponentially above (in the standard: tables of exceedance)

The spectra, with the scale L and the airspeed V: u is white noise through one lag of L / V; v and w are white
noise through a squared lag with a lead of sqrt(3) L / V. Both filters are discretised exactly. Their output,
with a variance of 1, is then multiplied by the intensity at the present height. So the variance is right for
any time step, and follows the height immediately.

Gusts are the same over the whole span, so they do not roll the aircraft. All random numbers come from the seed.
JSBSim's own turbulence has no effect below 1 000 ft, where landings are.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from random import Random

M_PER_FT = 0.3048
_ROUGHNESS_FT = 0.15
_REFERENCE_FT = 20.0
_LEAST_FT = 3.0  # a lower height counts as this one: at a scale of 0, gusts would be white noise
_LAYER_FT = 1_000.0
_FREE_FT, _FREE_SCALE_FT = 2_000.0, 1_750.0
_FADING_FT = 10_000.0
_LEAST_FLOW_M_PER_S = 1.0


@dataclass(frozen=True, slots=True)
class Wind:
    """The mean wind.

    speed_m_per_s: speed at 20 ft above the ground
    from_deg: direction that the wind comes from, clockwise from north
    aloft: the wind above 1 000 ft, as points by rising height; a point has the height above the ground in m, the speed
        in m/s and the direction in deg
    """

    speed_m_per_s: float = 0.0
    from_deg: float = 0.0
    aloft: Sequence[tuple[float, float, float]] = field(default=())

    def at(self, height_m: float) -> tuple[float, float]:
        """Return the mean velocity of the air at a height above the ground: to north and to east, in m/s."""
        feet = height_m / M_PER_FT
        speed = self.speed_m_per_s * _profile(min(feet, _LAYER_FT))
        if feet <= _LAYER_FT or not self.aloft:
            return _blowing(speed, self.from_deg)
        points = [(_LAYER_FT * M_PER_FT, speed, self.from_deg), *self.aloft]
        index = bisect_right([point[0] for point in points], height_m)
        if index == len(points):
            return _blowing(points[-1][1], points[-1][2])
        below, above = points[index - 1], points[index]
        share = (height_m - below[0]) / (above[0] - below[0])
        lower, upper = _blowing(below[1], below[2]), _blowing(above[1], above[2])
        return lower[0] + share * (upper[0] - lower[0]), lower[1] + share * (upper[1] - lower[1])


def _profile(feet: float) -> float:
    return math.log(max(feet, _LEAST_FT) / _ROUGHNESS_FT) / math.log(_REFERENCE_FT / _ROUGHNESS_FT)


def _blowing(speed_m_per_s: float, from_deg: float) -> tuple[float, float]:
    angle = math.radians(from_deg)
    return -speed_m_per_s * math.cos(angle), -speed_m_per_s * math.sin(angle)


def scales_m(height_m: float) -> tuple[float, float]:
    """Return the length scales of horizontal and of vertical gusts at a height above the ground."""
    feet = max(height_m / M_PER_FT, _LEAST_FT)
    if feet <= _LAYER_FT:
        return feet / (0.177 + 0.000823 * feet) ** 1.2 * M_PER_FT, feet * M_PER_FT
    share = min((feet - _LAYER_FT) / (_FREE_FT - _LAYER_FT), 1.0)
    scale = (_LAYER_FT + share * (_FREE_SCALE_FT - _LAYER_FT)) * M_PER_FT
    return scale, scale


def intensities_m_per_s(height_m: float, wind_20ft_m_per_s: float) -> tuple[float, float]:
    """Return the standard deviations of horizontal and of vertical gusts at a height above the ground."""
    feet = max(height_m / M_PER_FT, _LEAST_FT)
    vertical = 0.1 * wind_20ft_m_per_s
    if feet <= _LAYER_FT:
        return vertical / (0.177 + 0.000823 * feet) ** 0.4, vertical
    fading = vertical * math.exp(-max(feet - _FREE_FT, 0.0) / _FADING_FT)
    return fading, fading


class Turbulence:
    """Gusts of one flight; equal seeds give equal gusts. Calls of `step` must follow each other in time."""

    def __init__(self, seed: int, wind_20ft_m_per_s: float) -> None:
        self._wind = wind_20ft_m_per_s
        self._random = Random(seed)
        draw = self._random.gauss
        self._along = draw(0.0, 1.0)
        self._across = _started(draw(0.0, 1.0), draw(0.0, 1.0))
        self._down = _started(draw(0.0, 1.0), draw(0.0, 1.0))

    def step(self, step_s: float, height_m: float, airspeed_m_per_s: float) -> tuple[float, float, float]:
        """Return the gusts after a time step, in m/s: along the heading, across it, and down.

        height_m: height above the ground.
        """
        if self._wind <= 0.0:
            return 0.0, 0.0, 0.0
        flow, draw = max(airspeed_m_per_s, _LEAST_FLOW_M_PER_S), self._random.gauss
        horizontal_m, vertical_m = scales_m(height_m)
        horizontal, vertical = intensities_m_per_s(height_m, self._wind)
        past = math.exp(-flow * step_s / horizontal_m)
        self._along = past * self._along + math.sqrt(1.0 - past * past) * draw(0.0, 1.0)
        self._across = _squared_lag(self._across, flow * step_s / horizontal_m, draw(0.0, 1.0), draw(0.0, 1.0))
        self._down = _squared_lag(self._down, flow * step_s / vertical_m, draw(0.0, 1.0), draw(0.0, 1.0))
        return horizontal * self._along, horizontal * _with_lead(self._across), vertical * _with_lead(self._down)


# A squared lag has two states: the first is noise through one lag, the second is the first state through the same lag.
# Stationary values: the first state has variance 1, the second has variance 1/2, and their covariance is 1/2. The noise
# that is added in each step keeps these values.
_HALF = 0.5
_LEAD, _REST = math.sqrt(3.0), 1.0 - math.sqrt(3.0)


def _started(one: float, other: float) -> tuple[float, float]:
    return one, _HALF * one + _HALF * other


def _squared_lag(state: tuple[float, float], share: float, one: float, other: float) -> tuple[float, float]:
    past = math.exp(-share)
    square = past * past
    first_variance = 1.0 - square
    common = _HALF - square * (share + _HALF)
    second_variance = _HALF - square * (share * share + share + _HALF)
    spread = math.sqrt(first_variance)
    mixed = common / spread
    rest = math.sqrt(max(second_variance - mixed * mixed, 0.0))
    first = past * state[0] + spread * one
    return first, past * (state[1] + share * state[0]) + mixed * one + rest * other


def _with_lead(state: tuple[float, float]) -> float:
    return (_LEAD * state[0] + _REST * state[1]) / math.sqrt(2.0)


class Air:
    """The moving air of one flight: the sum of mean wind and gusts."""

    def __init__(self, seed: int, wind: Wind) -> None:
        self._wind, self._gusts = wind, Turbulence(seed, wind.speed_m_per_s)

    def step(
        self, step_s: float, height_m: float, airspeed_m_per_s: float, heading_rad: float
    ) -> tuple[float, float, float]:
        """Return the velocity of the air after a time step, in m/s: to north, to east and down."""
        north, east = self._wind.at(height_m)
        along, across, down = self._gusts.step(step_s, height_m, airspeed_m_per_s)
        cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
        return north + along * cosine - across * sine, east + along * sine + across * cosine, down
