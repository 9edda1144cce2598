"""The one plant of a simulation, and the device drivers through which each PE reads and moves it.

The simulator is one process and has one plant for all PEs: a plant that follows a script, or one with flight dynamics.
A surface stays where it is when its PE restarts, and a failed servo stays failed. The plant is read and moved at the
true time, whatever a PE's clock shows.

`heronry demo` is less realistic: each PE is a process with a plant of its own, which learns from output echoes what the
actuators of other PEs do.
"""

from collections.abc import Iterable

from heronry_agent.module import Value
from heronry_tools.aircraft.plant import PlantDevice, PlantOfDevices
from heronry_tools.sim.world.clock import Clock


class PlantView:
    """The device driver of one simulated PE, which reads and moves the devices of the one simulated plant."""

    def __init__(self, plant: PlantOfDevices, clock: Clock) -> None:
        self._plant, self._clock = plant, clock

    def open(self, name: str) -> PlantDevice:
        """Return the device of this name; its time is that of the simulation, and not the clock of a node."""
        return PlantDevice(self._plant, name, self._true_ns)

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:
        """Return the actuators on other PEs whose output echoes a plant with these sensors needs."""
        return self._plant.follows(sensors)

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Ignore an output echo: all PEs share one plant, which the command to the actuator has already moved."""

    def _true_ns(self) -> int:
        return self._clock.now_ns
