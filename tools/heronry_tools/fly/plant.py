"""What a plant with flight dynamics offers to the devices of the PEs, and to the record of a flight.

A plant steps at 120 Hz, on a grid that starts at its time 0. `advance` brings it to a time; actuators keep their last
command during the steps. The time of a call may not fall below that of an earlier one: such a call reads the present
state. The plant knows no bus, no module and no clock, and draws all chance from its seed, so that equal calls give
equal bits.

Positions are in the runway's frame: x along the landing direction from the aiming point of the approach (m), y to the
right of the centre line (m), height of the wheels above the runway (m). The landing direction is north in JSBSim.
"""

from dataclasses import dataclass
from typing import Protocol

from heronry_agent.module import Value
from heronry_tools.aircraft.plant.interface import Failure

STEPS_PER_S = 120
NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Truth:
    """The aircraft's real state at one time, for records and acceptance; no module sees it."""

    time_s: float
    x_m: float
    y_m: float
    height_m: float  # of the wheels above the runway
    north_m_per_s: float
    east_m_per_s: float
    up_m_per_s: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    airspeed_m_per_s: float  # true
    load_factor_g: float
    touching: tuple[str, ...]  # names of the contacts that touch the ground: gear first, then structure


class FlightPlant(Protocol):
    """An aircraft in a flight dynamics model, with its sensors and actuators by name of device."""

    def advance(self, time_ns: int) -> None:
        """Step the model up to the last step at or before `time_ns`; no effect when that is past."""

    def read(self, device: str, now_ns: int) -> Value | None:
        """Advance, and give the present reading of a device; None if it does not answer."""

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:
        """Advance, then command an actuator; give the command that it has taken, or None if it takes none."""

    def make_safe(self, device: str, now_ns: int) -> None:
        """Take the safe action of an actuator that no module drives any more."""

    def fail(self, device: str, how: Failure, now_ns: int, offset: float = 0.0) -> None:
        """Make a device fail: silent, stuck, wrong by `offset` (in its own unit), or (a servo) free to move."""

    def heal(self, device: str) -> None:
        """End a device's failure."""

    def truth(self) -> Truth:
        """Give the present state."""
