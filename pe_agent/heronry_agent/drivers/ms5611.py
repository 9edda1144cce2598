"""Driver `ms5611`: the barometer MS5611-01BA on I2C, after the data sheet of TE Connectivity and its note AN520.

Commands of one byte: 1Eh reset, A0h + 2n read word n of the PROM, 48h and 58h convert pressure (D1) and temperature
(D2) with an oversampling of 4096 (9.04 ms at most), 00h read the result (three bytes, the highest first). Words 1 to 6
of the PROM are the calibration, the low four bits of word 7 are a CRC. The compensation is of the second order, in
whole numbers as the data sheet has it. The reading is the pressure in hPa.
"""

import struct
import time
from collections.abc import Sequence
from typing import ClassVar

from heronry_agent.device_driver import NotConnectedError, Option, SensorDriver, Setup
from heronry_agent.drivers.i2c_chip import BUS, Chip, SmbusChip

RESET, READ_PROM, CONVERT_PRESSURE, CONVERT_TEMPERATURE, READ_RESULT = 0x1E, 0xA0, 0x48, 0x58, 0x00
WORDS = 8
_RESETS_S, _CONVERTS_S = 0.003, 0.010
_20_DEGREES, _MINUS_15_DEGREES = 2_000, -1_500


def is_whole(prom: Sequence[int]) -> bool:
    """Tell whether the CRC of the eight words of a PROM fits, and the PROM is not empty."""
    remainder = 0
    for byte in struct.pack(">8H", *prom[:-1], prom[-1] & 0xFF00):
        remainder ^= byte
        for _ in range(8):
            remainder = (remainder << 1 ^ 0x3000 if remainder & 0x8000 else remainder << 1) & 0xFFFF
    return any(prom) and remainder >> 12 == prom[-1] & 0x000F


def pressure_hpa(prom: Sequence[int], d1: int, d2: int) -> float | None:
    """Return the pressure in hPa; None for a conversion that was not finished, whose result is 0."""
    if d1 == 0 or d2 == 0:
        return None
    _, sensitivity, offset, by_sensitivity, by_offset, reference, by_temperature, _ = prom
    difference = d2 - (reference << 8)
    celsius = _20_DEGREES + (difference * by_temperature >> 23)  # hundredths
    off = (offset << 16) + (by_offset * difference >> 7)
    sens = (sensitivity << 15) + (by_sensitivity * difference >> 8)
    if celsius < _20_DEGREES:
        colder = 5 * (celsius - _20_DEGREES) ** 2
        off -= colder >> 1
        sens -= colder >> 2
        if celsius < _MINUS_15_DEGREES:
            coldest = (celsius - _MINUS_15_DEGREES) ** 2
            off -= 7 * coldest
            sens -= 11 * coldest >> 1
    return ((d1 * sens >> 21) - off >> 15) / 100


class Ms5611(SensorDriver):
    """The chip."""

    OPTIONS: ClassVar = {
        "bus": BUS,
        "address": Option("Address of the chip: 118 (76h) or 119 (77h).", int, 0x77, choices=(0x76, 0x77)),
    }

    def __init__(self, setup: Setup, chip: Chip | None = None) -> None:
        super().__init__(setup)
        self._chip = chip or SmbusChip(setup.options["bus"], setup.options["address"])
        self._chip.order(RESET)
        time.sleep(_RESETS_S)
        self._prom = [int.from_bytes(self._chip.read(READ_PROM + 2 * number, 2)) for number in range(WORDS)]
        if not is_whole(self._prom):
            raise NotConnectedError(
                f"the chip at address {setup.options['address']} is no whole MS5611: its check sum does not fit"
            )

    def read(self) -> float | None:
        """Have the chip convert pressure and temperature, and return the pressure in hPa."""
        return pressure_hpa(self._prom, self._converted(CONVERT_PRESSURE), self._converted(CONVERT_TEMPERATURE))

    def _converted(self, command: int) -> int:
        self._chip.order(command)
        time.sleep(_CONVERTS_S)
        return int.from_bytes(self._chip.read(READ_RESULT, 3))

    def close(self) -> None:
        """Close the bus."""
        self._chip.close()
