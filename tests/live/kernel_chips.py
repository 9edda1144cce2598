"""Chips that the kernel's own drivers find, though they are registers in memory: i2c-stub in a user-mode Linux.

0x54   ADC081C      analogue-to-digital converter, by Industrial I/O
0x10   AD5625       digital-to-analogue converter, by Industrial I/O
0x2c   AD5241       digital potentiometer: the file rdac0
0x58   MAX517       digital-to-analogue converter, by Industrial I/O: the kernel gives it no name, but a scale
0x76   BMP280       barometer; no driver of the kernel has it, so it is raw registers
0x77   MS5611       another one; its commands are numbers of registers

The two of the second kind have no registers: the kernel sends them messages, which i2c-stub refuses.
"""

import os
import struct
import subprocess
from pathlib import Path

import pytest
from smbus2 import SMBus

from heronry_agent.drivers import bmp280, ms5611
from heronry_tools.runtime.vcan.debian_packages import cache_folder

ADC081C, AD5241, AD5625, MAX517, BMP280, MS5611 = 0x54, 0x2C, 0x10, 0x58, 0x76, 0x77
_BUS = 0
_BOUND = (("adc081c", ADC081C), ("ad5241", AD5241), ("ad5625", AD5625), ("max517", MAX517))
_MODULES = (
    *("i2c-core", "i2c-dev", "regmap-i2c", "industrialio", "configfs", "kfifo_buf", "industrialio-triggered-buffer"),
    *("ti-adc081c", "ad525x_dpot", "ad525x_dpot-i2c", "ad5064", "max517"),
)
# The example of the data sheet's section 3.12: 100653.27 Pa.
CALIBRATION = struct.pack("<HhhH8h", 27504, 26435, -1000, 36477, -10685, 3024, 2855, 140, -7, 15500, -14600, 6000)
RAW_PRESSURE, RAW_TEMPERATURE = 415148, 519888
_STILL_MEASURING = 0x08


class Chips:
    """The registers of the chips, and what the kernel makes of them."""

    wiper = Path(f"/sys/bus/i2c/devices/{_BUS}-{AD5241:04x}/rdac0")
    _orders = Path(f"/sys/bus/i2c/devices/i2c-{_BUS}")

    def __init__(self) -> None:
        """Load the kernel's modules, once, and put the chips on the bus; skips the test where that cannot be."""
        if os.geteuid() != 0:
            pytest.skip("only root may load the kernel's drivers of chips")
        if not self._orders.exists():
            _load()
        self._bus = SMBus(_BUS, force=True)
        self.measure(1)
        for chip, address in _BOUND:
            if not Path(f"/sys/bus/i2c/devices/{_BUS}-{address:04x}").exists():
                (self._orders / "new_device").write_text(f"{chip} 0x{address:02x}")
        self._fill(bmp280.CHIP_ID, bytes([bmp280.ID]))
        self._fill(bmp280.STATUS, bytes(1))
        self._fill(bmp280.CALIBRATION, CALIBRATION)
        self._fill(bmp280.DATA, (RAW_PRESSURE << 28 | RAW_TEMPERATURE << 4).to_bytes(6))

    def _fill(self, register: int, data: bytes) -> None:
        for place, byte in enumerate(data, register):
            self._bus.write_byte_data(BMP280, place, byte)

    def fill_ms5611(self, converted: int) -> list[int]:
        """Give the MS5611 a calibration and the result of all conversions; returns the words of its PROM."""
        prom = [0, 46372, 43981, 29059, 27842, 31553, 28165, 0]  # the example of the data sheet
        prom[-1] = next(crc for crc in range(16) if ms5611.is_whole([*prom[:-1], crc]))
        data = {ms5611.READ_PROM: struct.pack(">8H", *prom), ms5611.READ_RESULT: converted.to_bytes(3)}
        for register, content in data.items():
            for place, byte in enumerate(content, register):
                self._bus.write_byte_data(MS5611, place, byte)
        return prom

    def measure(self, raw: int) -> None:
        """Let the converter measure: eight bits, which stand in bits 4 to 11 of its register."""
        self._bus.write_word_data(ADC081C, 0, int.from_bytes((raw << 4).to_bytes(2), "little"))

    def converter(self) -> str:
        """Return the name that the kernel gives to the converter: its place on the bus."""
        return f"{_BUS}-{ADC081C:04x}"

    def nameless_output(self) -> str:
        """Return the folder that the kernel makes for the MAX517."""
        (folder,) = Path(f"/sys/bus/i2c/devices/{_BUS}-{MAX517:04x}").glob("iio:device*")
        return folder.name

    def register(self) -> int:
        """Return what the potentiometer holds."""
        return int(self.wiper.read_text())

    def take_converter_away(self) -> None:
        """Take the converter from the bus: its files go."""
        (self._orders / "delete_device").write_text(f"0x{ADC081C:02x}")

    def let_barometer_hang(self) -> None:
        """Let the barometer measure without an end."""
        self._fill(bmp280.STATUS, bytes([_STILL_MEASURING]))


def _load() -> None:
    busybox = str(cache_folder() / "busybox-static/bin/busybox")
    kernel = cache_folder() / "user-mode-linux"
    chips = ",".join(f"0x{address:02x}" for address in (*dict(_BOUND).values(), BMP280, MS5611))
    for name, *parameters in (*((module,) for module in _MODULES), ("i2c-stub", f"chip_addr={chips}")):
        file = next(kernel.glob(f"usr/lib/uml/modules/{os.uname().release}/kernel/**/{name}.ko*"), None)
        if file is None:
            pytest.skip(f"this kernel is no user-mode Linux of Debian with the module {name}")
        loaded = subprocess.run(
            [busybox, "insmod", str(file), *parameters], capture_output=True, text=True, check=False
        )
        assert loaded.returncode == 0 or "File exists" in loaded.stderr, loaded.stderr
