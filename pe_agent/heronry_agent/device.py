"""The device interface: all that an agent knows of a sensor or an actuator, real or simulated.

A *device driver* offers the devices of one PE by name. A sensor gives a reading: a value, the time at which it was
taken, and whether it may be used. An actuator takes a command, gives the value to which it really moved, and has a safe
action for the moment at which no module drives it any more. A driver is found by the entry point `heronry.devices`
(pyproject.toml): a callable that takes the origin of the flight on the monotonic clock, in ns, and gives a
`DeviceDriver`. The plant of the shipped aircraft is one; the drivers of real parts are others. docs/modules.md shows
one.

The caller is `shell.devices`, in the agent's own process; it gives a command only when the core has found that the
output is authorized at that moment (protocol rule 6). Each method of a driver returns within a few hundred
microseconds: anything slower belongs in a thread or process of the driver's own, and `read` gives the newest reading
there is.

The agent calls for the safe action when the module stops, also to be built anew; when it is given up; when its
partition ends; when the agent begins anew, and when it ends in order. The call may come twice, and before any command.
A module that changes its mode keeps its device. While an output is not authorized the agent gives no command and calls
for no safe action: the actuator stays as it is. An agent that is killed makes no call: against that, the hardware needs
a watchdog.

An exception of a driver does not end the agent: the reading is missing, or the command has failed with the exception as
its reason.
"""

from collections.abc import Iterable
from typing import NamedTuple, Protocol

from heronry_agent.module import Value


class Reading(NamedTuple):
    """A reading of a device."""

    value: Value | None  # None: the device does not answer
    time_ns: int  # when it was taken, on the clock of the caller's `now_ns`
    valid: bool  # False: the device itself reports that the value must not be used


class Device(Protocol):
    """One sensor or actuator."""

    def read(self, now_ns: int) -> Reading:
        """Newest reading; of an actuator, its last command. `now_ns` is the agent's clock."""

    def command(self, value: Value, now_ns: int) -> Value | None:
        """Command an actuator; gives the value to which it really moved, to be echoed, or None where it did not move.

        Raises TypeError, with one sentence, for a value that the actuator cannot take.
        """

    def make_safe(self, now_ns: int) -> None:
        """Take the safe action of an actuator, because its module does not drive it any more; a sensor does nothing."""


class DeviceDriver(Protocol):
    """Gives access to the devices of one PE."""

    def open(self, name: str) -> Device:
        """Give the device of this name (in the spec); called once, and any exception ends the agent's start."""

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:
        """Actuators of other PEs whose echoes these sensors need: a simulated plant needs them, a real device none."""

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Take the value of one of those actuators from the output echo of another PE."""
