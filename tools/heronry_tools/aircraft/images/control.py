"""The inner loops: from the attitude and a commanded attitude to the angle of a surface.

Signs are CANaerospace's. An elevator that goes down (positive) lowers the nose, so a nose that is too high needs a
positive deflection. A rudder that swings clockwise (positive) yaws the aircraft to the right. The dihedral of the wings
then makes the aircraft roll to the right; so the inflatable wing needs no ailerons.

A loop publishes the demanded angle of its surface, limited to the range of the surface. A commanded attitude is limited
to a safe range, whatever its source. Without a command, the loops fly the best glide with level wings. Without a
measured attitude a loop publishes nothing, and the servo stays where it is.

If the pitch is measured by gyros alone (version 2), its error grows without limit. The loop holds the measured pitch,
so the true pitch drifts away. If the true pitch is too low, the glide is too fast. So in mode `scheduled` the pitch
loop learns the error from the airspeed.

A restart loses the integral: the surface then moves by at most the trim that was learned. A restart also loses the
learned error of the pitch.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number

NS_PER_S = 1_000_000_000

BEST_GLIDE_PITCH_DEG = -4.0
BEST_GLIDE_M_PER_S = 18.0
_LEAST_FLOW_M_PER_S = 8.0
GYROS_ALONE = 2  # version of an attitude that drifts
_FASTER_M_PER_S_PER_DEG = 0.9  # how much faster the glide is with the nose one degree lower
_DRIFT_DEG_PER_M = 0.07  # gives a well damped loop: the airspeed follows the pitch within 7 s
_DRIFT_LIMIT_DEG = 40.0
_PITCH_LIMIT_DEG = 15.0
_ROLL_LIMIT_DEG = 30.0
_ELEVATOR_LIMIT_DEG = 20.0
_RUDDER_LIMIT_DEG = 20.0


@dataclass(slots=True)
class Pid:
    """Proportional, integral and rate feedback. The gains are in deg per deg, 1/s and s.

    The integral is for trim, and adds at most `trim_deg` to the output. So if the loop cannot move the aircraft, for
    example because of a jammed surface, the integral does not drive the output to its limit.
    """

    proportional: float
    integral: float
    damping: float
    limit_deg: float
    trim_deg: float = 5.0
    _sum_deg_s: float = field(default=0.0, init=False)

    def learn_trim(self, error_deg: float, period_s: float) -> None:
        """Add one period's error to the integral."""
        self._sum_deg_s = held(self._sum_deg_s + error_deg * period_s, self.trim_deg / self.integral)

    def output_deg(self, error_deg: float, rate_deg_per_s: float, gain: float = 1.0) -> float:
        """Return the angle of the surface in degrees, within +-`limit_deg`.

        error_deg: demanded minus present attitude.
        rate_deg_per_s: present rate of the attitude.
        gain: a factor for the proportional and the rate part, but not for the integral part.
        """
        quick = gain * (self.proportional * error_deg - self.damping * rate_deg_per_s)
        return held(quick + self.integral * self._sum_deg_s, self.limit_deg)


