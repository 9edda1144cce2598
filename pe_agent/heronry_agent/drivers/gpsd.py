"""Driver `gpsd`: a satellite receiver behind the daemon gpsd.

gpsd sends one JSON object in a line, over TCP. After a WATCH command it sends a TPV object for each fix:

    class   "TPV"
    mode    0 or 1 no fix, 2 without altitude, 3 with altitude
    lat, lon   degrees        altMSL, or alt in older versions   m        track   degrees, true

Only a fix of mode 3 gives a position. A connection that ends also ends the process, which then connects again.
"""

import json
import socket
import time
from typing import Any, ClassVar

from heronry_agent.device_driver import Measured, NotConnectedError, Option, SensorDriver, Setup
from heronry_agent.drivers.position import position

LONGEST = 65_536  # bytes of a line; gpsd's longest is below 10 000
_WAIT_S = 0.5
_3D = 3


def watch_command(device: str) -> bytes:
    """Return the command after which gpsd sends its fixes; of one receiver, or of all if `device` is empty."""
    policy: dict[str, Any] = {"enable": True, "json": True}
    if device:
        policy["device"] = device
    return b"?WATCH=" + json.dumps(policy).encode() + b";\n"


def position_of(line: bytes, device: str) -> tuple[int, ...] | None:
    """Return the position that a line of gpsd tells; None if it tells none, or one of another receiver."""
    try:
        told = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(told, dict) or told.get("class") != "TPV" or (device and told.get("device") != device):
        return None
    latitude, longitude = _number(told.get("lat")), _number(told.get("lon"))
    altitude = _number(told.get("altMSL", told.get("alt")))
    if told.get("mode") != _3D or latitude is None or longitude is None or altitude is None:
        return None
    try:
        return position(latitude, longitude, altitude, _number(told.get("track")))
    except (ValueError, OverflowError):
        return None


def _number(told: object) -> float | None:
    return told if isinstance(told, (int, float)) and not isinstance(told, bool) else None


class GpsdLines:
    """Cuts what gpsd sends into lines."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes; returns the lines that they complete."""
        *lines, self._begun = (self._begun + data).split(b"\n")
        if len(self._begun) > LONGEST:
            self._begun = b""
        return [line.strip() for line in lines]


class Gpsd(SensorDriver):
    """The fixes of gpsd."""

    OPTIONS: ClassVar = {
        "host": Option("Computer of gpsd.", str, "127.0.0.1"),
        "port": Option("TCP port of gpsd.", int, 2947, least=1, most=65_535),
        "device": Option("Receiver, if gpsd has several: its name as gpsd tells it.", str, ""),
    }
    SETTLES_MS: ClassVar = 90_000
    WAITS: ClassVar = True

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._device = setup.options["device"]
        self._socket = socket.create_connection((setup.options["host"], setup.options["port"]), timeout=_WAIT_S)
        self._socket.sendall(watch_command(self._device))
        self._lines = GpsdLines()

    def read(self) -> Measured | None:
        """Wait for lines of gpsd; raises NotConnectedError when gpsd has ended."""
        try:
            data = self._socket.recv(LONGEST)
        except TimeoutError:
            return None
        if not data:
            raise NotConnectedError("gpsd has closed the connection; it is tried again")
        found = [position_of(line, self._device) for line in self._lines.feed(data)]
        valid = [one for one in found if one is not None]
        return Measured(valid[-1], time.monotonic_ns()) if valid else None

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()
