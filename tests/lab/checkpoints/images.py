"""A plant that a disturbance pushes away, and the integrating controller that holds it; data close their loop."""

import math
from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number

RANGE = 25.0  # the command is from -RANGE to RANGE
_LAG_S, _DISTURBANCE, _SWING, _SWING_S = 2.0, 8.0, 3.0, 20.0
_GAIN, _GAIN_PER_S = 2.0, 2.0


class Plant(Module):
    """A first-order plant; without a command it keeps the last one."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._deviation, self._command, self._begun_ns = 0.0, 0.0, ctx.now_ns

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Return the deviation after one period."""
        self._command = number(inputs, "command") or self._command
        period_s, at_s = self.ctx.period_ns / 1e9, (self.ctx.now_ns - self._begun_ns) / 1e9
        disturbance = _DISTURBANCE + _SWING * math.sin(2 * math.pi * at_s / _SWING_S)
        self._deviation += (self._command + disturbance - self._deviation) * period_s / _LAG_S
        return {"deviation": self._deviation}


class Controller(Module):
    """A proportional and integrating controller."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._sum = 0.0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Return the command for a deviation; none while that is absent."""
        deviation = number(inputs, "deviation")
        if deviation is None:
            return {}
        self._sum = held(self._sum - _GAIN_PER_S * deviation * self.ctx.period_ns / 1e9, RANGE)
        return {"command": held(self._sum - _GAIN * deviation, RANGE)}

    def save(self) -> tuple[float, ...]:
        """Return the integral."""
        return (self._sum,)

    def restore(self, state: tuple[float, ...], age_ns: int) -> None:  # noqa: ARG002 - an old integral is the best known
        """Go on from an integral."""
        (self._sum,) = state
