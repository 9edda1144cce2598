"""The device interface: how an agent reads sensors and commands actuators, real or simulated.

A *device driver* opens the devices of one PE by name. A sensor returns a reading: a value, the time at which the value
was taken, and whether the value may be used. An actuator takes a command, returns the value to which it really moved,
and has a safe action for the time when no module drives it.

A package offers a driver under the entry point `heronry.devices` (pyproject.toml): a callable that takes the take-off
time of a simulated flight on the monotonic clock, in ns, and gives a `DeviceDriver`. The plant of the shipped aircraft
is such a driver, and so are the drivers of real devices. docs/modules.md shows an example.

The agent calls the driver in its own process. It commands an actuator only if the output is authorized at that moment
(protocol rule 6). Each method of a driver must return within a few hundred microseconds. Slower work belongs in a
thread or process of the driver; `read` then returns the newest reading that this thread or process has taken.

The agent calls for the safe action (`make_safe`)

- when the module stops, even if it will be restarted;
- when the module is given up;
- when the module's partition ends;
- when the agent starts anew, or ends in order.

A driver must expect this call twice in a row, and also before the first command. When a module only changes its mode,
no call comes. While an output is not authorized the agent neither commands the actuator nor calls for the safe action:
the actuator stays as it is. An agent that is killed makes no call; for that case the hardware needs a watchdog.

An exception of a driver does not end a running agent: after an exception of `read` the reading counts as missing, and
after an exception of `command` the command has failed, with the exception as the reason.
"""

from collections.abc import Iterable
from typing import NamedTuple, Protocol

from heronry_agent.module import Value


class Reading(NamedTuple):
    """What a device returns when it is read."""

    value: Value | None  # None: the device does not answer
    time_ns: int  # when the value was taken, on the clock of the caller's `now_ns`
    valid: bool  # False: the device itself reports that the value must not be used


class Device(Protocol):
    """One sensor or actuator."""

    def read(self, now_ns: int) -> Reading:
        """Return the newest reading of a sensor, or the last command of an actuator.

        now_ns: time on the agent's monotonic clock.
        """

    def command(self, value: Value, now_ns: int) -> Value | None:
        """Command an actuator; returns the value to which it really moved, None if it did not move.

        The returned value is sent as the output echo. Raises TypeError, with a message of one sentence, for a value
        that the actuator cannot take.
        """

    def make_safe(self, now_ns: int) -> None:
        """Take the safe action of an actuator that no module drives now; do nothing for a sensor."""


class DeviceDriver(Protocol):
    """A device driver, which opens the devices of one PE; the agent finds it by the entry point `heronry.devices`.

    A driver that simulates devices may have an attribute `every_echo`, which is True: then the agent echoes every
    command to an actuator, for the simulated plants of other PEs. Other drivers leave it out; the table of the PE says
    how often their outputs are echoed.
    """

    def open(self, name: str) -> Device:
        """Return the device that has this name in the spec; called once per device.

        If this raises an exception, the agent does not start.
        """

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:
        """Return the names of actuators of other PEs whose commanded values these sensors need (`heard`).

        Only simulated sensors need any; a driver of real devices returns an empty set.
        """

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Take the commanded value of an actuator on another PE; `follows` has named this actuator."""
