"""Attitude in three versions: gyros corrected by accelerometers, gyros without accelerometers, horizon sensor.

*Gyros.* Gyros react at once, but drift. A complementary filter turns the angle by the rates of the gyros, and corrects
it slowly towards a reference:

    with accelerometers       the angle that they show. They show gravity on average, but are noisy
    without accelerometers    the best glide with level wings, since a glider flies in it most of the time

The reference without accelerometers does not bound the error, since a control loop holds the filtered angle and not the
true one. The true angle drifts with the bias of the gyros and, in a turn, with the correction towards level wings. So
the inner loop corrects the pitch by the airspeed (control.py), and the outer loop corrects the bank by the track
(guidance.py).

*Horizon sensor.* It does not drift, but is coarse.

*Signs.* They are those of CANaerospace: pitch nose up, roll right, forward and right accelerations are positive. When
the nose points up, gravity is measured as a forward acceleration. When the right wing is low, gravity is measured as an
acceleration to the left.

*Changes.* A change of the mode keeps the angles. After a restart, the filter starts from its reference. If the best
glide is a wrong start, the error decreases only slowly.
"""

import math
from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number, numbers
from heronry_tools.aircraft.images.control import BEST_GLIDE_PITCH_DEG

_NS_PER_S = 1_000_000_000
_GRAVITY_PULL_S = 2.0
_GLIDE_PULL_S = 25.0
_GLIDE_DEG = (BEST_GLIDE_PITCH_DEG, 0.0)
_HORIZON_LAG_S = 0.3
_HORIZON_COUNTS = 1000  # contrast at an angle of 90 degrees


class AttitudeFilter(Module):
    """Pitch and roll in degrees from body rates, in mode `fused` corrected by accelerations."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._period_s = ctx.period_ns / _NS_PER_S
        self._angles_deg: tuple[float, float] | None = None if ctx.mode == "fused" else _GLIDE_DEG

    def mode_changed(self) -> bool:
        """Keep the angles, since the aircraft may be in a turn; returns True, so that no new object is made."""
        self._period_s = self.ctx.period_ns / _NS_PER_S
        return True

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the attitude; publish nothing if a rate is missing.

        There are two exceptions, in which the first attitude needs no rates:

        - After a start in mode `fused`, the first attitude is the one that the accelerations show. Nothing is
            published before accelerations are present.
        - If the mode `fused` ends before the first attitude, the first attitude is that of the best glide.
        """
        rates = (number(inputs, "pitch_rate"), number(inputs, "roll_rate"))
        reference_deg = _gravity_deg(inputs) if self.ctx.mode == "fused" else _GLIDE_DEG
        pull_s = _GRAVITY_PULL_S if self.ctx.mode == "fused" else _GLIDE_PULL_S
        if self._angles_deg is None:
            self._angles_deg = reference_deg
        elif rates[0] is not None and rates[1] is not None:
            self._angles_deg = self._turned(self._angles_deg, (rates[0], rates[1]), reference_deg, pull_s)
        else:
            return {}
        if self._angles_deg is None:
            return {}
        return {"pitch_angle": self._angles_deg[0], "roll_angle": self._angles_deg[1]}

    def _turned(
        self,
        angles_deg: tuple[float, float],
        rates_deg_per_s: tuple[float, float],
        reference_deg: tuple[float, float] | None,
        pull_s: float,
    ) -> tuple[float, float]:
        pull = self._period_s / (pull_s + self._period_s)
        pitch, roll = (a + rate * self._period_s for a, rate in zip(angles_deg, rates_deg_per_s, strict=True))
        if reference_deg is None:
            return pitch, roll
        return pitch + pull * (reference_deg[0] - pitch), roll + pull * (reference_deg[1] - roll)


def _gravity_deg(inputs: Inputs) -> tuple[float, float] | None:
    """Return the pitch and roll in degrees that the accelerations show.

    None if the longitudinal or the lateral acceleration is missing.
    """
    forward_g, right_g = number(inputs, "longitudinal_acceleration"), number(inputs, "lateral_acceleration")
    if forward_g is None or right_g is None:
        return None
    pitch = math.asin(held(forward_g, 1.0))
    roll = -math.asin(held(right_g / max(math.cos(pitch), 0.1), 1.0))
    return math.degrees(pitch), math.degrees(roll)


class HorizonAttitude(Module):
    """Pitch and roll in degrees from the contrast between ground and sky."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        period_s = ctx.period_ns / _NS_PER_S
        self._weight = period_s / (_HORIZON_LAG_S + period_s)
        self._angles_deg: tuple[float, float] | None = None

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish a slightly smoothed attitude, since thermopiles are noisy.

        Nothing is published if the input `horizon_contrast` is missing.
        """
        contrast = numbers(inputs, "horizon_contrast", 2)
        if contrast is None:
            return {}
        seen = [math.degrees(math.asin(held(count / _HORIZON_COUNTS, 1.0))) for count in contrast]
        before = self._angles_deg or (seen[0], seen[1])
        self._angles_deg = (
            before[0] + self._weight * (seen[0] - before[0]),
            before[1] + self._weight * (seen[1] - before[1]),
        )
        return {"pitch_angle": self._angles_deg[0], "roll_angle": self._angles_deg[1]}
