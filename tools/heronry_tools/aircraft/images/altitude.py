"""Altitude in three versions: GPS and pressure fused, GPS alone, pressure alone.

The versions are those of Figure 3 of the paper by Rawashdeh et al. (the spec `elevator_and_chute`).

*Fusion.* Pressure altitude has little noise and no delay, but an offset that changes slowly: the error of the sensor
plus the difference between the air of the day and the standard atmosphere. GPS height is right on average, but noisy.
So a slow low-pass filter learns the offset between the two, and the offset is added to the pressure altitude. The
result has neither the noise of the GPS nor the offset of the barometer.

GPS alone is filtered together with its rate (an alpha-beta filter), because a plain average lags behind in a climb.

A restart loses the offset (fused) or the rate (GPS alone), which are then learned again.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import number
from heronry_tools.aircraft.images import atmosphere

_NS_PER_S = 1_000_000_000
_OFFSET_LAG_S = 5.0
_ALPHA, _BETA = 0.4, 0.1  # weight of a new fix in height and in rate: critically damped, or nearly


class FusedAltitude(Module):
    """Altitude in m from GPS height and static pressure (`fused`, `both`), or from one of them (see `step`)."""

    pressure: ClassVar[str] = "absolute_pressure"

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._period_s = ctx.period_ns / _NS_PER_S
        self._offset_m: float | None = None
        self._height_m: float | None = None
        self._rate_m_per_s = 0.0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish an altitude.

        Mode `gps_only` uses the GPS height alone. Every other mode needs a pressure, and corrects the altitude by the
        last offset between the two heights. Before the first step with both, `pressure_only` takes the offset as 0, and
        the other modes publish nothing.
        """
        gps_m = number(inputs, "gps_altitude")
        if self.ctx.mode == "gps_only":
            return {} if gps_m is None else {"altitude": self._tracked(gps_m)}
        static_hpa = number(inputs, self.pressure)
        if static_hpa is None:
            return {}
        barometric_m = atmosphere.altitude_m(static_hpa)
        if gps_m is not None:
            self._learn_offset(gps_m - barometric_m)
        if self._offset_m is None and self.ctx.mode == "pressure_only":
            return {"altitude": barometric_m}
        return {} if self._offset_m is None else {"altitude": barometric_m + self._offset_m}

    def _learn_offset(self, seen_m: float) -> None:
        if self._offset_m is None:
            self._offset_m = seen_m
        self._offset_m += (seen_m - self._offset_m) * self._period_s / (_OFFSET_LAG_S + self._period_s)

    def _tracked(self, gps_m: float) -> float:
        if self._height_m is None:
            self._height_m = gps_m
        expected_m = self._height_m + self._rate_m_per_s * self._period_s
        surprise_m = gps_m - expected_m
        self._height_m = expected_m + _ALPHA * surprise_m
        self._rate_m_per_s += _BETA * surprise_m / self._period_s
        return self._height_m


class FusedStaticAltitude(FusedAltitude):
    """A `FusedAltitude` that reads the voted pressure."""

    pressure = "static_pressure"


class PressureAltitude(Module):
    """Altitude in m from static pressure alone, by the standard atmosphere."""

    pressure: ClassVar[str] = "absolute_pressure"

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the altitude; nothing without a pressure."""
        static_hpa = number(inputs, self.pressure)
        return {} if static_hpa is None else {"altitude": atmosphere.altitude_m(static_hpa)}


class StaticPressureAltitude(PressureAltitude):
    """A `PressureAltitude` that reads the voted pressure."""

    pressure = "static_pressure"
