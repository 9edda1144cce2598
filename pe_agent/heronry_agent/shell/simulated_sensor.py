"""A simulated sensor that is late as its real counterpart would be: silent for `stale_ms`, it is reported failed.

Only a sensor of which the spec says something (a driver, `stale_ms`, ...) is judged so; then the same spec tells the
same loss on a desk and on an aircraft. `range` is not applied: a plant that does not know the device gives 0.
"""

from heronry_agent.device import Device, Reading
from heronry_agent.module import Value


class SimulatedSensor:
    """A device of a simulating driver, with the deadline of the spec; a `Device` of `heronry_agent.device`."""

    def __init__(self, device: Device, stale_ns: int) -> None:
        """Begin with the first reading that is asked for."""
        self._device, self._stale_ns = device, stale_ns
        self._due_ns: int | None = None

    def read(self, now_ns: int) -> Reading:
        """Return the newest reading; one that is older than `stale_ms` is not valid."""
        reading = self._device.read(now_ns)
        if now_ns - reading.time_ns > self._stale_ns:
            reading = reading._replace(valid=False)
        if self._due_ns is None:
            self._due_ns = now_ns + self._stale_ns
        if reading.valid:
            self._due_ns = reading.time_ns + self._stale_ns
        return reading

    def command(self, value: Value, now_ns: int) -> Value | None:
        """Hand a command on: a sensor that takes any is its driver's affair."""
        return self._device.command(value, now_ns)

    def make_safe(self, now_ns: int) -> None:
        """Hand the order on."""
        self._device.make_safe(now_ns)

    def is_failed(self, now_ns: int) -> bool:
        """Tell whether there was no valid reading for `stale_ms`."""
        return self._due_ns is not None and now_ns > self._due_ns
