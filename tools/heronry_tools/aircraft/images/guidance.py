"""The outer loops: from a position and the stage of the flight to a commanded attitude.

There are two outer loops (source: the paper by Rawashdeh et al. that docs/semantics.md names, section 4):

    Guidance        is on board. It flies home on a straight line, or straight ahead if no position is known
    OrbitAutopilot  is the experiment on the ground. It gets all its inputs by telemetry, and commands a circle over the
                    field. A vector field leads to the circle from anywhere, so there is no switching between approach
                    and circle

Both publish commands in degrees. The inner loops (control.py) limit the commands, and keep flying if none comes.

If only gyros measure the attitude, the measured bank is wrong after a long turn. The aircraft would bank more and more
while it circles over the field. Its track shows this error: it turns faster than it should with the commanded bank. So
`Guidance` learns a correction, and commands less bank, down to level wings.

A restart of `Guidance` loses this correction; to learn it again takes half a minute. A restart of `OrbitAutopilot`
loses nothing, since every command depends only on the inputs of one step.
"""

import math
from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number, numbers, whole
from heronry_tools.aircraft.images.control import BEST_GLIDE_M_PER_S, BEST_GLIDE_PITCH_DEG
from heronry_tools.aircraft.images.mission import Stage

# The field at which the flight begins and ends: near Lexington, Kentucky.
HOME_LATITUDE_DEG = 38.03
HOME_LONGITUDE_DEG = -84.50
HOME_ALTITUDE_M = 300.0
M_PER_DEG_LATITUDE = 111_320.0

_NS_PER_S = 1_000_000_000
_G_M_PER_S2 = 9.81
_LEAST_M_PER_S = 8.0  # slower than this the aircraft does not fly
_LEARNED_PER_S = 0.04
_SHOWN_LIMIT_DEG = 45.0
_BANK_PER_DEG = 0.8
_HOME_BANK_LIMIT_DEG = 20.0
_FLARE_M = 8.0
_FLARE_PITCH_DEG = 4.0
_ORBIT_RADIUS_M = 400.0
_ORBIT_BANK_LIMIT_DEG = 25.0
_STEEPEST_PITCH_DEG = -8.0


