"""The servo monitors: they compare a surface's command with its position, and report the device that has failed.

*Detection.* A healthy servo has a short lag. The monitor computes where such a servo would have brought the surface. It
detects a failure if the surface is further from this position than the tolerance for `delay_ns` without a break, and in
at least five comparisons. After a report the monitor waits while the manager activates the other servo.

*Which servo.* In `big_blue` each servo driver publishes its command with its own version, so the version of the datum
shows which servo is driven. The monitor of `elevator_and_chute` has no such input. It assumes that the first branch of
the DEMUX drives, and that the second branch drives after the first servo was reported. If the first servo is out of use
for another reason, the assumption is wrong, but harmless: the report names a device that is already down.

*Is a servo driven at all?* A surface also stands still while its driver is silent or not authorized, until another
driver takes over. The monitor of `elevator_and_chute` has no input that shows this. So before it reports a servo, it
waits for longer than a reconfiguration takes.

*Servo or sensor.* The second servo is reported only if the surface has followed its commands for a while since the
report of the first servo. If not, the sensor is reported: two servos rarely fail within a short time, but one stuck
potentiometer makes both servos look wrong. A report of both servos would leave the aircraft without an elevator because
of a sensor. If a reported device is still in use and fails again, it is reported again, since the operator may have
cleared it.

A surface that is stuck at its commanded position is not detected until the next command.

*Published health.*

    0       no device counts as failed
    1, 2    the servo of this number was reported last
    3       the angle sensor was reported last

*Start and restart.* When the monitor starts, it takes the present position of the surface as the expected one. Without
a command or an angle it does not compare. A restart forgets the reports; the next failure is reported again, which
changes nothing.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import number

_NS_PER_S = 1_000_000_000
_TOLERANCE_DEG = 2.5
_DELAY_NS = 500_000_000
_DELAY_WITHOUT_ECHO_NS = 1_500_000_000  # detection, planning, T_lease, and the way back of the surface
_LOOKS = 5  # comparisons: command and angle are of different moments, so one difference proves nothing
_TIME_TO_SWITCH_NS = 3_000_000_000
_FOLLOWING_NS = 3_000_000_000  # a command that swings past a stuck surface agrees with it for a shorter time
_LAG_S = 0.1
_DETAIL_PER_DEG = 10
_DETAIL_MAX = 0xFFFF
_SENSOR = 3


class SurfaceMonitor(Module):
    """Monitors the two servos and the angle sensor of the elevator.

    A subclass sets the names of two variables, `command` and `health`, and overrides `working_servo`.
    """

    command: ClassVar[str]
    health: ClassVar[str]
    delay_ns: ClassVar[int] = _DELAY_NS

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._expected_deg: float | None = None
        self._accused: list[int] = []
        self._apart_ns = 0  # duration of the difference; negative: not compared yet
        self._following_ns = 0
        self._followed_since_accused = True

    def working_servo(self, inputs: Inputs) -> int:
        """Return the number (1 or 2) of the servo that is driven."""
        raise NotImplementedError

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Compare the elevator's angle with the angle expected after the commands, and publish the health.

        The health is 1 or 2 if the servo of this number counts as failed, 3 if the angle sensor does, and 0 if no
        device does. If several devices count as failed, it shows the one whose failure was detected last.
        """
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
    """The monitor of `big_blue`: the version of the published command is the number of the driven servo."""

    command = "elevator_servo_command"
    health = "servo_health"

    def working_servo(self, inputs: Inputs) -> int:
        """Return the version of the command, which is the number of the servo that is driven."""
        return inputs[self.command].version


class ServoMonitor(SurfaceMonitor):
    """The monitor of the servos in `elevator_and_chute`.

    Servo 1 counts as driven until servo 1 is reported as failed; from then on servo 2 counts as driven.
    """

    command = "elevator_demand"
    health = "servo_failure"
    delay_ns = _DELAY_WITHOUT_ECHO_NS

    def working_servo(self, inputs: Inputs) -> int:  # noqa: ARG002 (its inputs do not say)
        """Return the number of the servo that counts as driven: 2 after servo 1 was reported, 1 before."""
        return 2 if 1 in self._accused else 1
