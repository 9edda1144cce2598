"""Air data: a voter that computes one static pressure from three, and the airspeed.

The voter publishes the middle of three pressures, so one wrong sensor never determines the output. Of two pressures
that differ, the voter publishes the one that is nearer to its last output.

The voter reports a sensor whose pressure has differed from the middle for a second without a break. In detail:

- The report is repeated each second, since the operator may have cleared the fault.
- Nothing is reported while a pressure is missing. If the other two differ, either may be wrong.
- Nothing is reported in the first second after a start, since some data may be old.

The number in a variable's name shows the sensor: `pressure_2` is measured by `device:pressure_sensor_2`.

After a restart the voter has no last output, and a sensor must differ for a whole second again.
"""

import statistics
from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting, steps_of
from heronry_agent.parts.reading import number
from heronry_tools.aircraft.images import atmosphere

_CHANNELS = ("1", "2", "3")
_PATIENCE_NS = 1_000_000_000
# In a fast climb near the ground, healthy sensors that are sampled up to a period apart differ by some hPa. So a part
# of the tolerance is a share of the pressure.
_TOLERANCE_HPA = 2.0
_TOLERANCE_SHARE = 0.02
_DETAIL_PER_HPA = 10
_DETAIL_MAX = 0xFFFF


class PressureVoter(Module):
    """Mid-value voter over three static pressures in hPa; mode `single` passes on the only pressure."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._steps = 0
        self._odd = {channel: Lasting(_PATIENCE_NS, ctx.period_ns) for channel in _CHANNELS}
        self._last_hpa: float | None = None
        self._patience = steps_of(_PATIENCE_NS, ctx.period_ns)

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the voted pressure; nothing if there is no pressure."""
        self._steps += 1
        heard = {c: p for c in _CHANNELS if (p := number(inputs, f"pressure_{c}")) is not None}
        if not heard:
            return {}
        voted_hpa = self._voted(list(heard.values()))
        self._assess(heard, voted_hpa)
        self._last_hpa = voted_hpa
        return {"static_pressure": voted_hpa}

    def _voted(self, heard: list[float]) -> float:
        if len(heard) != 2 or self._last_hpa is None or not _differ(heard[0], heard[1]):
            return statistics.median(heard)
        last_hpa = self._last_hpa
        return min(heard, key=lambda pressure: abs(pressure - last_hpa))

    def _assess(self, heard: Mapping[str, float], voted_hpa: float) -> None:
        complete = len(heard) == len(_CHANNELS) and self._steps > self._patience
        for channel in _CHANNELS:
            odd = complete and _differ(heard[channel], voted_hpa)
            if self._odd[channel].is_due(odd):
                detail = min(round(_DETAIL_PER_HPA * abs(heard[channel] - voted_hpa)), _DETAIL_MAX)
                self.ctx.report_failed(f"device:pressure_sensor_{channel}", detail)


def _differ(one_hpa: float, other_hpa: float) -> bool:
    return abs(one_hpa - other_hpa) > _TOLERANCE_HPA + _TOLERANCE_SHARE * abs(other_hpa)


class AirData(Module):
    """Indicated airspeed from the pitot.

    In mode `compensated` also true airspeed, from the density at the static pressure.
    """

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the airspeeds in m/s.

        Nothing is published without the pitot's pressure, and no true airspeed without the static pressure.
        """
        differential = number(inputs, "differential_pressure")
        if differential is None:
            return {}
        indicated = atmosphere.indicated_airspeed_m_per_s(differential)
        static = number(inputs, "static_pressure")
        if self.ctx.mode != "compensated" or static is None or static <= 0.0:
            return {"indicated_airspeed": indicated}
        ratio = atmosphere.SEA_LEVEL_DENSITY_KG_PER_M3 / atmosphere.density_kg_per_m3(static)
        return {"indicated_airspeed": indicated, "true_airspeed": indicated * ratio**0.5}
