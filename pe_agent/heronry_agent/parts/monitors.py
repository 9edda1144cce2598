"""Monitors: a sensor that is stuck, an actuator that does not do what it is told.

    StuckSensorMonitor  a sensor whose last digit never rests (noise, a moving quantity) has said exactly the same for
                        `patience_ns`. For one that may rest it is the wrong part
    ActuatorMonitor     the position is further than `tolerance` from where a healthy actuator would be, which follows
                        its command with the lag `lag_s`, for `patience_ns`. What it cannot see: an actuator that is
                        stuck where it is told to be. One sensor that lies looks the same; who has a second actuator
                        and wants to tell them apart finds `images.servo_monitor`

Both give a health: 0 well, 1 accused. A missing datum suspends the judgement.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting
from heronry_agent.parts.reading import number

_NS_PER_S = 1_000_000_000


class Monitor(Module):
    """What the two have in common; a subclass of theirs sets the attributes."""

    element: ClassVar[str]  # that is to blame
    output: ClassVar[str]
    patience_ns: ClassVar[int] = 1_000_000_000

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._wrong = Lasting(self.patience_ns, ctx.period_ns)
        self._health = 0

    def is_wrong(self, inputs: Inputs) -> bool:
        """Tell whether this step looks like a fault."""
        raise NotImplementedError

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Look, and give the health."""
        if self._wrong.is_due(self.is_wrong(inputs)):
            self._health = 1
            self.ctx.report_failed(self.element)
        return {self.output: self._health}


class StuckSensorMonitor(Monitor):
    """Watches one sensor."""

    source: ClassVar[str]
    _last: float | None = None

    def is_wrong(self, inputs: Inputs) -> bool:
        """Compare with the value before."""
        value = number(inputs, self.source)
        before, self._last = self._last, value
        return value is not None and value == before


class ActuatorMonitor(Monitor):
    """Watches one actuator by the sensor of its position."""

    command: ClassVar[str]
    position: ClassVar[str]
    tolerance: ClassVar[float]
    lag_s: ClassVar[float]
    _expected: float | None = None

    def is_wrong(self, inputs: Inputs) -> bool:
        """Compare with where a healthy one would be."""
        command, position = number(inputs, self.command), number(inputs, self.position)
        if command is None or position is None:
            self._expected = None
            return False
        period_s = self.ctx.period_ns / _NS_PER_S
        expected = position if self._expected is None else self._expected
        self._expected = expected + (command - expected) * period_s / (self.lag_s + period_s)
        return abs(position - self._expected) > self.tolerance
