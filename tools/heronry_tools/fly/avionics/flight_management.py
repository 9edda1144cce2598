"""The flight management system: the stages of a landing.

They follow Figures 11 and 12 of the paper by Ippolito et al. (docs/flights.md):

    approach ──► glide slope ──► flare transition ──► flare ──► (on the ground)
        approach, glide slope ──► go-around (climb straight ahead, then level)

- *approach*: level flight, until the estimated landing point reaches the desired one.
- *glide slope*: a descent of 5 degrees. It is made steeper or shallower, within 0 to 10 degrees, to bring the
  estimated landing point to the desired one.
- *flare transition*, below `TRANSITION_M`: the sink rate changes steadily to that of the flare.
- *flare*, below `FLARE_M`: throttle closed, a constant sink rate.

The plan selects the mode of the module by the quality of the position that the plan can supply. The mode decides:

- *precise*: the position is good enough to land.
- *forced*: the position is not good enough, but the aircraft must land, so it uses this position.
- *waiting*: the position is not good enough. On approach the aircraft stays level until the position is good enough. On
  the glide slope the aircraft goes around; below `DECISION_M` it lands as in the other modes. In this mode alone a
  flare also becomes a go-around, if the estimated height rises to `DECISION_M` again.

In every mode the aircraft goes around if the estimated landing point is too far along the runway (`_LONGEST_M`). The
landing point is checked at two times: on approach, and on the glide slope below `DECISION_M`.

No input tells the module from which sensor its position comes. A restart loses the stage. The restarted module finds
its stage again from height and position. If it starts below `DECISION_M`, it lands, except if the landing point is too
far.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number

REFERENCE_M_PER_S = 17.0
TRANSITION_M = 5.0
FLARE_M = 1.4
DECISION_M = 20.0
CIRCUIT_M = 60.0
_AIM_M = -40.0
_NOMINAL_DEG, _LEAST_DEG, _MOST_DEG = 5.0, 0.0, 10.0
_DEG_PER_M = 0.15
_FLARE_M_PER_S = -0.5
_CLIMB_M_PER_S = 2.0
_RAD_PER_M = 0.016  # course by distance from the centre line
_COURSE_LIMIT_DEG = 20.0
_FLIES_M_PER_S = 5.0  # below this ground speed the aircraft does not fly: no headwind is computed
_LONGEST_M = 110.0  # x of the landing point beyond which the aircraft goes around, on approach or below `DECISION_M`


class Stage(IntEnum):
    """A stage of the landing, with the number that the flight management publishes as `landing_stage`."""

    START = 0
    APPROACH = 1
    GLIDE_SLOPE = 2
    TRANSITION = 3
    FLARE = 4
    GO_AROUND = 5


_LEVEL = (Stage.START, Stage.APPROACH)


@dataclass(frozen=True, slots=True)
class Situation:
    """The inputs of the flight management in one step.

    x_m, y_m, height_m: position in the runway's frame
    ground_speed_m_per_s: speed over ground
    headwind_m_per_s: headwind; 0 if it is not known
    """

    x_m: float
    y_m: float
    height_m: float
    ground_speed_m_per_s: float
    headwind_m_per_s: float


@dataclass(frozen=True, slots=True)
class Commands:
    """Commands of the flight management to the control loops; an airspeed of 0 closes the throttle."""

    vertical_speed_m_per_s: float
    course_deg: float
    airspeed_m_per_s: float


class FlightManagement:
    """The sequence of stages of a landing, without the inputs and outputs of a module.

    The caller calls `step` once per period.
    """

    def __init__(self) -> None:
        self.stage = Stage.START

    def step(self, now: Situation, *, mode: str) -> Commands:
        """Go to the next stage if it is due, and return the commands for this step."""
        self.stage = self._next(now, mode)
        course = held(-math.degrees(_RAD_PER_M * now.y_m), _COURSE_LIMIT_DEG)
        airspeed = REFERENCE_M_PER_S + 0.5 * min(max(now.headwind_m_per_s, 0.0), 8.0)
        return Commands(self._vertical_speed(now), course, 0.0 if self.stage is Stage.FLARE else airspeed)

    def _next(self, now: Situation, mode: str) -> Stage:
        stage = self.stage
        if stage is Stage.GO_AROUND or self._is_too_long(now):
            return Stage.GO_AROUND
        if mode == "waiting" and now.height_m >= DECISION_M:
            return Stage.APPROACH if stage in _LEVEL else Stage.GO_AROUND
        if stage is Stage.FLARE or now.height_m <= FLARE_M:
            return Stage.FLARE
        if stage is Stage.TRANSITION or now.height_m <= TRANSITION_M:
            return Stage.TRANSITION
        if stage is Stage.GLIDE_SLOPE or _landing_point_m(now) >= _AIM_M:
            return Stage.GLIDE_SLOPE
        return Stage.APPROACH

    def _is_too_long(self, now: Situation) -> bool:
        is_late = self.stage in _LEVEL or (self.stage is Stage.GLIDE_SLOPE and now.height_m < DECISION_M)
        return is_late and _landing_point_m(now) > _LONGEST_M

    def _vertical_speed(self, now: Situation) -> float:
        match self.stage:
            case Stage.GO_AROUND:
                return _CLIMB_M_PER_S if now.height_m < CIRCUIT_M else 0.0
            case Stage.GLIDE_SLOPE:
                return _on_slope(now)
            case Stage.TRANSITION:
                share = min(max((now.height_m - FLARE_M) / (TRANSITION_M - FLARE_M), 0.0), 1.0)
                return share * min(_on_slope(now), _FLARE_M_PER_S) + (1.0 - share) * _FLARE_M_PER_S
            case Stage.FLARE:
                return _FLARE_M_PER_S
            case _:
                return 0.0


def _landing_point_m(now: Situation) -> float:
    """Return where a descent from the present position, on the nominal slope, meets the runway: x in m."""
    return now.x_m + now.height_m / math.tan(math.radians(_NOMINAL_DEG))


def _on_slope(now: Situation) -> float:
    slope = _NOMINAL_DEG + _DEG_PER_M * (_landing_point_m(now) - _AIM_M)
    return -now.ground_speed_m_per_s * math.tan(math.radians(min(max(slope, _LEAST_DEG), _MOST_DEG)))


class FlightManagementSystem(Module):
    """The flight management system as a module."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self.management = FlightManagement()
        self.known: Situation | None = None  # in the last step; None if position or velocity was missing
        self._mode = ctx.mode

    def mode_changed(self) -> bool:
        """Keep the stage of the landing when the mode changes; returns True, so that this object goes on."""
        self._mode = self.ctx.mode
        return True

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the commands; publish nothing if a coordinate of the position or of the velocity is missing.

        If nothing is published, the control loops use the last commands, until these are too old.
        """
        x, y, height = (number(inputs, name) for name in ("position_x", "position_y", "height"))
        north, east = number(inputs, "velocity_north"), number(inputs, "velocity_east")
        self.known = None
        if x is None or y is None or height is None or north is None or east is None:
            return {}
        ground_speed = math.hypot(north, east)
        airspeed = number(inputs, "airspeed")
        headwind = 0.0 if airspeed is None or ground_speed < _FLIES_M_PER_S else airspeed - ground_speed
        self.known = Situation(x, y, height, ground_speed, headwind)
        commands = self.management.step(self.known, mode=self._mode)
        return {
            "vertical_speed_command": commands.vertical_speed_m_per_s,
            "course_command": commands.course_deg,
            "airspeed_command": commands.airspeed_m_per_s,
            "landing_stage": int(self.management.stage),
        }
