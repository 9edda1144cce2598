"""The device driver of a flight in real time: it gets readings from the plant process, and sends commands to it.

The plant process has a folder, which the environment variable HERONRY_FLIGHT names. In the folder, `readings` is shared
memory and `commands` is a datagram socket, so no call waits for the plant process, however busy the computer is.
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
_OLDEST_NS = 500_000_000  # an older reading is not used: the plant process has stopped


class FlightDevice:
    """One sensor or actuator of the plant process."""

    def __init__(self, driver: "FlightDriver", name: str) -> None:
        self._driver, self._name = driver, name

    def read(self, now_ns: int) -> Reading:
        """Return the newest reading.

        Its value is None if the device does not answer or the plant process has stopped.
        """
        snapshot = self._driver.reader.newest()
        value = snapshot.readings.get(self._name)
        if now_ns - snapshot.time_ns > _OLDEST_NS:
            value = None
        return Reading(value, snapshot.time_ns, value is not None)

    def command(self, value: Value, now_ns: int) -> Value | None:  # noqa: ARG002 - the plant process has a clock
        """Send a command and return it; None if the actuator accepts no command or the command could not be sent."""
        if self._name in self._driver.reader.newest().refusing or not self._driver.send(self._name, value):
            return None
        return value

    def make_safe(self, now_ns: int) -> None:
        """Do nothing: a servo holds its angle without a command."""


class FlightDriver:
    """Gives one PE its devices in the plant process."""

    def __init__(self, origin_ns: int, environment: Mapping[str, str] = os.environ) -> None:  # noqa: ARG002
        """Find the plant process.

        Raises KeyError if HERONRY_FLIGHT is not set, and FileNotFoundError if the plant process has not made its files.
        """
        folder = Path(environment[FOLDER])
        self.reader = Reader(folder / READINGS)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.connect(str(folder / COMMANDS))

    def open(self, name: str) -> FlightDevice:
        """Return the sensor or actuator of this name."""
        return FlightDevice(self, name)

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:  # noqa: ARG002
        """Return the actuators of which this driver needs output echoes: none.

        The plant process itself gets every command.
        """
        return frozenset()

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Ignore an output echo: the plant process itself gets every command."""

    def send(self, device: str, value: Value) -> bool:
        """Send a command; return False if it could not be sent at once."""
        try:
            self._socket.send(json.dumps([device, value]).encode())
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close the socket for commands."""
        self._socket.close()
