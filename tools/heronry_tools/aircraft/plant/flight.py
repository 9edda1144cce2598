"""The scripted flight of the plant: climb under a balloon, inflation of the wings, release, glide home, landing.

The position of the aircraft, and its motion in turbulence, depend only on the time since take-off. So all processes
with the same time of take-off agree, and a restarted process agrees with the others at once. The price is that no
actuator changes the path. But the surfaces add to the attitude of the script (devices.py). So the control loops of the
aircraft are closed in attitude, and open in position.

Time is compressed, space is not: two hours of flight take four minutes, with vertical speeds far beyond those of a
glider. The sensors are consistent all the same: pressure with altitude, angular rates with the change of attitude,
accelerations with attitude. Angles are small and the flight is quasi-steady: body rates are taken as the rates of pitch
and roll, and an accelerometer feels gravity alone.

    seconds   0      5        65          93..95        103      215      225     235
              field  ascent   17.8 km     line is cut   glide    landing  flare   stands
"""

import math
from bisect import bisect_right
from dataclasses import dataclass

from heronry_tools.aircraft.images.guidance import (
    HOME_ALTITUDE_M,
    HOME_LATITUDE_DEG,
    HOME_LONGITUDE_DEG,
    M_PER_DEG_LATITUDE,
)

NS_PER_S = 1_000_000_000

CUTDOWN_S = 93.0  # the ground commands the cut
RELEASE_S = 95.0
GLIDE_S = 103.0
TOUCHDOWN_S = 235.0

_M_PER_DEG_LONGITUDE = M_PER_DEG_LATITUDE * math.cos(math.radians(HOME_LATITUDE_DEG))
_STEP_S = 0.005  # half the distance of the two points from which a rate is computed


class _Curve:
    """A curve through points (time in s, value), joined by half waves of a cosine: smooth, and level at each point."""

    __slots__ = ("_times_s", "_values")

    def __init__(self, *points: tuple[float, float]) -> None:
        self._times_s = [time_s for time_s, _ in points]
        self._values = [value for _, value in points]

    def at(self, time_s: float) -> float:
        times_s, values = self._times_s, self._values
        index = bisect_right(times_s, time_s)
        if index == 0:
            return values[0]
        if index == len(times_s):
            return values[-1]
        start_s, end_s, start, end = times_s[index - 1], times_s[index], values[index - 1], values[index]
        return start + (end - start) * (1.0 - math.cos(math.pi * (time_s - start_s) / (end_s - start_s))) / 2.0


_ALTITUDE_M = _Curve(
    (5.0, HOME_ALTITUDE_M),
    (65.0, 17_800.0),
    (RELEASE_S, 20_000.0),
    (215.0, 900.0),
    (TOUCHDOWN_S, HOME_ALTITUDE_M),
)
_EAST_M = _Curve((5.0, 0.0), (RELEASE_S, 30_000.0), (TOUCHDOWN_S, 0.0))
_NORTH_M = _Curve((5.0, 0.0), (RELEASE_S, 4_000.0), (TOUCHDOWN_S, 0.0))
_AIRSPEED_M_PER_S = _Curve(
    (5.0, 0.0),
    (10.0, 1.5),
    (RELEASE_S, 1.5),
    (98.0, 26.0),
    (GLIDE_S, 18.0),
    (225.0, 18.0),
    (TOUCHDOWN_S, 0.0),
)
_MEAN_PITCH_DEG = _Curve(
    (5.0, 0.0),
    (RELEASE_S, 0.0),
    (97.0, -30.0),
    (GLIDE_S, -4.0),
    (225.0, -4.0),
    (232.0, 5.0),
    (TOUCHDOWN_S, 0.0),
)
# How far the aircraft sways in pitch (every 7 s) and in roll (every 11 s), in degrees.
_PITCH_SWAY_DEG = _Curve((5.0, 0.0), (12.0, 3.0), (RELEASE_S, 3.0), (110.0, 5.0), (225.0, 5.0), (232.0, 0.0))
_ROLL_SWAY_DEG = _Curve((5.0, 0.0), (12.0, 5.0), (RELEASE_S, 4.0), (110.0, 12.0), (225.0, 12.0), (232.0, 0.0))
_PITCH_SWAY_RAD_PER_S = math.tau / 7.0
_ROLL_SWAY_RAD_PER_S = math.tau / 11.0
# The pressure in the wings that a plant assumes until it hears that the valve moves. So the wings in a process that is
# restarted in flight are as full as in the other processes.
_WING_PRESSURE_HPA = _Curve((70.0, 0.0), (80.0, 500.0))


@dataclass(frozen=True, slots=True)
class Moment:
    """The aircraft at one time, with its surfaces at neutral; each value is computed when it is read.

    Angles in degrees: pitch nose up, roll to the right, track clockwise from north.
    """

    time_s: float

    @property
    def altitude_m(self) -> float:
        """Height above sea level."""
        return _ALTITUDE_M.at(self.time_s)

    @property
    def latitude_deg(self) -> float:
        """Latitude, north positive."""
        return HOME_LATITUDE_DEG + _NORTH_M.at(self.time_s) / M_PER_DEG_LATITUDE

    @property
    def longitude_deg(self) -> float:
        """Longitude, east positive."""
        return HOME_LONGITUDE_DEG + _EAST_M.at(self.time_s) / _M_PER_DEG_LONGITUDE

    @property
    def track_deg(self) -> float:
        """Direction of flight over ground, clockwise from north."""
        return _track_deg(self.time_s)

    @property
    def airspeed_m_per_s(self) -> float:
        """Indicated airspeed."""
        return _AIRSPEED_M_PER_S.at(self.time_s)

    @property
    def pitch_deg(self) -> float:
        """Pitch angle, nose up positive."""
        return _pitch_deg(self.time_s)

    @property
    def roll_deg(self) -> float:
        """Roll angle, to the right positive."""
        return _roll_deg(self.time_s)

    @property
    def pitch_rate_deg_per_s(self) -> float:
        """Rate of the pitch angle."""
        return (_pitch_deg(self.time_s + _STEP_S) - _pitch_deg(self.time_s - _STEP_S)) / (2.0 * _STEP_S)

    @property
    def roll_rate_deg_per_s(self) -> float:
        """Rate of the roll angle."""
        return (_roll_deg(self.time_s + _STEP_S) - _roll_deg(self.time_s - _STEP_S)) / (2.0 * _STEP_S)


def moment(time_ns: int) -> Moment:
    """Return the state of the aircraft at a time (ns after take-off); before take-off it stands on the field."""
    return Moment(max(time_ns, 0) / NS_PER_S)


def wing_pressure_hpa(time_ns: int) -> float:
    """Return the pressure in the wings (hPa) at a time (ns after take-off), if no module has moved the valve so far."""
    return _WING_PRESSURE_HPA.at(max(time_ns, 0) / NS_PER_S)


def _pitch_deg(time_s: float) -> float:
    return _MEAN_PITCH_DEG.at(time_s) + _PITCH_SWAY_DEG.at(time_s) * math.sin(_PITCH_SWAY_RAD_PER_S * time_s)


def _roll_deg(time_s: float) -> float:
    return _ROLL_SWAY_DEG.at(time_s) * math.sin(_ROLL_SWAY_RAD_PER_S * time_s)


def _track_deg(time_s: float) -> float:
    east, north = (curve.at(time_s + _STEP_S) - curve.at(time_s - _STEP_S) for curve in (_EAST_M, _NORTH_M))
    return math.degrees(math.atan2(east, north)) % 360.0
