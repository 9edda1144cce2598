"""The drivers of the sensors: modules that convert the readings of their devices to variables in their units.

A driver also decides whether its device has failed. A device is reported as `device:...` if it was silent, or
gave impossible readings, for half a second. The report is repeated every half second, since the operator may
have cleared the fault. The half second covers a device that is still starting when its driver starts. In a
period without a valid reading the driver publishes nothing: readers must not take an old value for a new one.

The readings of some devices always differ, by their noise at least. Such a device is stuck if it repeats one
reading for too long (`may_repeat_ns`), and this reading counts as impossible. So the "static hold" of a
satellite receiver, if it has any, must be off.

A restart loses only two counts: of the periods without a valid reading, and of the repeated readings.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting, steps_of

_SILENCE_NS = 500_000_000
_MAY_REPEAT_FIX_NS = 3_000_000_000  # two missing fixes of a slow receiver, which has one per second
_ULONG_MASK = 0xFFFF_FFFF
_SHORT_LIMIT = 32_767


class SensorDriver(Module):
    """Reads its device once per period; a subclass converts the reading.

    may_repeat_ns: how long a healthy device may repeat one reading; None: without end
    """

    may_repeat_ns: ClassVar[int | None] = None

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._silence = Lasting(_SILENCE_NS, ctx.period_ns)
        self._last: Value | None = None
        self._repeated = 0  # steps with the same reading as the step before
        self._stuck = None if self.may_repeat_ns is None else steps_of(self.may_repeat_ns, ctx.period_ns)

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 (a sensor's driver has none)
        """Publish the converted reading, or nothing without a valid reading; report a device that has failed."""
        raw = self.ctx.read()
        given = None if raw is None or self._is_stuck(raw) else self.convert(raw)
        if self._silence.is_due(given is None):
            self.ctx.report_failed(f"device:{self.ctx.device}")
        return {} if given is None else given

    def convert(self, raw: Value) -> Mapping[str, Value] | None:
        """Convert a reading to values by variable; None if the reading is impossible for this device."""
        raise NotImplementedError

    def _is_stuck(self, raw: Value) -> bool:
        if self._stuck is None:
            return False
        self._repeated = self._repeated + 1 if raw == self._last else 0
        self._last = raw
        return self._repeated >= self._stuck


class NumberSensor(SensorDriver):
    """A device with one number as its reading, which is published in the same unit."""

    variable: ClassVar[str]

    def convert(self, raw: Value) -> Mapping[str, Value] | None:
        """Return the number as the value of `variable`; None if the reading is not a number."""
        return {self.variable: float(raw)} if isinstance(raw, (int, float)) else None


class TupleSensor(SensorDriver):
    """A device whose reading is several integers.

    `fields` gives for each integer, in order, its variable and the units per count. An integer whose variable is None
    is not used.
    """

    fields: ClassVar[tuple[tuple[str | None, float], ...]]

    def convert(self, raw: Value) -> Mapping[str, Value] | None:
        """Convert the integers of a reading to the units of their variables; integers without a variable are left out.

        None if the reading is no tuple, or does not have one integer for each entry of `fields`.
        """
        if not isinstance(raw, tuple) or len(raw) != len(self.fields):
            return None
        return {variable: count * unit for (variable, unit), count in zip(self.fields, raw, strict=True) if variable}


class InertialUnit(TupleSensor):
    """Rate gyros and accelerometers; counts of 0.001 deg/s and 0.001 g."""

    fields = (
        ("pitch_rate", 1e-3),
        ("roll_rate", 1e-3),
        ("longitudinal_acceleration", 1e-3),
        ("lateral_acceleration", 1e-3),
    )


class RateGyros(TupleSensor):
    """Rate gyros without accelerometers; they give pitch rate and roll rate in counts of 0.001 deg/s."""

    fields = (("pitch_rate", 1e-3), ("roll_rate", 1e-3))


class GpsReceiver(TupleSensor):
    """The GPS receiver: gives latitude and longitude in 1e-7 deg, height in mm, and track in 1e-5 deg."""

    may_repeat_ns = _MAY_REPEAT_FIX_NS
    fields = (("gps_latitude", 1e-7), ("gps_longitude", 1e-7), ("gps_altitude", 1e-3), ("gps_track", 1e-5))


class GpsAltitude(TupleSensor):
    """The GPS receiver in a spec that uses only the height of the receiver."""

    may_repeat_ns = _MAY_REPEAT_FIX_NS
    fields = ((None, 1e-7), (None, 1e-7), ("gps_altitude", 1e-3), (None, 1e-5))


class Horizon(SensorDriver):
    """The horizon sensor (thermopiles): a pair of contrasts, along and across the aircraft, in counts."""

    def convert(self, raw: Value) -> Mapping[str, Value] | None:
        """Return both contrasts, along and across the aircraft, in counts limited to -32767..32767 (SHORT).

        None if the reading is not a pair.
        """
        if not isinstance(raw, tuple) or len(raw) != 2:
            return None
        return {"horizon_contrast": tuple(min(max(count, -_SHORT_LIMIT), _SHORT_LIMIT) for count in raw)}


class Barometer(NumberSensor):
    """Static pressure in hPa, from the barometer of the aircraft `elevator_and_chute`."""

    variable = "absolute_pressure"


class PressureSensor1(NumberSensor):
    """The first of three static pressures, in hPa."""

    variable = "pressure_1"


class PressureSensor2(NumberSensor):
    """The second of three static pressures, in hPa."""

    variable = "pressure_2"


class PressureSensor3(NumberSensor):
    """The third of three static pressures, in hPa."""

    variable = "pressure_3"


class Pitot(NumberSensor):
    """Total minus static pressure, in hPa."""

    variable = "differential_pressure"


class ElevatorAngle(NumberSensor):
    """The measured angle of the elevator, in degrees, down positive."""

    variable = "elevator_angle"


class WingPressure(NumberSensor):
    """Gas pressure in the wings, in hPa above the air outside."""

    variable = "wing_pressure"


class Ultraviolet(NumberSensor):
    """Irradiance of the light that cures the wings, in W/m2."""

    variable = "uv_irradiance"


class Battery(NumberSensor):
    """Voltage of the battery, in V."""

    variable = "battery_voltage"


class Camera(SensorDriver):
    """Publishes how many frames the camera has taken since it was switched on."""

    def convert(self, raw: Value) -> Mapping[str, Value] | None:
        """Return the number of frames that the camera has taken, modulo 2^32; None if the reading is no int."""
        return {"frame_count": raw & _ULONG_MASK} if isinstance(raw, int) else None


class CommandReceiver(SensorDriver):
    """Two commands: open the parachute, cut the balloon's line; 1 is yes."""

    def convert(self, raw: Value) -> Mapping[str, Value] | None:
        """Return the command to open the parachute and the command to cut the line, each as 0 or 1.

        None if the reading is not a pair.
        """
        if not isinstance(raw, tuple) or len(raw) != 2:
            return None
        return {"release_command": int(raw[0] != 0), "cutdown_command": int(raw[1] != 0)}


class Console(CommandReceiver):
    """Publishes the two commands of `CommandReceiver`, which come from switches of the console on the ground."""


class ChuteReceiver(SensorDriver):
    """The receiver of the aircraft `elevator_and_chute`; its only command opens the parachute (1) or not (0)."""

    def convert(self, raw: Value) -> Mapping[str, Value] | None:
        """Return the command as 0 or 1; None if the reading is not a number."""
        return {"release_command": int(raw != 0)} if isinstance(raw, (int, float)) else None
