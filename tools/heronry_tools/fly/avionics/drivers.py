"""Modules that read the sensors and command the actuators of the EAV and its rover.

The modules convert the whole numbers of a device to data in SI units and degrees. If a sensor does not answer, its
module publishes no datum. If the module of a servo gets no demand, it repeats its last command; before the first demand
it sends nothing. The camera's module also reports the camera as failed after `BLIND_NS` without a new image.

A restart loses the last command of a servo. After a restart, the camera's module publishes the newest image once more.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number

BLIND_NS = 2_000_000_000
_INERTIAL = (
    "roll_rate",
    "pitch_rate",
    "yaw_rate",
    "roll_angle",
    "pitch_angle",
    "velocity_north",
    "velocity_east",
    "velocity_up",
)


class InertialUnit(Module):
    """Publishes what an inertial unit measures: angular rates (deg/s), attitude (deg), velocity (m/s)."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 (a driver has no inputs)
        """Publish what the unit has measured."""
        reading = self.ctx.read()
        if not isinstance(reading, tuple) or len(reading) != len(_INERTIAL):
            return {}
        return {name: value / 1000.0 for name, value in zip(_INERTIAL, reading, strict=True)}


class Pitot(Module):
    """Publishes the airspeed (m/s)."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002
        """Publish the airspeed."""
        reading = self.ctx.read()
        return {"airspeed": float(reading)} if isinstance(reading, (int, float)) else {}


class _Receiver(Module):
    names: ClassVar[tuple[str, str, str]]

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002
        """Publish the position."""
        reading = self.ctx.read()
        if not isinstance(reading, tuple) or len(reading) != len(self.names):
            return {}
        return {name: value / 1000.0 for name, value in zip(self.names, reading, strict=True)}


class DifferentialReceiver(_Receiver):
    """Publishes the position from the receiver that uses differential corrections, in m in the runway's frame."""

    names = ("differential_x", "differential_y", "differential_height")


class SatelliteReceiver(_Receiver):
    """Publishes the position measured without differential corrections, in the runway's frame (m)."""

    names = ("gps_x", "gps_y", "gps_height")


class CameraImages(Module):
    """Publishes where the rover's camera sees the aircraft.

    For each new image: azimuth and elevation of the aircraft (0.1 mrad), and the age of the image (ms).
    """

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._last_ns: int | None = None  # exposure of the last image
        self._seen_ns = ctx.now_ns  # time of the last new image, or of the start

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002
        """Publish each new image once."""
        now_ns = self.ctx.now_ns
        reading = self.ctx.read()
        if isinstance(reading, tuple) and len(reading) == 3:
            azimuth, elevation, age_ms = reading
            exposed_ns = now_ns - age_ms * 1_000_000
            if self._last_ns is None or exposed_ns - self._last_ns > 20_000_000:
                self._last_ns, self._seen_ns = exposed_ns, now_ns
                return {"image_angles": (azimuth, elevation), "image_age": age_ms}
        if now_ns - self._seen_ns > BLIND_NS:
            self.ctx.report_failed(f"device:{self.ctx.device}")
        return {}


class HeadEncoder(Module):
    """Publishes the direction in which the rover's head points: azimuth and elevation (0.1 mrad)."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002
        """Publish azimuth and elevation of the head; publish nothing if the reading does not have both."""
        reading = self.ctx.read()
        return {"head_angles": reading} if isinstance(reading, tuple) and len(reading) == 2 else {}


class SurfaceSensor(Module):
    """Publishes the position of a control surface; the sensor measures in the unit of the datum."""

    names: ClassVar[str]

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002
        """Publish the measured position of the surface; publish nothing if the sensor gives no number."""
        reading = self.ctx.read()
        return {self.names: float(reading)} if isinstance(reading, (int, float)) else {}


class ElevatorSensor(SurfaceSensor):
    """Publishes the angle of the elevator (deg, positive down)."""

    names = "elevator_angle"


class AileronSensor(SurfaceSensor):
    """Publishes the angle of the aileron (deg, positive for a roll to the right)."""

    names = "aileron_angle"


class RudderSensor(SurfaceSensor):
    """Publishes the angle of the rudder (deg, positive for a yaw to the left)."""

    names = "rudder_angle"


class ThrottleSensor(SurfaceSensor):
    """Publishes the position of the throttle, 0 to 1."""

    names = "throttle_position"


class _Servo(Module):
    demand: ClassVar[str]
    limit: ClassVar[float] = 25.0
    echo: ClassVar[str]

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._command: float | None = None

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Command the servo to the demanded position; without a demand, repeat the last command."""
        demand = number(inputs, self.demand)
        if demand is not None:
            self._command = held(demand, self.limit)
        if self._command is None:
            return {}
        self.ctx.write(self._command)
        return {self.echo: self._command}


class ElevatorServo(_Servo):
    """Drives an elevator servo: angle in deg, positive down."""

    demand, echo = "elevator_demand", "elevator_command"


class AileronServo(_Servo):
    """Drives an aileron servo: angle in deg, positive for a roll to the right."""

    demand, echo, limit = "aileron_demand", "aileron_command", 20.0


class RudderServo(_Servo):
    """Drives a rudder servo: angle in deg, positive for a yaw to the left."""

    demand, echo = "rudder_demand", "rudder_command"


class Throttle(_Servo):
    """Drives a throttle servo: share of full thrust, 0 to 1."""

    demand, echo, limit = "throttle_demand", "throttle_command", 1.0


class PanTilt(Module):
    """Drives the rover's head in the commanded direction."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Command the head to the demanded direction; without a demand, command nothing."""
        datum = inputs.get("head_demand")
        if datum is not None and isinstance(datum.value, tuple):
            self.ctx.write(datum.value)
        return {}