def home_bearing_and_distance(latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Return the bearing of the field in degrees (-180..180, clockwise from north) and its distance in m.

    The earth counts as flat.
    """
    north_m = (HOME_LATITUDE_DEG - latitude_deg) * M_PER_DEG_LATITUDE
    per_deg_m = M_PER_DEG_LATITUDE * math.cos(math.radians(HOME_LATITUDE_DEG))
    east_m = (HOME_LONGITUDE_DEG - longitude_deg) * per_deg_m
    return math.degrees(math.atan2(east_m, north_m)), math.hypot(north_m, east_m)


def turn_deg(wanted_deg: float, present_deg: float) -> float:
    """Return the shorter turn from the present to the wanted direction, -180..180; to the right is positive."""
    return (wanted_deg - present_deg + 180.0) % 360.0 - 180.0


class Guidance(Module):
    """Flies home (mode `route`) or straight ahead (mode `level`)."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._track_deg: float | None = None  # in the last step
        self._learned_deg = 0.0  # is added to the wanted bank

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish commanded pitch and roll in degrees.

        If the position or the track is missing, the mode `route` flies straight ahead.
        """
        wanted_deg = self._roll_deg(inputs)
        if self.ctx.mode == "route" and not _flares(inputs):
            self._learn(inputs, wanted_deg)
        return {"pitch_command": self._pitch_deg(inputs), "roll_command": wanted_deg + self._learned_deg}

    def _learn(self, inputs: Inputs, wanted_deg: float) -> None:
        before_deg, self._track_deg = self._track_deg, number(inputs, "gps_track")
        true_m_per_s, stage = number(inputs, "true_airspeed"), whole(inputs, "mission_stage")
        if before_deg is None or self._track_deg is None or true_m_per_s is None or true_m_per_s < _LEAST_M_PER_S:
            return
        if stage is None or stage < Stage.GLIDE:
            return
        period_s = self.ctx.period_ns / _NS_PER_S
        turn_rad_per_s = math.radians(turn_deg(self._track_deg, before_deg)) / period_s
        shown_deg = math.degrees(math.atan(true_m_per_s * turn_rad_per_s / _G_M_PER_S2))
        difference_deg = wanted_deg - held(shown_deg, _SHOWN_LIMIT_DEG)
        learned_deg = held(self._learned_deg + _LEARNED_PER_S * difference_deg * period_s, abs(wanted_deg))
        self._learned_deg = min(learned_deg, 0.0) if wanted_deg > 0.0 else max(learned_deg, 0.0)

    def _pitch_deg(self, inputs: Inputs) -> float:
        return _FLARE_PITCH_DEG if _flares(inputs) else BEST_GLIDE_PITCH_DEG

    def _roll_deg(self, inputs: Inputs) -> float:
        if _flares(inputs):
            return 0.0  # in a bank, a wing tip would touch the ground before the skids
        place = (number(inputs, "gps_latitude"), number(inputs, "gps_longitude"))
        track_deg = number(inputs, "gps_track")
        if self.ctx.mode != "route" or place[0] is None or place[1] is None or track_deg is None:
            return 0.0
        bearing_deg, _ = home_bearing_and_distance(place[0], place[1])
        return held(_bank_per_deg(inputs) * turn_deg(bearing_deg, track_deg), _HOME_BANK_LIMIT_DEG)


def _flares(inputs: Inputs) -> bool:
    altitude_m = number(inputs, "altitude")
    landing = whole(inputs, "mission_stage") == Stage.LANDING
    return landing and altitude_m is not None and altitude_m < HOME_ALTITUDE_M + _FLARE_M


def _bank_per_deg(inputs: Inputs) -> float:
    """Return the bank in degrees that is commanded per degree of turn.

    This bank is larger at a high true airspeed, at which a bank turns the aircraft more slowly.
    """
    true_m_per_s = number(inputs, "true_airspeed")
    if true_m_per_s is None:
        return _BANK_PER_DEG
    return _BANK_PER_DEG * min(max(true_m_per_s / BEST_GLIDE_M_PER_S, 1.0), 2.0)


class OrbitAutopilot(Module):
    """The experimental autopilot: commands a circle over the field, with a steeper glide at a greater height.

    While telemetry shows that the aircraft hangs on its balloon, the commands are level wings and the best glide.
    """

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish commanded pitch and roll in degrees.

        Publishes nothing if altitude, course, position or attitude is missing.
        """
        altitude_m, course_deg = number(inputs, "telemetry_altitude"), number(inputs, "telemetry_course")
        place = (number(inputs, "telemetry_latitude"), number(inputs, "telemetry_longitude"))
        attitude = numbers(inputs, "telemetry_attitude", 2)
        if altitude_m is None or course_deg is None or place[0] is None or place[1] is None or attitude is None:
            return {}
        status = numbers(inputs, "telemetry_status", 4)
        if status is not None and status[0] < Stage.GLIDE:
            return {"pitch_command": BEST_GLIDE_PITCH_DEG, "roll_command": 0.0}
        bearing_deg, distance_m = home_bearing_and_distance(place[0], place[1])
        # Far away, the wanted course leads to the field. On the circle, it is at right angles to the direction of the
        # field. Inside the circle, it leads outwards.
        inward_deg = math.degrees(math.atan2(distance_m - _ORBIT_RADIUS_M, _ORBIT_RADIUS_M))
        wanted_deg = bearing_deg - 90.0 + inward_deg
        roll_deg = held(turn_deg(wanted_deg, course_deg), _ORBIT_BANK_LIMIT_DEG)
        return {"pitch_command": self._pitch_deg(altitude_m, attitude[1] / 100.0), "roll_command": roll_deg}

    def _pitch_deg(self, altitude_m: float, roll_deg: float) -> float:
        """Return the commanded pitch: the higher the aircraft, the steeper the glide; in a bank the nose is raised."""
        height_km = max(altitude_m - HOME_ALTITUDE_M, 0.0) / 1000.0
        glide_deg = max(BEST_GLIDE_PITCH_DEG - 0.2 * height_km, _STEEPEST_PITCH_DEG)
        return glide_deg + 1.5 * (1.0 - math.cos(math.radians(held(roll_deg, 60.0))))
