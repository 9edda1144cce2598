"""The device table of the two shipped specs: what each sensor measures, and what each actuator moves.

*Actuators.* An actuator moves a *mechanism*, for example a surface or the gas in the wings (mechanism.py). The aircraft
reacts to its surfaces. Its pitch is that of the scripted flight (flight.py) plus a share of the elevator's angle; its
roll is that of the scripted flight plus a share of the rudder's angle. This share grows with the square of the
airspeed, and the airframe follows with a lag. While the aircraft hangs below the balloon there is hardly any flow, so
the surfaces have no effect.

*Sensors.* A reading is the value that the real device gives to its driver, in the units of the device. An inertial unit
and a GPS receiver give integers, a pressure transducer gives hectopascals. Noise and bias are as large as those of such
devices.

A device that is not in the table can be used, too: a sensor reads 0.0, an actuator keeps its last command.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from heronry_agent.module import Value
from heronry_tools.aircraft.images import atmosphere
from heronry_tools.aircraft.plant.flight import CUTDOWN_S, NS_PER_S, moment
from heronry_tools.aircraft.plant.noise import noise

CAMERA_FRAMES_PER_S = 5
GPS_PERIOD_NS = 100_000_000
HORIZON_COUNTS = 1000  # contrast at an angle of 90 degrees
# The mechanisms that each actuator pushes. An actuator of a surface pushes the surface and the airframe.
PUSHED_BY: Mapping[str, tuple[str, ...]] = {
    "elevator_servo_1": ("elevator", "pitching"),
    "elevator_servo_2": ("elevator", "pitching"),
    "rudder_servo_1": ("rudder", "rolling"),
    "rudder_servo_2": ("rudder", "rolling"),
    "inflation_valve": ("wing",),
}
WING_SUPPLY_HPA = 700.0  # final pressure in the wings with the valve fully open
_PITCH_PER_ELEVATOR = -0.4  # deg per deg at the best glide: an elevator that goes down lowers the nose
_ROLL_PER_RUDDER = 0.6
_GLIDE_M_PER_S = 18.0


class Motion(Protocol):
    """The state of the aircraft on which readings depend.

    It comes from the script (`flight.Moment`), or from a dynamics model.
    """

    @property
    def time_s(self) -> float: ...  # noqa: D102 - the names and units say it
    @property
    def altitude_m(self) -> float: ...  # noqa: D102
    @property
    def latitude_deg(self) -> float: ...  # noqa: D102
    @property
    def longitude_deg(self) -> float: ...  # noqa: D102
    @property
    def track_deg(self) -> float: ...  # noqa: D102
    @property
    def airspeed_m_per_s(self) -> float: ...  # noqa: D102
    @property
    def pitch_deg(self) -> float: ...  # noqa: D102
    @property
    def roll_deg(self) -> float: ...  # noqa: D102
    @property
    def pitch_rate_deg_per_s(self) -> float: ...  # noqa: D102
    @property
    def roll_rate_deg_per_s(self) -> float: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Everything on which the reading of a sensor depends.

    device: the name of the sensor.
    time_ns: the time since take-off.
    now: the state of the aircraft at that time.
    position: gives the position of a mechanism, by its name, in the unit of the mechanism (deg, hPa).
    rate: gives the rate of a mechanism, by its name, in its unit per second.
    seed: seed of the noise; None for the noise of the scripted flight.
    """

    device: str
    time_ns: int
    now: Motion
    position: Callable[[str], float]  # of a mechanism
    rate: Callable[[str], float]
    seed: int | None = None  # of the noise; None: that of the scripted flight

    @property
    def attitude_deg(self) -> tuple[float, float]:
        """Pitch and roll in degrees: those of `now`, plus the effect of the positions of the surfaces."""
        pitch, roll = self._by_surfaces(self.position)
        return self.now.pitch_deg + pitch, self.now.roll_deg + roll

    @property
    def body_rates_deg_per_s(self) -> tuple[float, float]:
        """Rates of pitch and roll, with the effect of the surfaces."""
        pitch, roll = self._by_surfaces(self.rate)
        return self.now.pitch_rate_deg_per_s + pitch, self.now.roll_rate_deg_per_s + roll

    def _by_surfaces(self, of: Callable[[str], float]) -> tuple[float, float]:
        flow = (self.now.airspeed_m_per_s / _GLIDE_M_PER_S) ** 2
        return _PITCH_PER_ELEVATOR * flow * of("pitching"), _ROLL_PER_RUDDER * flow * of("rolling")

    def with_noise(self, value: float, sigma: float, axis: str = "") -> float:
        """Return the value with noise of standard deviation `sigma`; each device and axis has noise of its own."""
        name = self.device + axis
        return value + sigma * noise(name if self.seed is None else f"{self.seed}/{name}", self.time_ns)


Sensor = Callable[[Surroundings], Value]


