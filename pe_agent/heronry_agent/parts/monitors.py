"""Monitors: a sensor that is stuck, an actuator that does not follow its command.

    StuckSensorMonitor  a sensor whose last digit always changes (noise, a moving quantity) has given exactly the same
                        value for `patience_ns`. It is the wrong part for a sensor that may rest
    ActuatorMonitor     the position is further than `tolerance` from where a healthy actuator would be, which follows
                        its command with the lag `lag_s`, for `patience_ns`. It cannot detect an actuator that
                        is stuck at its command. A wrong position sensor looks the same as a failed actuator; with a
                        second actuator `images.servo_monitor` tells them apart

Both give a health: 0 well, 1 reported as failed. A missing datum suspends the comparison.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting
from heronry_agent.parts.reading import number

_NS_PER_S = 1_000_000_000


class Monitor(Module):
    """Base of the two monitors; a subclass of one of them sets the attributes."""

    element: ClassVar[str]  # to report when the fault has lasted
    output: ClassVar[str]
    patience_ns: ClassVar[int] = 1_000_000_000

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._wrong = Lasting(self.patience_ns, ctx.period_ns)
        self._health = 0

    def is_wrong(self, inputs: Inputs) -> bool:
        """Tell whether the inputs of this step look like a fault."""
        raise NotImplementedError

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Compare, report a fault that has lasted, and give the health."""
        if self._wrong.is_due(self.is_wrong(inputs)):
            self._health = 1
            self.ctx.report_failed(self.element)
        return {self.output: self._health}


class StuckSensorMonitor(Monitor):
    """Monitors one sensor for a value that does not change."""

    source: ClassVar[str]
    _last: float | None = None

    def is_wrong(self, inputs: Inputs) -> bool:
        """Compare the value with the previous one."""
        value = number(inputs, self.source)
        before, self._last = self._last, value
        return value is not None and value == before


class ActuatorMonitor(Monitor):
    """Monitors one actuator by its position sensor."""

    command: ClassVar[str]
    position: ClassVar[str]
    tolerance: ClassVar[float]
    lag_s: ClassVar[float]
    _expected: float | None = None

    def is_wrong(self, inputs: Inputs) -> bool:
        """Compare the position with that of a healthy actuator."""
        command, position = number(inputs, self.command), number(inputs, self.position)
        if command is None or position is None:
            self._expected = None
            return False
        period_s = self.ctx.period_ns / _NS_PER_S
        expected = position if self._expected is None else self._expected
        self._expected = expected + (command - expected) * period_s / (self.lag_s + period_s)
        return abs(position - self._expected) > self.tolerance
