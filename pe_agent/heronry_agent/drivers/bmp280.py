"""Driver `bmp280`: Bosch's barometer BMP280 on I2C, after its data sheet (BST-BMP280-DS001).

Registers: D0h chip_id (58h), 88h to 9Fh calibration (twelve words, little-endian), F3h status (bit 3: measuring), F4h
ctrl_meas (oversampling of temperature and pressure, mode), F7h to FCh pressure and temperature, 20 bits each, the
highest first. The compensation is that of section 8.1, in double precision. The reading is the pressure in hPa.
"""

import struct
import time
from typing import ClassVar, NamedTuple

from heronry_agent.device_driver import NotConnectedError, Option, SensorDriver, Setup
from heronry_agent.drivers.i2c_chip import BUS, Chip, SmbusChip

CHIP_ID, CALIBRATION, STATUS, CONTROL, DATA = 0xD0, 0x88, 0xF3, 0xF4, 0xF7
ID = 0x58
_CALIBRATION_BYTES, _DATA_BYTES = 24, 6
_FORCED = 0b001_011_01  # temperature x1, pressure x4, one measurement
_MEASURING = 0b1000
_LONGEST_S = 0.05  # section 3.8.1: 13.3 ms at x4
_SKIPPED = 0x80000  # a measurement that was not made


class Calibration(NamedTuple):
    """The words dig_T1 to dig_P9."""

    t1: int
    t2: int
    t3: int
    p1: int
    p2: int
    p3: int
    p4: int
    p5: int
    p6: int
    p7: int
    p8: int
    p9: int

    @staticmethod
    def of(data: bytes) -> "Calibration":
        """Read the 24 bytes from 88h on."""
        return Calibration(*struct.unpack("<HhhH8h", data))


def temperature(calibration: Calibration, raw: int) -> tuple[float, float]:
    """Return the temperature in degrees Celsius, and the fine temperature that the pressure needs."""
    c = calibration
    first = (raw / 16_384 - c.t1 / 1_024) * c.t2
    second = (raw / 131_072 - c.t1 / 8_192) ** 2 * c.t3
    return (first + second) / 5_120, first + second


def pressure_hpa(calibration: Calibration, raw_pressure: int, raw_temperature: int) -> float | None:
    """Return the pressure in hPa; None if the chip has measured nothing, or its calibration is empty."""
    c = calibration
    if _SKIPPED in (raw_pressure, raw_temperature):
        return None
    half = temperature(c, raw_temperature)[1] / 2 - 64_000
    offset = half**2 * c.p6 / 32_768
    offset = (offset + half * c.p5 * 2) / 4 + c.p4 * 65_536
    slope = (c.p3 * half**2 / 524_288 + c.p2 * half) / 524_288
    slope = (1 + slope / 32_768) * c.p1
    if slope == 0:
        return None
    pascal = (1_048_576 - raw_pressure - offset / 4_096) * 6_250 / slope
    pascal += (c.p9 * pascal**2 / 2_147_483_648 + pascal * c.p8 / 32_768 + c.p7) / 16
    return pascal / 100


def raw_of(data: bytes) -> tuple[int, int]:
    """Return raw pressure and raw temperature, from the six bytes from F7h on."""
    return int.from_bytes(data[0:3]) >> 4, int.from_bytes(data[3:6]) >> 4


class Bmp280(SensorDriver):
    """The chip."""

    OPTIONS: ClassVar = {
        "bus": BUS,
        "address": Option("Address of the chip: 118 (76h) or 119 (77h).", int, 0x76, choices=(0x76, 0x77)),
    }

    def __init__(self, setup: Setup, chip: Chip | None = None) -> None:
        super().__init__(setup)
        self._chip = chip or SmbusChip(setup.options["bus"], setup.options["address"])
        (found,) = self._chip.read(CHIP_ID, 1)
        if found != ID:
            raise NotConnectedError(
                f"the chip at address {setup.options['address']} is no BMP280: its ID is {found:02X}h"
            )
        self._calibration = Calibration.of(self._chip.read(CALIBRATION, _CALIBRATION_BYTES))

    def read(self) -> float | None:
        """Have the chip measure once, wait for it, and return the pressure in hPa."""
        self._chip.write(CONTROL, _FORCED)
        end_s = time.monotonic() + _LONGEST_S
        while True:
            time.sleep(0.01)
            (status,) = self._chip.read(STATUS, 1)
            if not status & _MEASURING:
                return pressure_hpa(self._calibration, *raw_of(self._chip.read(DATA, _DATA_BYTES)))
            if time.monotonic() > end_s:
                return None

    def close(self) -> None:
        """Close the bus."""
        self._chip.close()
