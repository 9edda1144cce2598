"""A chip on an I2C bus of the computer, by the library smbus2: what the barometers need of it."""

from typing import Any, Final, Protocol

from heronry_agent.device_driver import Option

BUS: Final = Option("Number of the I2C bus: N of /dev/i2c-N.", int, 1, least=0)


class Chip(Protocol):
    """The registers and commands of one chip; every method raises OSError if the chip does not answer."""

    def read(self, register: int, count: int) -> bytes:
        """Read bytes from a register on, or the answer to a command."""

    def write(self, register: int, value: int) -> None:
        """Write one byte to a register."""

    def order(self, command: int) -> None:
        """Send a command of one byte."""

    def close(self) -> None:
        """Close the bus."""


class SmbusChip:
    """A chip behind /dev/i2c-N; needs smbus2."""

    def __init__(self, bus: int, address: int) -> None:
        """Open the bus; raises OSError."""
        from smbus2 import SMBus  # noqa: PLC0415 - head of `device_driver`

        self._bus: Any = SMBus(bus)
        self._address = address

    def read(self, register: int, count: int) -> bytes:
        """Read up to 32 bytes from a register on."""
        return bytes(self._bus.read_i2c_block_data(self._address, register, count))

    def write(self, register: int, value: int) -> None:
        """Write one byte to a register."""
        self._bus.write_byte_data(self._address, register, value)

    def order(self, command: int) -> None:
        """Send a command of one byte."""
        self._bus.write_byte(self._address, command)

    def close(self) -> None:
        """Close the bus."""
        self._bus.close()
