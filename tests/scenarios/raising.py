"""Modules of a user that fail in flight."""

from heronry_agent.module import Context, Inputs, Module, Value


class RaisesAfterHalfASecond(Module):
    """Estimates nothing, twenty times at 40 Hz, and then raises."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._steps = 0

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it looks at nothing
        self._steps += 1
        if self._steps > 20:
            raise ZeroDivisionError("a division by zero, in flight")
        return {"state_info": 0.0}


class RestsForThreeSeconds(Module):
    """Drives its actuator at 40 Hz, but for three seconds after the first half."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._steps = 0

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it looks at nothing
        self._steps += 1
        if not 20 < self._steps <= 140:
            self.ctx.write(0.0)
        return {}
