"""The device interface: all that an agent knows of a sensor or an actuator, real or simulated.

A *device driver* offers the devices of one PE by name. A sensor gives a reading: a value, the time at which it was
taken, and whether it may be used. An actuator takes a command, says where it really went, and has a safe action for the
moment at which nobody drives it any more. A driver is found by the entry point `heronry.devices` (pyproject.toml): a
callable that is given the origin of the flight on the monotonic clock, in ns, and gives a `DeviceDriver`. The plant of
the shipped aircraft is one; the drivers of real parts are others. docs/modules.md shows one.

Who asks, and when: `shell.devices`, in the agent's own process; a command only when the core has said that the output
is authorized at that moment (protocol rule 6). A driver answers at once: what takes longer than a few hundred
microseconds belongs in a thread or process of the driver's own, and `read` gives the newest reading there is.

The safe action is asked for when the module stops, also to be built anew; when it is given up; when its partition ends;
when the agent begins anew, and when it ends in order. It may come twice, and before any command. A module that changes
its mode keeps its device. While an output is not authorized the agent gives no command and asks for no safe action: the
actuator stays as it is. An agent that is killed asks for nothing: against that, the hardware needs a watchdog.

What a driver raises ends no agent: a reading is then missing, a command has failed with the exception as its reason.
"""

from collections.abc import Iterable
from typing import NamedTuple, Protocol

from heronry_agent.module import Value


class Reading(NamedTuple):
    """What a device says."""

    value: Value | None  # None: it does not answer
    time_ns: int  # when it was taken, on the clock that the caller's `now_ns` is of
    valid: bool  # False: the device itself says that it must not be used


class Device(Protocol):
    """One sensor or actuator."""

    def read(self, now_ns: int) -> Reading:
        """Newest reading; of an actuator, where it was last told to go. `now_ns` is the agent's clock."""

    def command(self, value: Value, now_ns: int) -> Value | None:
        """Drive an actuator; gives where it really went, to be echoed, or None where it did not move.

        Raises TypeError, with one sentence, for a value that it cannot be driven by.
        """

    def make_safe(self, now_ns: int) -> None:
        """Take the safe action of an actuator, because its module drives it no more; nothing for a sensor."""


class DeviceDriver(Protocol):
    """Whoever has the devices of one PE."""

    def open(self, name: str) -> Device:
        """Give the device of this name (of the spec), asked for once; whatever it raises ends the agent's start."""

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:
        """Actuators elsewhere whose echoes these sensors need: a simulated world does, a real one needs none."""

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Another PE has said where one of those actuators went."""
