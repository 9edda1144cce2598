"""The interface to a plant, which the simulator and the drivers of devices use.

The scripted plant (world.py) has this interface, and so have the plants with a flight dynamics model
(`heronry_tools.fly`). Devices are read and moved by their names. The times of the simulator's calls never decrease.
"""

from collections.abc import Callable, Iterable
from typing import Literal, Protocol

from heronry_agent.device import Reading
from heronry_agent.module import Value

Failure = Literal["dead", "stuck", "bias", "loose"]


class PlantOfDevices(Protocol):
    """A plant: a physical world that devices read and move."""

    def read(self, device: str, now_ns: int) -> Value | None:
        """Return the present reading of a device; None if it does not answer. An actuator gives its last command."""

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:
        """Move an actuator; returns the position that it takes, for the echo, or None if it does not move."""

    def make_safe(self, device: str, now_ns: int) -> None:
        """Take the safe action of an actuator that no module drives any more."""

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:
        """Return the actuators that change what these sensors measure.

        A plant with these sensors needs the output echoes of those actuators that are on other PEs.
        """

    def fail(self, device: str, how: Failure, now_ns: int, offset: float = 0.0) -> None:
        """Make a device fail.

        how: `dead`: the device does not answer, and moves nothing. `stuck`: a sensor keeps its present reading,
            and an actuator takes no command. `bias`: the reading or position is wrong by `offset`. `loose`: a
            servo does not hold its surface; a plant without forces treats a loose device as a stuck one.
        offset: the bias, in the unit of the device.
        """

    def heal(self, device: str) -> None:
        """End a device's failure; no effect on a healthy device."""


class PlantDevice:
    """One device of a plant, as an object with the interface of `heronry_agent.device`."""

    def __init__(self, plant: PlantOfDevices, name: str, clock: Callable[[], int] | None = None) -> None:
        """Use the time of `clock` (ns); without a clock, use the `now_ns` of each call."""
        self._plant, self._name, self._clock = plant, name, clock

    def read(self, now_ns: int) -> Reading:
        """Return the present reading, valid unless the device does not answer."""
        value = self._plant.read(self._name, now_ns if self._clock is None else self._clock())
        return Reading(value, now_ns, value is not None)

    def command(self, value: Value, now_ns: int) -> Value | None:
        """Move an actuator; returns the position that it takes, or None if it does not move."""
        return self._plant.write(self._name, value, now_ns if self._clock is None else self._clock())

    def make_safe(self, now_ns: int) -> None:
        """Make the plant take the safe action of this device, an actuator; the plant decides what this action is."""
        self._plant.make_safe(self._name, now_ns if self._clock is None else self._clock())
