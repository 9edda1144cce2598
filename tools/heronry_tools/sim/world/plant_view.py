"""The one plant of a run, and the device drivers through which each PE reads and moves it.

In flight every process has its own plant, which follows the others by their output echoes. The simulator is one process
and has one plant, which is more realistic: a surface stays where it is when its PE restarts, and a failed servo stays
failed. The plant is read and moved at the true time, whatever a PE's clock shows.
"""

from collections.abc import Iterable

from heronry_agent.device import Reading
from heronry_agent.module import Value
from heronry_tools.aircraft.plant import Plant
from heronry_tools.sim.world.clock import Clock


class _DeviceOfPlant:
    """A device of the plant, read and moved at the true time."""

    def __init__(self, plant: Plant, name: str, clock: Clock) -> None:
        self._plant, self._name, self._clock = plant, name, clock

    def read(self, now_ns: int) -> Reading:
        """Give the device's present reading."""
        value = self._plant.read(self._name, self._clock.now_ns)
        return Reading(value, now_ns, value is not None)

    def command(self, value: Value, now_ns: int) -> Value | None:  # noqa: ARG002 - the PE's own clock
        """Move an actuator."""
        return self._plant.write(self._name, value, self._clock.now_ns)

    def make_safe(self, now_ns: int) -> None:
        """Do nothing: without a command an actuator of this plant stays where it is."""


class PlantView:
    """The device driver of one simulated PE."""

    def __init__(self, plant: Plant, clock: Clock) -> None:
        self._plant, self._clock = plant, clock

    def open(self, name: str) -> _DeviceOfPlant:
        """Give the device of this name."""
        return _DeviceOfPlant(self._plant, name, self._clock)

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:
        """Give the actuators on other PEs whose echoes a plant of one process would need."""
        return self._plant.follows(sensors)

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Ignore an output echo: the plant has moved already."""
