"""What the simulator asks of a plant: the scripted one, or one in a flight dynamics model, is behind the devices.

A plant is read and moved by the name of a device. The simulator calls with rising times.
"""

from collections.abc import Callable, Iterable
from typing import Literal, Protocol

from heronry_agent.device import Reading
from heronry_agent.module import Value

Failure = Literal["dead", "stuck", "bias", "loose"]


class PlantOfDevices(Protocol):
    """A world that devices read and move."""

    def read(self, device: str, now_ns: int) -> Value | None:
        """Give the present reading of a device; None if it does not answer. An actuator gives its last command."""

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:
        """Move an actuator; give the position that it takes, for the echo, or None if it does not move."""

    def make_safe(self, device: str, now_ns: int) -> None:
        """Take the safe action of an actuator that no module drives any more."""

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:
        """Give the actuators on other PEs whose echoes a plant with these sensors needs."""

    def fail(self, device: str, how: Failure, now_ns: int, offset: float = 0.0) -> None:
        """Make a device fail: silent, stuck at its present reading, wrong by `offset`, or (a servo) free to move."""

    def heal(self, device: str) -> None:
        """End a device's failure; no effect on a healthy device."""


class PlantDevice:
    """A device of a plant behind the interface of `heronry_agent.device`."""

    def __init__(self, plant: PlantOfDevices, name: str, clock: Callable[[], int] | None = None) -> None:
        """`clock` gives the time, in ns, at which the plant is read and moved; None: the caller's `now_ns` counts."""
        self._plant, self._name, self._clock = plant, name, clock

    def read(self, now_ns: int) -> Reading:
        """Give the present reading."""
        value = self._plant.read(self._name, now_ns if self._clock is None else self._clock())
        return Reading(value, now_ns, value is not None)

    def command(self, value: Value, now_ns: int) -> Value | None:
        """Move an actuator."""
        return self._plant.write(self._name, value, now_ns if self._clock is None else self._clock())

    def make_safe(self, now_ns: int) -> None:
        """Take the safe action of an actuator."""
        self._plant.make_safe(self._name, now_ns if self._clock is None else self._clock())
