"""The inflatable wings: the control inflates them, and the monitor watches them until their skin is hard.

The control decides when the valve is open. The monitor decides in which state the wings are. Each module reads the
output of the other module, so the spec gives `wing_state` an initial value. The control keeps the valve closed while
the monitor publishes that the wings are cured or leak. The pressure and the demand of the valve show the monitor
whether the wings are folded or being filled. A leak is a loss of pressure in wings that were firm.

A restart of the monitor loses the ultraviolet dose: the monitor publishes "firm" until it has measured the
dose again. So the valve is controlled longer than necessary, which does no harm. A restart also loses whether
the wings have been firm: a leak that is there already is not recognized.
"""

from collections.abc import Mapping
from enum import IntEnum

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import number, whole

_NS_PER_S = 1_000_000_000
_STOWED_HPA = 50.0
_FIRM_HPA = 430.0
_LEAKING_HPA = 250.0
_OPEN_BELOW_HPA, _SHUT_ABOVE_HPA = 470.0, 500.0
_LOWEST_INFLATION_M = 15_000.0
_ALTITUDE_LOST_NS = 60 * _NS_PER_S  # how long the altitude must be missing; a reconfiguration or a start takes less
# Shortened like the plant's flight; real resin needs minutes of sun at altitude.
_CURE_DOSE_J_PER_M2 = 600.0


class WingState(IntEnum):
    """The states of the wings, as published in `wing_state`."""

    STOWED = 0
    INFLATING = 1
    FIRM = 2
    CURED = 3
    LEAKING = 4


class InflationControl(Module):
    """Demands an open valve below 470 hPa in the wings, a closed one above 500 hPa; in between nothing changes.

    `valve_demand` is 1 for an open valve, 0 for a closed one. In some cases the valve is closed at any
    pressure (`step`).
    """

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._open = False
        self._altitude_heard_ns = ctx.now_ns

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the demand of the valve.

        The valve is closed in these cases, at any pressure:

        - The pressure is missing.
        - The wings are cured or leak.
        - The wings are folded, or their state is missing, and the altitude is below 15 000 m. If the altitude is
            missing, it counts as below 15 000 m until it has been missing for one minute, and then as above.
        """
        pressure_hpa = number(inputs, "wing_pressure")
        if pressure_hpa is None or self._refrains(inputs):
            self._open = False
        elif pressure_hpa < _OPEN_BELOW_HPA:
            self._open = True
        elif pressure_hpa > _SHUT_ABOVE_HPA:
            self._open = False
        return {"valve_demand": float(self._open)}

    def _refrains(self, inputs: Inputs) -> bool:
        state, altitude_m = whole(inputs, "wing_state"), number(inputs, "altitude")
        if state in {WingState.CURED, WingState.LEAKING}:
            return True
        # Folded wings stay folded near the ground. Without an altitude they stay folded for `_ALTITUDE_LOST_NS`.
        # Wings that have begun to fill are filled, at any altitude.
        if altitude_m is None:
            low = self.ctx.now_ns - self._altitude_heard_ns < _ALTITUDE_LOST_NS
        else:
            self._altitude_heard_ns = self.ctx.now_ns
            low = altitude_m < _LOWEST_INFLATION_M
        return low and (state is None or state == WingState.STOWED)


class WingMonitor(Module):
    """Publishes `wing_state`, from the pressure in the wings and the demand of the valve.

    In mode `cure` the state also follows from the dose of light: the light on firm wings, added up.
    """

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._dose_j_per_m2 = 0.0
        self._has_been_firm = False

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the state of the wings; publish nothing if the pressure is missing."""
        pressure_hpa = number(inputs, "wing_pressure")
        if pressure_hpa is None:
            return {}
        self._has_been_firm = self._has_been_firm or pressure_hpa >= _FIRM_HPA
        if self.ctx.mode == "cure" and pressure_hpa >= _FIRM_HPA:
            irradiance = number(inputs, "uv_irradiance") or 0.0
            self._dose_j_per_m2 += max(irradiance, 0.0) * self.ctx.period_ns / _NS_PER_S
        return {"wing_state": int(self._state(pressure_hpa, number(inputs, "valve_demand")))}

    def _state(self, pressure_hpa: float, valve: float | None) -> WingState:
        if self._dose_j_per_m2 >= _CURE_DOSE_J_PER_M2:
            return WingState.CURED
        if self._has_been_firm and pressure_hpa < _LEAKING_HPA:
            return WingState.LEAKING
        if pressure_hpa >= _FIRM_HPA:
            return WingState.FIRM
        filling = valve is not None and valve > 0.0
        return WingState.INFLATING if filling or pressure_hpa >= _STOWED_HPA else WingState.STOWED
