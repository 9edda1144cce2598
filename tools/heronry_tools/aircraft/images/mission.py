"""Finds the stage of the flight; when it changes, the manager enters the phase of the spec that belongs to it.

The stage only advances, and only after the inputs have indicated a later stage for several periods. Any input may be
missing. For example: with a pitot, an airspeed shows that the aircraft is released from the balloon; without a pitot,
an aircraft that is far below its highest point counts as released. Without any input the stage stays.

After a restart, the module begins with the first stage, and then takes the stage that the inputs indicate. A restart
loses the highest point, so without a pitot a released aircraft is recognized only after another long descent.
"""

from collections.abc import Mapping
from enum import IntEnum

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import number, whole

_DEPLOYMENT_M = 16_000.0
_LANDING_M = 1_500.0
_FLYING_M_PER_S = 10.0
_FALLEN_M = 300.0
_STEPS_TO_BELIEVE = 3


class Stage(IntEnum):
    """The stages of the flight, as published in `mission_stage`."""

    ASCENT = 0
    DEPLOYMENT = 1
    GLIDE = 2
    LANDING = 3


class MissionSequencer(Module):
    """Publishes `mission_stage`, from the inputs that are present: altitude, airspeed and wing state."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._stage = Stage.ASCENT
        self._highest_m: float | None = None
        self._signs = 0  # steps in a row with signs of a later stage

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the present stage of the flight."""
        altitude_m = number(inputs, "altitude")
        if altitude_m is not None:
            self._highest_m = max(altitude_m, self._highest_m or altitude_m)
        shown = self._shown(altitude_m, number(inputs, "indicated_airspeed"), whole(inputs, "wing_state"))
        self._signs = self._signs + 1 if shown > self._stage else 0
        if self._signs >= _STEPS_TO_BELIEVE:
            self._stage, self._signs = shown, 0
        return {"mission_stage": int(self._stage)}

    def _shown(self, altitude_m: float | None, airspeed: float | None, wing_state: int | None) -> Stage:
        if self._released(altitude_m, airspeed):
            return Stage.LANDING if altitude_m is not None and altitude_m < _LANDING_M else Stage.GLIDE
        high = altitude_m is not None and altitude_m >= _DEPLOYMENT_M
        return Stage.DEPLOYMENT if high or (wing_state or 0) > 0 else Stage.ASCENT

    def _released(self, altitude_m: float | None, airspeed: float | None) -> bool:
        if self._stage >= Stage.GLIDE:
            return True
        if airspeed is not None:
            return airspeed > _FLYING_M_PER_S
        if altitude_m is None or self._highest_m is None:
            return False
        return self._highest_m - altitude_m > _FALLEN_M
