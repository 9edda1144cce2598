"""The device table of the two shipped specs: what each sensor measures, and what each actuator moves.

The aircraft reacts to its surfaces. Pitch and roll are those of the script plus a share of the elevator's and the
rudder's angle. The share falls with the speed of the air, and the airframe adds a lag. On the balloon's line there is
hardly any flow, so the surfaces have no effect.

A sensor's reading is the value that the real device gives to its driver, in its own units: an inertial unit and a GPS
receiver give integers, a pressure transducer hectopascals. Noise and bias are as large as those of such devices.

A device that is not in the table works all the same: a sensor reads 0.0, an actuator keeps its last command.
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
HORIZON_COUNTS = 1000  # contrast of a horizon that stands upright
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
    """The aircraft's state on which readings depend: that of the script (`flight.Moment`), or of a dynamics model."""

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
    """The conditions of a reading: the sensor's name, the time since take-off, the flight, and the mechanisms.

    Positions are in the units of each mechanism (deg, hPa), rates in these units per second.
    """

    device: str
    time_ns: int
    now: Motion
    position: Callable[[str], float]  # of a mechanism
    rate: Callable[[str], float]
    seed: int | None = None  # of the noise; None: that of the scripted flight

    @property
    def attitude_deg(self) -> tuple[float, float]:
        """Pitch and roll, with the effect of the surfaces."""
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
        """Add the noise of this device and axis at this time; devices and axes are independent of each other."""
        name = self.device + axis
        return value + sigma * noise(name if self.seed is None else f"{self.seed}/{name}", self.time_ns)


Sensor = Callable[[Surroundings], Value]


def _inertial_unit(around: Surroundings) -> tuple[int, ...]:
    """Pitch and roll rate in 0.001 deg/s, longitudinal and lateral acceleration in 0.001 g."""
    pitch, roll = (math.radians(angle) for angle in around.attitude_deg)
    pitch_rate, roll_rate = around.body_rates_deg_per_s
    return (
        round(1000.0 * around.with_noise(pitch_rate, 0.1, "q")),
        round(1000.0 * around.with_noise(roll_rate, 0.1, "p")),
        round(1000.0 * around.with_noise(math.sin(pitch), 0.01, "x")),
        round(1000.0 * around.with_noise(-math.sin(roll) * math.cos(pitch), 0.01, "y")),
    )


def _rate_gyros(around: Surroundings) -> tuple[int, ...]:
    """Pitch and roll rate in 0.001 deg/s: noisier than those of the inertial unit, and never quite zero."""
    pitch_rate, roll_rate = around.body_rates_deg_per_s
    return (
        round(1000.0 * around.with_noise(pitch_rate + 0.05, 0.3, "q")),
        round(1000.0 * around.with_noise(roll_rate - 0.04, 0.3, "p")),
    )


def _horizon(around: Surroundings) -> tuple[int, ...]:
    """Contrast between warm ground and cold sky, along and across, in counts."""
    along, across = (math.sin(math.radians(angle)) for angle in around.attitude_deg)
    return (
        round(HORIZON_COUNTS * around.with_noise(along, 0.06, "x")),
        round(HORIZON_COUNTS * around.with_noise(across, 0.06, "y")),
    )


def _gps(around: Surroundings) -> tuple[int, ...]:
    """Latitude and longitude in 1e-7 deg, height in mm, track in 1e-5 deg: integers, as receivers report them."""
    return (
        round(1e7 * around.with_noise(around.now.latitude_deg, 2e-5, "n")),
        round(1e7 * around.with_noise(around.now.longitude_deg, 2e-5, "e")),
        round(1e3 * around.with_noise(around.now.altitude_m, 4.0, "u")),
        round(1e5 * around.now.track_deg),
    )


def _pressure(bias_hpa: float) -> Sensor:
    """Give a static pressure transducer, in hPa, with this bias."""

    def read(around: Surroundings) -> float:
        return max(around.with_noise(atmosphere.pressure_hpa(around.now.altitude_m) + bias_hpa, 0.02), 0.0)

    return read


def _pitot(around: Surroundings) -> float:
    return around.with_noise(atmosphere.differential_hpa(around.now.airspeed_m_per_s), 0.005)


def _angle_of(mechanism: str) -> Sensor:
    """Give a potentiometer on a surface, in degrees."""

    def read(around: Surroundings) -> float:
        return around.with_noise(around.position(mechanism), 0.05)

    return read


def _wing_pressure(around: Surroundings) -> float:
    return max(around.with_noise(around.position("wing"), 1.0), 0.0)


def _ultraviolet(around: Surroundings) -> float:
    """UV irradiance in W/m2: it grows with the share of the atmosphere that lies below."""
    above = atmosphere.pressure_hpa(around.now.altitude_m) / atmosphere.SEA_LEVEL_PRESSURE_HPA
    return max(around.with_noise(55.0 - 35.0 * above, 0.5), 0.0)


def _battery(around: Surroundings) -> float:
    return around.with_noise(12.6 - 0.004 * around.now.time_s, 0.01)


def _camera(around: Surroundings) -> int:
    return around.time_ns * CAMERA_FRAMES_PER_S // NS_PER_S


def _commands(around: Surroundings) -> tuple[int, ...]:
    """Commands to release the parachute, and to cut the balloon's line; the ground gives the second at CUTDOWN_S."""
    return (0, int(around.now.time_s >= CUTDOWN_S))


def _chute_command(_around: Surroundings) -> int:
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
    """Give the mechanisms on which a device's reading depends."""
    felt: set[str] = set()

    def feel(mechanism: str) -> float:
        felt.add(mechanism)
        return 0.0

    reading(Surroundings(device, 0, moment(0), feel, feel))
    return frozenset(felt)


def reading(around: Surroundings) -> Value:
    """Give the reading of a healthy device; 0.0 for one that is not in the table."""
    sensor = SENSORS.get(around.device)
    return sensor(around) if sensor is not None else 0.0
