"""The inner control loops of the EAV: from the commands of the flight management to commands for surfaces and throttle.

Each class is one component of Figure 13 of the paper by Ippolito et al. (docs/flights.md). The gains are low, so that
the loops tolerate 150 ms from sensor to servo. Angles are in degrees. Pitch up, roll to the right and course clockwise
are positive. An elevator that goes down (positive) lowers the nose; a positive aileron rolls to the right; a positive
rudder yaws to the left.

The docstring of a class says what its loop does without an optional input. Without a required input, the loop publishes
nothing, and the servo stays where it is. A restart loses the integral of a loop; the loop then needs about a second to
find the trim again.
"""

import math
from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number, whole

NS_PER_S = 1_000_000_000
REFERENCE_M_PER_S = 17.0
_G = 9.81
_MASS_KG, _AREA_M2, _AIR_KG_PER_M3 = 10.52, 0.8039, 1.225
_LIFT_AT_ZERO, _LIFT_PER_RAD = 0.316, 4.67  # with the elevator that trims
_SLOWEST_M_PER_S = 11.0


def trim_alpha_deg(airspeed_m_per_s: float) -> float:
    """Return the angle of attack of the EAV in straight flight at an airspeed."""
    flow = 0.5 * _AIR_KG_PER_M3 * max(airspeed_m_per_s, _SLOWEST_M_PER_S) ** 2
    return math.degrees((_MASS_KG * _G / (flow * _AREA_M2) - _LIFT_AT_ZERO) / _LIFT_PER_RAD)


def angle_deg(value_deg: float) -> float:
    """Bring an angle into the range -180..180 degrees by whole turns."""
    return math.remainder(value_deg, 360.0)


class _Loop(Module):
    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._integral = 0.0
        self._period_s = ctx.period_ns / NS_PER_S

    def mode_changed(self) -> bool:
        """Keep this object, with its integral, which holds the trim, when the mode changes; returns True."""
        return True

    def _learn(self, error: float, gain: float, limit: float) -> float:
        self._integral = held(self._integral + gain * error * self._period_s, limit)
        return self._integral


class VerticalSpeedControl(_Loop):
    """Computes the pitch command: the sum of the trimmed angle of attack, the commanded path angle and a correction.

    The correction is proportional and integral feedback of the error of the vertical speed.
    """

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the pitch command; without a measured airspeed, assume the reference airspeed."""
        command, up = number(inputs, "vertical_speed_command"), number(inputs, "velocity_up")
        if command is None or up is None:
            return {}
        airspeed = max(number(inputs, "airspeed") or REFERENCE_M_PER_S, _SLOWEST_M_PER_S)
        error = math.degrees((command - up) / airspeed)
        path = math.degrees(math.asin(held(command / airspeed, 0.3)))
        pitch = trim_alpha_deg(airspeed) + path + 0.6 * error + self._learn(error, 0.6, 6.0)
        return {"pitch_command": min(max(pitch, -15.0), 13.0)}


class PitchControl(_Loop):
    """Computes the elevator command from the pitch.

    Without a pitch command, the loop holds the pitch of level flight at reference speed.
    """

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the elevator command."""
        pitch, rate = number(inputs, "pitch_angle"), number(inputs, "pitch_rate") or 0.0
        if pitch is None:
            return {}
        command = number(inputs, "pitch_command")
        error = (trim_alpha_deg(REFERENCE_M_PER_S) if command is None else command) - pitch
        return {"elevator_demand": held(-(1.0 * error + self._learn(error, 1.0, 12.0) - 0.15 * rate), 25.0)}


class CourseControl(Module):
    """Computes the roll command from the error of the course over ground.

    The roll command is at most 8 degrees in the flare transition and the flare. In all other stages, and if the
    landing stage is not known, it is at most 25 degrees.
    """

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the roll command: at most 25 degrees, in the flare transition and the flare at most 8 degrees."""
        command = number(inputs, "course_command")
        north, east = number(inputs, "velocity_north"), number(inputs, "velocity_east")
        if command is None or north is None or east is None:
            return {}
        track = math.degrees(math.atan2(east, north))
        limit = 8.0 if (whole(inputs, "landing_stage") or 0) in NEAR_GROUND else 25.0
        return {"roll_command": held(1.3 * angle_deg(command - track), limit)}


class RollControl(Module):
    """Computes the aileron command from the commanded roll angle, the measured roll angle and the roll rate.

    Without a command, the loop holds the wings level.
    """

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the aileron command."""
        roll, rate = number(inputs, "roll_angle"), number(inputs, "roll_rate") or 0.0
        if roll is None:
            return {}
        return {"aileron_demand": held(0.9 * ((number(inputs, "roll_command") or 0.0) - roll) - 0.03 * rate, 20.0)}


class YawDamper(Module):
    """Computes the rudder command from the yaw rate, less the yaw rate of a coordinated turn at this bank."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the rudder command."""
        rate, roll = number(inputs, "yaw_rate"), number(inputs, "roll_angle")
        if rate is None:
            return {}
        turn = math.degrees(_G / REFERENCE_M_PER_S * math.sin(math.radians(roll or 0.0)))
        return {"rudder_demand": held(0.35 * (rate - turn), 25.0)}


class AirspeedControl(_Loop):
    """Computes the throttle command from the airspeed; an airspeed command of 0 closes the throttle.

    Without an airspeed command, the loop holds the reference airspeed.
    """

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the throttle command."""
        airspeed, command = number(inputs, "airspeed"), number(inputs, "airspeed_command")
        if command is not None and command <= 0.0:
            return {"throttle_demand": 0.0}
        if airspeed is None:
            return {}
        error = (REFERENCE_M_PER_S if command is None else command) - airspeed
        return {"throttle_demand": min(max(0.2 + 0.12 * error + self._learn(error, 0.04, 0.5), 0.0), 1.0)}


NEAR_GROUND = frozenset((3, 4))  # landing stages: flare transition and flare
