"""The plant: the physical world that the simulated devices of one process read and move.

Most of the world is a script that depends only on the time since take-off (flight.py). A few mechanisms depend on
actuators: the surfaces, the airframe that follows them, the gas in the wings.

Each process has one `Plant`. The plants share only the time of take-off, on one monotonic clock. A plant gets the
commands to the actuators of its own PE by `write`. It gets the commands to the actuators of other PEs by `heard`, from
output echoes on the bus:

- if an echo is lost or late, the mechanism lags in this plant until the next echo, which follows in the next period;
- if an echo arrives twice, it moves the mechanism to the same position, so nothing changes;
- after a restart the script is right immediately, and a mechanism is right some tenths of a second after the first
  echo.

A device is healthy until `fail` is called. Other plants do not learn of the failure, so a device must be failed in the
process of the PE to which it is connected. An actuator that is dead, stuck or loose is not echoed (`write` returns
None), so no other plant moves it.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from heronry_agent.module import Value
from heronry_tools.aircraft.plant import flight
from heronry_tools.aircraft.plant.devices import (
    GPS_PERIOD_NS,
    PUSHED_BY,
    SENSORS,
    WING_SUPPLY_HPA,
    Surroundings,
    felt_by,
    reading,
)
from heronry_tools.aircraft.plant.interface import Failure, PlantDevice
from heronry_tools.aircraft.plant.mechanism import Mechanism


@dataclass(frozen=True, slots=True)
class _Fault:
    how: Failure
    frozen: Value | None  # the reading that a stuck sensor repeats
    offset: float


class Plant:
    """The world as the devices of one process read and move it; take-off is at `origin_ns` of the monotonic clock."""

    every_echo = True  # the plants of other processes follow each command to an actuator of this one

    def __init__(self, origin_ns: int) -> None:
        self._origin_ns = origin_ns
        self._faults: dict[str, _Fault] = {}
        self._positions: dict[str, Value] = {}  # the last command of each actuator, by device
        self._mechanisms = {
            "elevator": Mechanism(rise_s=0.08, fall_s=0.08),
            "rudder": Mechanism(rise_s=0.08, fall_s=0.08),
            "pitching": Mechanism(rise_s=0.5, fall_s=0.5),
            "rolling": Mechanism(rise_s=0.8, fall_s=0.8),
            "wing": Mechanism(rise_s=6.0, fall_s=1800.0),
        }

    def open(self, name: str) -> PlantDevice:
        """Return the object through which a device driver reads or moves a device."""
        return PlantDevice(self, name)

    def read(self, device: str, now_ns: int) -> Value | None:
        """Return the present reading of a device; None if it does not answer. An actuator gives its last command."""
        fault = self._faults.get(device)
        if fault is None:
            return self._healthy_reading(device, now_ns)
        match fault.how:
            case "dead":
                return None
            case "stuck" | "loose":  # the script has no forces that would move what is loose
                return fault.frozen
            case "bias":
                return _shifted(self._healthy_reading(device, now_ns), fault.offset)

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:
        """Move an actuator of this PE; give the position that it takes, for the echo, or None if it does not move."""
        fault = self._faults.get(device)
        if fault is not None:
            if fault.how != "bias":
                return None
            value = _shifted(value, fault.offset)
        self._move(device, value, now_ns)
        return value

    def make_safe(self, device: str, now_ns: int) -> None:
        """Do nothing: without a command an actuator of this plant stays where it is."""

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Move an actuator to the value that its output echo shows.

        No effect if the actuator is dead, stuck or loose in this plant; a biased one takes the value as it is.
        """
        fault = self._faults.get(device)
        if fault is None or fault.how == "bias":
            self._move(device, value, now_ns)

    @staticmethod
    def follows(sensors: Iterable[str]) -> frozenset[str]:
        """Return the actuators that change what these sensors measure.

        A plant with these sensors needs the output echoes of those actuators that are on other PEs.
        """
        felt = {mechanism for sensor in sensors for mechanism in felt_by(sensor)}
        return frozenset(actuator for actuator, pushed in PUSHED_BY.items() if not felt.isdisjoint(pushed))

    def position(self, device: str) -> Value | None:
        """Return the last command to an actuator, by `write` or `heard`; None if there was none."""
        return self._positions.get(device)

    def fail(self, device: str, how: Failure, now_ns: int, offset: float = 0.0) -> None:
        """Make a device fail.

        how             a sensor                              an actuator
        dead            gives no reading                      no longer moves anything
        stuck, loose    keeps its present reading             no longer moves anything
        bias            its reading is wrong by `offset`      its position is wrong by `offset`

        offset: in the device's own unit.
        """
        self._faults[device] = _Fault(how, self.read(device, now_ns), offset)

    def heal(self, device: str) -> None:
        """End a device's failure; no effect on a healthy device."""
        self._faults.pop(device, None)

    def _healthy_reading(self, device: str, now_ns: int) -> Value:
        if device not in SENSORS and device in self._positions:
            return self._positions[device]
        time_ns = max(now_ns - self._origin_ns, 0)
        if device == "gps":
            time_ns -= time_ns % GPS_PERIOD_NS  # a receiver repeats its last fix until it has a new one

        def position(name: str) -> float:
            return self._mechanisms[name].position(now_ns, self._resting(name, now_ns))

        def rate(name: str) -> float:
            return self._mechanisms[name].rate_per_s(now_ns, self._resting(name, now_ns))

        return reading(Surroundings(device, time_ns, flight.moment(time_ns), position, rate))

    def _resting(self, name: str, now_ns: int) -> float:
        return flight.wing_pressure_hpa(now_ns - self._origin_ns) if name == "wing" else 0.0

    def _move(self, device: str, value: Value, now_ns: int) -> None:
        for name in PUSHED_BY.get(device, ()):
            if not isinstance(value, (int, float)):
                raise TypeError(f"{device} needs a number as its command, not {value!r}")
            target = WING_SUPPLY_HPA * value if name == "wing" else float(value)
            self._mechanisms[name].push(target, now_ns, self._resting(name, now_ns))
        self._positions[device] = value


def _shifted(value: Value, offset: float) -> Value:
    """Add an offset to a number, or to each number of a tuple; an integer stays an integer, a text stays unchanged."""
    match value:
        case bool() | str() | bytes():
            return value
        case int():
            return value + round(offset)
        case float():
            return value + offset
        case tuple():
            return tuple(item + round(offset) for item in value)
