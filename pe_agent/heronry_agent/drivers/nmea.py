"""Driver `nmea`: a satellite receiver that sends NMEA 0183 sentences over a serial line.

A sentence is a line `$TTSSS,FIELD,...*HH`: TT the talker (any), SSS the kind, HH the exclusive or of all characters
between `$` and `*`. Two kinds are used:

    GGA   time, latitude, N/S, longitude, E/W, quality, satellites, hdop, altitude above mean sea level, M, ...
    RMC   time, status A/V, latitude, N/S, longitude, E/W, speed, track over ground, date, ...

A GGA with a quality of 1 to 5 gives a position: estimated, manual and simulated ones (6, 7, 8) are not used. The track
is that of the last valid RMC. What is no sentence, is too long, lacks its check sum or has a wrong one is dropped.
"""

import re
import time
from typing import Any, ClassVar

from heronry_agent.device_driver import Measured, Option, SensorDriver, Setup
from heronry_agent.drivers.position import position

LONGEST = 120  # characters of a sentence; the standard allows 82, and some receivers send more
_SENTENCE = re.compile(rb"\$([\x20-\x23\x25-\x29\x2b-\x7e]*)\*([0-9A-Fa-f]{2})")
_DEGREES = re.compile(r"(\d{2,3})(\d{2}(?:\.\d+)?)")
_MEASURED = frozenset("12345")


def fields_of(line: bytes) -> list[str] | None:
    """Return the fields of a sentence, the first of which names talker and kind; None if the line is no sentence."""
    match = _SENTENCE.fullmatch(line.strip())
    if match is None:
        return None
    body, proof = match.groups()
    check = 0
    for byte in body:
        check ^= byte
    return body.decode("ascii").split(",") if check == int(proof, 16) else None


class NmeaPositions:
    """Makes positions from the bytes of a receiver, in pieces of any size."""

    def __init__(self) -> None:
        self._line = b""
        self._track: float | None = None

    def feed(self, data: bytes) -> list[tuple[int, ...]]:
        """Take bytes; returns the positions that they complete, oldest first."""
        *lines, self._line = (self._line + data).split(b"\n")
        self._line = self._line[-LONGEST:]
        found = (self._position(line) for line in lines if len(line) <= LONGEST + 2)
        return [one for one in found if one is not None]

    def _position(self, line: bytes) -> tuple[int, ...] | None:
        fields = fields_of(line)
        if fields is None or len(fields[0]) != 5:
            return None
        try:
            match fields[0][2:], fields:
                case "RMC", [_, _, "A", _, _, _, _, _, track, *_]:
                    self._track = float(track) if track else self._track
                case "GGA", [_, _, latitude, north, longitude, east, quality, _, _, altitude, "M", *_]:
                    if quality in _MEASURED:
                        where = _degrees(latitude, north, "NS"), _degrees(longitude, east, "EW")
                        return position(*where, float(altitude), self._track)
                case _:
                    pass
        except ValueError:
            pass  # a receiver without a fix leaves fields empty
        return None


def _degrees(text: str, half: str, halves: str) -> float:
    """Read an angle such as 4807.038 (48 degrees, 07.038 minutes); raises ValueError."""
    match = _DEGREES.fullmatch(text)
    if match is None or len(half) != 1 or half not in halves or float(match[2]) >= 60:
        raise ValueError(f"{text},{half} is no angle")
    return (int(match[1]) + float(match[2]) / 60) * (1 if half == halves[0] else -1)


class NmeaReceiver(SensorDriver):
    """A satellite receiver on a serial line; needs pyserial."""

    OPTIONS: ClassVar = {
        "port": Option("Serial line, such as /dev/ttyUSB0 or /dev/serial/by-id/...", str),
        "baud_rate": Option("Bits per second.", int, 9600, least=300, most=4_000_000),
    }
    SETTLES_MS: ClassVar = 90_000
    WAITS: ClassVar = True

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        import serial  # noqa: PLC0415 - head of `device_driver`

        options = setup.options
        open_line: Any = serial.serial_for_url
        self._line = open_line(options["port"], options["baud_rate"], timeout=0.2, exclusive=True)
        self._positions = NmeaPositions()

    def read(self) -> Measured | None:
        """Wait for bytes; a line that was pulled out raises an exception of pyserial."""
        data = self._line.read(max(1, self._line.in_waiting))
        found = self._positions.feed(data)
        return Measured(found[-1], time.monotonic_ns()) if found else None

    def close(self) -> None:
        """Close the line."""
        self._line.close()
