"""What a plant with flight dynamics offers to the devices of the PEs, and to the record of a flight.

A plant steps at 120 Hz; step 0 is at time 0 of the plant. `advance` steps the plant up to a time; actuators keep their
last command during these steps. A plant never steps back: a call with an earlier time acts at the time that the plant
has reached. The plant uses no bus, no module and no clock. Its random numbers come from its seed. So two plants with
the same seed and the same calls give the same results, bit by bit.

Positions are in the runway's frame: x along the landing direction from the aiming point of the approach (m), y to the
right of the centre line (m), height of the wheels above the runway (m). The landing direction is north in JSBSim (the
flight dynamics). The aircraft BIG BLUE has no runway: its x points north from home and its y east; its height is that
of the skids above the field.
"""

from dataclasses import dataclass
from typing import Protocol

from heronry_agent.module import Value
from heronry_tools.aircraft.plant.interface import Failure

STEPS_PER_S = 120
NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Truth:
    """The real state of the aircraft at one time, for records and acceptance; modules cannot read it."""

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
        """Step the model up to the last step at or before `time_ns`.

        An earlier time than the present one has no effect.
        """

    def read(self, device: str, now_ns: int) -> Value | None:
        """Advance to `now_ns`, and return the reading of a device; None if the device does not answer.

        The reading of a servo is the last command that the servo has accepted; None before the first one.
        """

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:
        """Advance to `now_ns` and command an actuator.

        Return the command that the actuator accepted; None: it accepted no command.
        """

    def make_safe(self, device: str, now_ns: int) -> None:
        """Execute the safe action of an actuator that no module drives any more."""

    def fail(self, device: str, how: Failure, now_ns: int, offset: float = 0.0) -> None:
        """Make a device fail as `how` says.

        offset: for the failure `bias`, the error of the value, in the unit of the device.
        """

    def heal(self, device: str) -> None:
        """Repair a device."""

    def truth(self) -> Truth:
        """Return the real state of the aircraft at present."""