def _inertial_unit(surroundings: Surroundings) -> tuple[int, ...]:
    """Pitch and roll rate in 0.001 deg/s, longitudinal and lateral acceleration in 0.001 g."""
    pitch, roll = (math.radians(angle) for angle in surroundings.attitude_deg)
    pitch_rate, roll_rate = surroundings.body_rates_deg_per_s
    return (
        round(1000.0 * surroundings.with_noise(pitch_rate, 0.1, "q")),
        round(1000.0 * surroundings.with_noise(roll_rate, 0.1, "p")),
        round(1000.0 * surroundings.with_noise(math.sin(pitch), 0.01, "x")),
        round(1000.0 * surroundings.with_noise(-math.sin(roll) * math.cos(pitch), 0.01, "y")),
    )


def _rate_gyros(surroundings: Surroundings) -> tuple[int, ...]:
    """Pitch and roll rate in 0.001 deg/s: noisier than those of the inertial unit, and never quite zero."""
    pitch_rate, roll_rate = surroundings.body_rates_deg_per_s
    return (
        round(1000.0 * surroundings.with_noise(pitch_rate + 0.05, 0.3, "q")),
        round(1000.0 * surroundings.with_noise(roll_rate - 0.04, 0.3, "p")),
    )


def _horizon(surroundings: Surroundings) -> tuple[int, ...]:
    """Contrast between warm ground and cold sky, along the aircraft and across it, in counts."""
    along, across = (math.sin(math.radians(angle)) for angle in surroundings.attitude_deg)
    return (
        round(HORIZON_COUNTS * surroundings.with_noise(along, 0.06, "x")),
        round(HORIZON_COUNTS * surroundings.with_noise(across, 0.06, "y")),
    )


def _gps(surroundings: Surroundings) -> tuple[int, ...]:
    """Latitude and longitude in 1e-7 deg, height in mm, track in 1e-5 deg: integers, as receivers report them."""
    return (
        round(1e7 * surroundings.with_noise(surroundings.now.latitude_deg, 2e-5, "n")),
        round(1e7 * surroundings.with_noise(surroundings.now.longitude_deg, 2e-5, "e")),
        round(1e3 * surroundings.with_noise(surroundings.now.altitude_m, 4.0, "u")),
        round(1e5 * surroundings.now.track_deg),
    )


def _pressure(bias_hpa: float) -> Sensor:
    """Return the function that reads a static pressure transducer with this bias, in hPa."""

    def read(surroundings: Surroundings) -> float:
        return max(surroundings.with_noise(atmosphere.pressure_hpa(surroundings.now.altitude_m) + bias_hpa, 0.02), 0.0)

    return read


def _pitot(surroundings: Surroundings) -> float:
    return surroundings.with_noise(atmosphere.differential_hpa(surroundings.now.airspeed_m_per_s), 0.005)


def _angle_of(mechanism: str) -> Sensor:
    """Return a function that reads the potentiometer on a surface: the surface's angle in degrees."""

    def read(surroundings: Surroundings) -> float:
        return surroundings.with_noise(surroundings.position(mechanism), 0.05)

    return read


def _wing_pressure(surroundings: Surroundings) -> float:
    return max(surroundings.with_noise(surroundings.position("wing"), 1.0), 0.0)


def _ultraviolet(surroundings: Surroundings) -> float:
    """UV irradiance in W/m2; the less air is above the aircraft, the larger it is."""
    above = atmosphere.pressure_hpa(surroundings.now.altitude_m) / atmosphere.SEA_LEVEL_PRESSURE_HPA
    return max(surroundings.with_noise(55.0 - 35.0 * above, 0.5), 0.0)


def _battery(surroundings: Surroundings) -> float:
    return surroundings.with_noise(12.6 - 0.004 * surroundings.now.time_s, 0.01)


def _camera(surroundings: Surroundings) -> int:
    return surroundings.time_ns * CAMERA_FRAMES_PER_S // NS_PER_S


def _commands(surroundings: Surroundings) -> tuple[int, ...]:
    """Return the two commands of the mission, each 0 or 1: release the parachute (never), cut the balloon's line."""
    return (0, int(surroundings.now.time_s >= CUTDOWN_S))


def _chute_command(_surroundings: Surroundings) -> int:
    return 0


SENSORS: Mapping[str, Sensor] = {
    "imu_1": _inertial_unit,
    "imu_2": _rate_gyros,
    "horizon_sensor": _horizon,
    "gps": _gps,
    "barometer": _pressure(0.3),
    "pressure_sensor_1": _pressure(0.3),
    "pressure_sensor_2": _pressure(-0.2),
    "pressure_sensor_3": _pressure(0.1),
    "pitot": _pitot,
    "elevator_angle_sensor": _angle_of("elevator"),
    "wing_pressure_sensor": _wing_pressure,
    "uv_sensor": _ultraviolet,
    "battery": _battery,
    "camera": _camera,
    "command_receiver": _commands,
    "console": _commands,
    "receiver": _chute_command,
}


def felt_by(device: str) -> frozenset[str]:
    """Return the names of the mechanisms on which a device's reading depends."""
    felt: set[str] = set()

    def feel(mechanism: str) -> float:
        felt.add(mechanism)
        return 0.0

    reading(Surroundings(device, 0, moment(0), feel, feel))
    return frozenset(felt)


def reading(surroundings: Surroundings) -> Value:
    """Return the reading of a healthy device; 0.0 for a device that is not in `SENSORS`."""
    sensor = SENSORS.get(surroundings.device)
    return sensor(surroundings) if sensor is not None else 0.0
