"""A plant that a disturbance pushes away, the integrating controller that holds it, and a module that counts.

Data close the loop of plant and controller.
"""

import math
from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number
from heronry_wire.checkpoint_frames import crc_24

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


class Count(Module):
    """Counts its steps; its state names the module and the version of its code, and says the count five times.

    No two states are equal, neither of two modules nor of one. If a module starts from what no such module has saved,
    it accuses a healthy module, which the oracle `blame` finds.
    """

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._count, self._is_wrong = 0, False
        self._mark = float(crc_24(f"{ctx.module} {type(self).__qualname__}".encode()))

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 - it needs none
        """Return the count."""
        self._count += 1
        if self._is_wrong:
            self.ctx.report_failed("module:plant")
        return {f"{self.ctx.module}_steps": self._count}

    def save(self) -> tuple[float, ...]:
        """Return the mark and the count, in several forms that fill several frames."""
        return tuple(map(float, (self._mark, self._count, -self._count, 3 * self._count, self._count / 2, self._count)))

    def restore(self, state: tuple[float, ...], age_ns: int) -> None:  # noqa: ARG002 - the oracle judges the age
        """Go on from a count."""
        self._count = int(state[1])
        self._is_wrong = state != self.save()
