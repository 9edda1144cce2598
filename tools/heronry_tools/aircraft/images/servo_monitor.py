"""The servo monitors: they compare a surface's command with its position, and name the device at fault.

What they decide: which device has failed. The surface is expected where a healthy servo would have brought it (the
command through a short lag). A difference beyond the tolerance that lasts for the delay, and for several looks at it,
is a failure; then the manager is given time to put the other servo to work.

Which device is at fault. In `big_blue` each servo driver publishes what it commands, in a version of its own, so the
version of the datum shows which servo is at work. The paper's Figure 3 gives its monitor no such echo. There the
monitor assumes what the graph says: the first branch of the DEMUX works first, and the second one after the first has
been reported. That is wrong when the first servo is out of use for another reason, and harmless then: the report names
a device that is already down. Nor does this monitor know whether the servo is driven at all. A surface stands still as
well while its driver is silent, or holds back on another PE, until that is noticed and another one drives; so this
monitor waits for longer than a reconfiguration takes before it reports a servo.

The second servo is reported only if the surface has followed its commands for a while since the first one was: two
servos hardly fail within a short time, and a single stuck potentiometer makes both look wrong. Reporting both would
leave the aircraft without an elevator because of a sensor, so then the sensor is reported. A device that was reported
and is still in use is reported again, and no other one: the operator may have cleared it.

What it cannot see: a surface that is stuck at its commanded position. It shows with the next command.

The health that they publish: 0 well, else the device that was reported last: 1 or 2 the servo of that number, 3 the
angle sensor.

Start: the surface is expected where it stands. A missing command or angle suspends the comparison. A restart forgets
the reports; the next failure repeats them, which changes nothing.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import number

_NS_PER_S = 1_000_000_000
_TOLERANCE_DEG = 2.5
_DELAY_NS = 500_000_000
_DELAY_WITHOUT_ECHO_NS = 1_500_000_000  # noticed, planned, held until T_lease is over, and driven back: all in this
_LOOKS = 5  # command and angle are of different moments: one slow step between them proves nothing
_TIME_TO_SWITCH_NS = 3_000_000_000
_FOLLOWING_NS = 3_000_000_000  # longer than a swinging command needs to pass a stuck surface by
_LAG_S = 0.1
_DETAIL_PER_DEG = 10
_DETAIL_MAX = 0xFFFF
_SENSOR = 3


class SurfaceMonitor(Module):
    """Watches the elevator; subclasses say which variable is the command and which servo it goes to."""

    command: ClassVar[str]
    health: ClassVar[str]
    delay_ns: ClassVar[int] = _DELAY_NS

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._expected_deg: float | None = None
        self._accused: list[int] = []
        self._apart_ns = 0  # how long the difference has lasted; negative: not looked at yet
        self._following_ns = 0
        self._followed_since_accused = True

    def working_servo(self, inputs: Inputs) -> int:
        """Give the number of the servo that the command goes to."""
        raise NotImplementedError

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Compare, and publish the health."""
        commanded_deg, angle_deg = number(inputs, self.command), number(inputs, "elevator_angle")
        if commanded_deg is None or angle_deg is None:
            self._expected_deg = None
            self._apart_ns = min(self._apart_ns, 0)
            self._following_ns = 0
        else:
            self._compare(commanded_deg, angle_deg, self.working_servo(inputs))
        return {self.health: self._accused[-1] if self._accused else 0}

    def _compare(self, commanded_deg: float, angle_deg: float, servo: int) -> None:
        if self._expected_deg is None:
            self._expected_deg = angle_deg
        period_s = self.ctx.period_ns / _NS_PER_S
        self._expected_deg += (commanded_deg - self._expected_deg) * period_s / (_LAG_S + period_s)
        difference_deg = abs(angle_deg - self._expected_deg)
        if self._apart_ns < 0:
            self._apart_ns = min(self._apart_ns + self.ctx.period_ns, 0)
        elif difference_deg > _TOLERANCE_DEG:
            self._following_ns = 0
            self._apart_ns += self.ctx.period_ns
            if self._apart_ns >= max(self.delay_ns, _LOOKS * self.ctx.period_ns):
                self._accuse(servo, difference_deg)
        else:
            self._apart_ns = 0
            self._follow(servo)

    def _follow(self, servo: int) -> None:
        self._following_ns += self.ctx.period_ns
        if self._following_ns >= _FOLLOWING_NS:
            self._followed_since_accused = True
            self._accused = [other for other in self._accused if other not in {servo, _SENSOR}]

    def _accuse(self, servo: int, difference_deg: float) -> None:
        self._apart_ns = -_TIME_TO_SWITCH_NS
        is_servo = servo in self._accused or self._followed_since_accused
        culprit = servo if is_servo and _SENSOR not in self._accused else _SENSOR
        device = "elevator_angle_sensor" if culprit == _SENSOR else f"elevator_servo_{culprit}"
        self.ctx.report_failed(f"device:{device}", min(round(_DETAIL_PER_DEG * difference_deg), _DETAIL_MAX))
        if culprit not in self._accused:
            self._accused.append(culprit)
            self._followed_since_accused = False


class ElevatorMonitor(SurfaceMonitor):
    """The monitor that knows which servo works: the version of the echo is the servo's number."""

    command = "elevator_servo_command"
    health = "servo_health"

    def working_servo(self, inputs: Inputs) -> int:
        """Read the number off the datum."""
        return inputs[self.command].version


class ServoMonitor(SurfaceMonitor):
    """The monitor of the paper's Figure 3, which has to assume which servo works."""

    command = "elevator_demand"
    health = "servo_failure"
    delay_ns = _DELAY_WITHOUT_ECHO_NS

    def working_servo(self, inputs: Inputs) -> int:  # noqa: ARG002 (its inputs do not say)
        """Give the first servo, or the second once the first has been reported."""
        return 2 if 1 in self._accused else 1
