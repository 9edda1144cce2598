"""The device interface: how an agent reads sensors and commands actuators, real or simulated.

A *device driver* opens the devices of one PE by name. A sensor gives a reading: a value, the time at which the value
was taken, and whether the value may be used. An actuator takes a command, gives the value to which it really moved, and
has a safe action for the moment at which no module drives it any more. A package offers a driver under the entry point
`heronry.devices` (pyproject.toml): a callable that takes the take-off time of a simulated flight on the monotonic
clock, in ns, and gives a `DeviceDriver`. The plant of the shipped aircraft is such a driver, and so are the drivers of
real devices. docs/modules.md shows one.

The caller is `shell.devices`, in the agent's process. It gives a command only if the core has found that the output is
authorized at that moment (protocol rule 6). Each method of a driver must return within a few hundred microseconds. A
driver does anything slower in its own thread or process, and `read` gives the newest reading that there is.

The agent calls for the safe action when the module stops, even if it will be restarted; when the module is given up;
when its partition ends; and when the agent starts anew or ends in order. The call may come twice, and before any
command. A module that changes its mode keeps its device. While an output is not authorized the agent gives neither a
command nor a call for the safe action: the actuator stays as it is. An agent that is killed makes no call; for that
case the hardware needs a watchdog.

An exception of a driver does not end the agent: the reading counts as missing, or the command as failed, with the
exception as the reason.
"""

from collections.abc import Iterable
from typing import NamedTuple, Protocol

from heronry_agent.module import Value


class Reading(NamedTuple):
    """A reading of a device."""

    value: Value | None  # None: the device does not answer
    time_ns: int  # when the value was taken, on the clock of the caller's `now_ns`
    valid: bool  # False: the device itself reports that the value must not be used


class Device(Protocol):
    """One sensor or actuator."""

    def read(self, now_ns: int) -> Reading:
        """Give the newest reading of a sensor, or the last command of an actuator; `now_ns` is on the agent's clock."""

    def command(self, value: Value, now_ns: int) -> Value | None:
        """Command an actuator.

        Gives the value to which the actuator really moved, for the output echo, or None if it did not move. Raises
        TypeError, with one sentence, for a value that the actuator cannot take.
        """

    def make_safe(self, now_ns: int) -> None:
        """Take the safe action of an actuator, because no module drives it any more; no effect on a sensor."""


class DeviceDriver(Protocol):
    """Opens the devices of one PE."""

    def open(self, name: str) -> Device:
        """Open the device with this name in the spec; called once per device.

        An exception ends the start of the agent.
        """

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:
        """Names of actuators of other PEs whose output echoes these sensors need; none with real devices."""

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Take the value of one of the actuators that `follows` gave, from the output echo of its PE."""