class PitchControl(Module):
    """Controls the pitch by the elevator; in mode `scheduled` the gain is smaller at a higher airspeed.

    The effect of a surface grows with the square of the airspeed. While the aircraft hangs below its balloon, there is
    no airflow, so a surface has no effect and no trim is learned.
    """

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._pid = Pid(proportional=1.2, integral=0.3, damping=0.2, limit_deg=_ELEVATOR_LIMIT_DEG)
        self._drift_deg = 0.0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the demanded angle of the elevator, in degrees; publish nothing without a pitch angle."""
        pitch_deg = number(inputs, "pitch_angle")
        if pitch_deg is None:
            return {}
        command_deg = number(inputs, "pitch_command")
        wanted_deg = BEST_GLIDE_PITCH_DEG if command_deg is None else held(command_deg, _PITCH_LIMIT_DEG)
        speed = number(inputs, "indicated_airspeed") if self.ctx.mode == "scheduled" else None
        if inputs["pitch_angle"].version == GYROS_ALONE:
            self._learn_drift(wanted_deg, speed)
            pitch_deg -= self._drift_deg
        else:
            self._drift_deg = 0.0
        if speed is None or speed >= _LEAST_FLOW_M_PER_S:
            self._pid.learn_trim(wanted_deg - pitch_deg, self.ctx.period_ns / NS_PER_S)
        rate = number(inputs, "pitch_rate") or 0.0
        return {"elevator_demand": -self._pid.output_deg(wanted_deg - pitch_deg, rate, _gain(speed))}

    def _learn_drift(self, wanted_deg: float, speed_m_per_s: float | None) -> None:
        """Learn by how much the measured pitch is too high.

        Nothing is learned if the airspeed is unknown, if there is too little airflow (the aircraft hangs below its
        balloon), or if the wanted pitch is nose up, as in the flare.

        wanted_deg: the wanted pitch, nose up positive.
        speed_m_per_s: the airspeed; None: it is not known.
        """
        if speed_m_per_s is None or speed_m_per_s < _LEAST_FLOW_M_PER_S or wanted_deg > 0.0:
            return
        expected = BEST_GLIDE_M_PER_S + _FASTER_M_PER_S_PER_DEG * (BEST_GLIDE_PITCH_DEG - wanted_deg)
        learned = _DRIFT_DEG_PER_M * (speed_m_per_s - expected) * self.ctx.period_ns / NS_PER_S
        self._drift_deg = held(self._drift_deg + learned, _DRIFT_LIMIT_DEG)


def _gain(speed_m_per_s: float | None) -> float:
    """Return the factor by which the gain differs from the gain at the best glide.

    The factor is 1 if the airspeed is unknown (None) or below `_LEAST_FLOW_M_PER_S`.
    """
    if speed_m_per_s is None or speed_m_per_s < _LEAST_FLOW_M_PER_S:
        return 1.0
    return min(max((BEST_GLIDE_M_PER_S / speed_m_per_s) ** 2, 0.4), 1.5)


class RollControl(Module):
    """Controls the roll angle with the rudder; in mode `damped` the module also gets the roll rate, to damp it."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._pid = Pid(proportional=0.8, integral=0.05, damping=0.3, limit_deg=_RUDDER_LIMIT_DEG)

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the demanded angle of the rudder, in degrees; publish nothing without a roll angle."""
        roll_deg = number(inputs, "roll_angle")
        if roll_deg is None:
            return {}
        command_deg = number(inputs, "roll_command")
        wanted_deg = 0.0 if command_deg is None else held(command_deg, _ROLL_LIMIT_DEG)
        self._pid.learn_trim(wanted_deg - roll_deg, self.ctx.period_ns / NS_PER_S)
        return {"rudder_demand": self._pid.output_deg(wanted_deg - roll_deg, number(inputs, "roll_rate") or 0.0)}


class StateEstimator(Module):
    """A stand-in for the state estimation of `elevator_and_chute`.

    The paper by Rawashdeh et al. shows no source of `state_info` (Figure 3). `state_info` is the error of the pitch in
    degrees; a nose that is too high is positive. This stand-in lets the error swing slowly, as a function of time.
    """

    amplitude_deg = 6.0
    swing_s = 8.0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 (it has none)
        """Publish `state_info` for the present time."""
        phase = self.ctx.now_ns % round(self.swing_s * NS_PER_S) / (self.swing_s * NS_PER_S)
        return {"state_info": self.amplitude_deg * math.sin(math.tau * phase)}


class ElevatorControl(Module):
    """Controls the elevator of `elevator_and_chute` by `state_info`, the error of the pitch in degrees."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._pid = Pid(proportional=1.8, integral=0.1, damping=0.0, limit_deg=_ELEVATOR_LIMIT_DEG)

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the elevator's demand in degrees; nothing without `state_info`."""
        too_high_deg = number(inputs, "state_info")
        if too_high_deg is None:
            return {}
        self._pid.learn_trim(too_high_deg, self.ctx.period_ns / NS_PER_S)
        return {"elevator_demand": self._pid.output_deg(too_high_deg, 0.0)}
