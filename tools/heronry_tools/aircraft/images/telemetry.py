"""Outputs of the flight's data: telemetry for the radio, the display on the ground, the recorder on board.

Telemetry repeats its present inputs at the rate of its mode and omits the missing ones, so that a value that is missing
on board is missing on the ground, too. The status always has four bytes; a byte is 255 if its value is missing. Display
and recorder write one line of text per period: `name=value` for each present input, in a fixed order. A restart loses
nothing.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Inputs, Module, Value
from heronry_agent.parts.reading import number, numbers, whole

_NS_PER_MS = 1_000_000
_SHORT_LIMIT = 32_767
_NOT_KNOWN = 255
CENTIDEGREES = 100.0
DECIVOLTS = 10.0

_REPEATED = {
    "telemetry_altitude": "altitude",
    "telemetry_latitude": "gps_latitude",
    "telemetry_longitude": "gps_longitude",
    "telemetry_course": "gps_track",
}


class Telemetry(Module):
    """The aircraft's data for the radio: numbers unchanged, attitude in 0.01 deg, and four bytes of status."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the status, and those other data whose inputs are present."""
        given: dict[str, Value] = {
            name: value for name, source in _REPEATED.items() if (value := number(inputs, source)) is not None
        }
        angles = [number(inputs, "pitch_angle"), number(inputs, "roll_angle")]
        known = [angle for angle in angles if angle is not None]
        if len(known) == 2:
            given["telemetry_attitude"] = tuple(_centidegrees(angle) for angle in known)
        given["telemetry_status"] = _status(inputs)
        return given


def _centidegrees(angle_deg: float) -> int:
    return min(max(round(CENTIDEGREES * angle_deg), -_SHORT_LIMIT), _SHORT_LIMIT)


def _status(inputs: Inputs) -> tuple[int, ...]:
    """Return the four bytes of status; a byte is 255 where its value is missing.

    The bytes are the stage of the mission, the state of the wings, the health of the servos, and the battery in 0.1 V.
    """
    voltage = number(inputs, "battery_voltage")
    decivolts = None if voltage is None else round(DECIVOLTS * voltage)
    states = (whole(inputs, name) for name in ("mission_stage", "wing_state", "servo_health"))
    return tuple(_NOT_KNOWN if s is None else min(max(s, 0), _NOT_KNOWN - 1) for s in (*states, decivolts))


class LineWriter(Module):
    """Writes its present inputs to its device as one line of text."""

    columns: ClassVar[tuple[str, ...]]

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Write one line, which begins with the time of the PE in ms."""
        words = [f"{self.ctx.now_ns // _NS_PER_MS}"]
        words += [f"{name}={value:g}" for name in self.columns if (value := number(inputs, name)) is not None]
        self.ctx.write(" ".join(words + self.more_words(inputs)))
        return {}

    def more_words(self, inputs: Inputs) -> list[str]:  # noqa: ARG002 (subclasses may have some)
        """Return further words of the line, for inputs that are no single numbers: none, unless a subclass has some."""
        return []


class FlightRecorder(LineWriter):
    """Writes the state of the flight as lines of text; its device is the recorder on board."""

    columns = (
        "mission_stage",
        "altitude",
        "pitch_angle",
        "roll_angle",
        "indicated_airspeed",
        "true_airspeed",
        "static_pressure",
        "elevator_angle",
        "servo_health",
        "wing_state",
        "battery_voltage",
    )


class GroundDisplay(LineWriter):
    """Writes the telemetry as lines of text to its device, the display on the ground."""

    columns: ClassVar[tuple[str, ...]] = (
        "telemetry_altitude",
        "telemetry_latitude",
        "telemetry_longitude",
        "telemetry_course",
    )

    def more_words(self, inputs: Inputs) -> list[str]:
        """Return pitch and roll in degrees, and those of the four status bytes whose value is known.

        The status bytes are stage, wings, servos and battery. An input that is missing gives no words.
        """
        words = []
        attitude, status = numbers(inputs, "telemetry_attitude", 2), numbers(inputs, "telemetry_status", 4)
        if attitude is not None:
            words.append(f"pitch={attitude[0] / CENTIDEGREES:g} roll={attitude[1] / CENTIDEGREES:g}")
        if status is not None:
            names = ("stage", "wings", "servos", "battery")
            words += [f"{n}={s}" for n, s in zip(names, status, strict=True) if s != _NOT_KNOWN]
        return words
