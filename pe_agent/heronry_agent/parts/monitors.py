"""Monitors: modules that detect a stuck sensor, and an actuator that does not follow its command.

    StuckSensorMonitor  reports a sensor that has given exactly the same value for `patience_ns`. It suits only a sensor
                        whose last digit always changes (noise, a moving quantity)
    ActuatorMonitor     computes the position of a healthy actuator, which follows its command with the lag `lag_s`. It
                        reports an actuator that is further than `tolerance` from this position for `patience_ns`. An
                        actuator that is stuck at its command is not detected. A wrong position sensor looks like a
                        failed actuator; where there is a second actuator, the image `servo_monitor` of the shipped
                        aircraft can tell whether the sensor or the actuator has failed

Both monitors give the health of the element as an output: 0 healthy, 1 reported as failed. Once the health is 1, it
stays 1 until the monitor is started anew. While an input is missing the monitors do not compare.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting
from heronry_agent.parts.reading import number

_NS_PER_S = 1_000_000_000


class Monitor(Module):
    """Base class of the two monitors, not to be used directly."""

    element: ClassVar[str]  # the element to report failed
    output: ClassVar[str]
    patience_ns: ClassVar[int] = 1_000_000_000

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._wrong = Lasting(self.patience_ns, ctx.period_ns)
        self._health = 0

    def is_wrong(self, inputs: Inputs) -> bool:
        """Tell whether the inputs of this step show a fault of `element`; each subclass implements this."""
        raise NotImplementedError

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Report the element if `is_wrong` has been True for `patience_ns`.

        Returns the health of the element as the value of `output`: 0 healthy, 1 reported as failed.
        """
        if self._wrong.is_due(self.is_wrong(inputs)):
            self._health = 1
            self.ctx.report_failed(self.element)
        return {self.output: self._health}


class StuckSensorMonitor(Monitor):
    """Reports a sensor whose value does not change.

    A subclass sets the attributes `element`, `output` and `source`, and may set `patience_ns`.
    """

    source: ClassVar[str]
    _last: float | None = None

    def is_wrong(self, inputs: Inputs) -> bool:
        """Tell whether the value equals the previous one."""
        value = number(inputs, self.source)
        before, self._last = self._last, value
        return value is not None and value == before


class ActuatorMonitor(Monitor):
    """Reports an actuator whose position does not follow its command.

    A subclass sets the attributes `element`, `output`, `command`, `position`, `tolerance` and `lag_s`, and may
    set `patience_ns`.
    """

    command: ClassVar[str]
    position: ClassVar[str]
    tolerance: ClassVar[float]
    lag_s: ClassVar[float]
    _expected: float | None = None

    def is_wrong(self, inputs: Inputs) -> bool:
        """Tell whether the position differs by more than `tolerance` from the one computed for a healthy actuator.

        False if the command or the position is missing.
        """
        command, position = number(inputs, self.command), number(inputs, self.position)
        if command is None or position is None:
            self._expected = None
            return False
        period_s = self.ctx.period_ns / _NS_PER_S
        expected = position if self._expected is None else self._expected
        self._expected = expected + (command - expected) * period_s / (self.lag_s + period_s)
        return abs(position - self._expected) > self.tolerance
