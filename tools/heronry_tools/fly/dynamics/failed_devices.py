"""What a device of a plant reads after it has failed; servos have their own failures (`servos`)."""

from collections.abc import Callable

from heronry_agent.module import Value
from heronry_tools.aircraft.plant.interface import Failure


class FailedDevices:
    """The devices that have failed, by name."""

    def __init__(self) -> None:
        self._failed: dict[str, tuple[Failure, Value | None, float]] = {}

    def __contains__(self, device: str) -> bool:
        return device in self._failed

    def fail(self, device: str, how: Failure, reading: Value, offset: float) -> None:
        """Make a device fail; `reading`: its present one, `offset`: of a bias, in the unit of the device."""
        self._failed[device] = how, reading, offset

    def heal(self, device: str) -> None:
        """Repair a device."""
        self._failed.pop(device, None)

    def read(self, device: str, true: Callable[[], Value]) -> Value | None:
        """Return what a device reads, where it would read `true()`; None if it does not answer."""
        if device not in self._failed:
            return true()
        how, frozen, offset = self._failed[device]
        match how:
            case "dead":
                return None
            case "bias":
                return _shifted(true(), offset)
            case _:
                return frozen


def _shifted(value: Value, offset: float) -> Value:
    """Return a number plus `offset`, a whole one plus the rounded `offset`, as in a tuple; else the value itself."""
    if isinstance(value, tuple):
        return tuple(item + round(offset) for item in value)
    if isinstance(value, int):
        return value + round(offset)
    return value + offset if isinstance(value, float) else value
