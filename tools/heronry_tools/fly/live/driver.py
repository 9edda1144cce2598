"""The device driver of a flight in real time: readings from the plant process, commands to it.

The plant process of the flight has a folder, which the environment variable HERONRY_FLIGHT names: `readings` is shared
memory, `commands` a datagram socket. So no call waits for the plant process, however busy the computer is.
"""

import json
import os
import socket
from collections.abc import Iterable, Mapping
from pathlib import Path

from heronry_agent.device import Reading
from heronry_agent.module import Value
from heronry_tools.fly.live.shared_readings import Reader

FOLDER = "HERONRY_FLIGHT"
READINGS, COMMANDS = "readings", "commands"
_OLDEST_NS = 500_000_000  # readings of a plant process that is gone are none


class FlightDevice:
    """One device of the plant process."""

    def __init__(self, driver: "FlightDriver", name: str) -> None:
        self._driver, self._name = driver, name

    def read(self, now_ns: int) -> Reading:
        """Give the newest reading; None from a device that does not answer, or without a plant process."""
        snapshot = self._driver.reader.newest()
        value = snapshot.readings.get(self._name)
        if now_ns - snapshot.time_ns > _OLDEST_NS:
            value = None
        return Reading(value, snapshot.time_ns, value is not None)

    def command(self, value: Value, now_ns: int) -> Value | None:  # noqa: ARG002 - the plant process has a clock
        """Send a command; None from an actuator that takes none, or where the plant process does not listen."""
        if self._name in self._driver.reader.newest().refusing or not self._driver.send(self._name, value):
            return None
        return value

    def make_safe(self, now_ns: int) -> None:
        """Do nothing: without a command a servo holds its angle."""


class FlightDriver:
    """Opens the devices of one PE."""

    def __init__(self, origin_ns: int, environment: Mapping[str, str] = os.environ) -> None:  # noqa: ARG002
        """Raises KeyError where no flight is named, and FileNotFoundError where it has no plant process."""
        folder = Path(environment[FOLDER])
        self.reader = Reader(folder / READINGS)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.connect(str(folder / COMMANDS))

    def open(self, name: str) -> FlightDevice:
        """Give a device."""
        return FlightDevice(self, name)

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:  # noqa: ARG002
        """Give the actuators whose echoes are needed: none, as one plant moves everything itself."""
        return frozenset()

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Ignore an echo."""

    def send(self, device: str, value: Value) -> bool:
        """Send a command; False where it could not be sent at once."""
        try:
            self._socket.send(json.dumps([device, value]).encode())
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close the socket; the agent ends with its driver open."""
        self._socket.close()
