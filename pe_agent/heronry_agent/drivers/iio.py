"""Drivers `iio` and `iio_out`: a channel of a chip that the kernel shows by Industrial I/O, in sysfs.

A device is a folder `iio:deviceN` with a file `name`. A channel is `in_voltage0`, `out_resistance1`, and so on, with
the files

    CHANNEL_raw                       whole number: the register of the chip
    CHANNEL_scale, CHANNEL_offset     numbers; or `in_voltage_scale`, for all channels of a kind
    CHANNEL_input                     a number that the kernel has scaled already, in place of raw

    value = (raw + offset) x scale    in the kernel's unit of the kind: mV, ohm, milli-degrees Celsius, kPa, ...

Some chips are named by their place on the bus, such as `0-0054`. A scale that the kernel has a file for but cannot
tell (a converter without a known reference voltage) is an error, since the unit would be wrong: `raw: true` takes the
register as it is. The options `scale` and `offset` give another unit: value x scale + offset.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from heronry_agent.device_driver import ActuatorDriver, NotConnectedError, Option, SensorDriver, Setup

OPTIONS = {
    "device": Option("Name of the chip as its file `name` has it, or the folder, such as iio:device0.", str),
    "channel": Option("Channel, such as in_voltage0.", str),
    "raw": Option("Take the register as it is, without the kernel's scale and offset.", bool, False),
    "scale": Option("Factor on the kernel's value.", float, 1.0),
    "offset": Option("Added after that.", float, 0.0),
    "root": Option("Folder with the devices.", str, "/sys/bus/iio/devices"),
}


def device_folder(root: Path, device: str) -> Path:
    """Find the folder of a device by its name, or by the name of the folder; raises NotConnectedError."""
    folders = sorted(root.glob("iio:device*"))
    named = [one for one in folders if device in (one.name, _text(one / "name"))]
    if len(named) == 1:
        return named[0]
    if named:
        raise NotConnectedError(
            f"several IIO devices are named {device}: {', '.join(one.name for one in named)}; name the folder instead"
        )
    there = ", ".join(f"{one.name} ({_text(one / 'name')})" for one in folders) or "none"
    raise NotConnectedError(f"there is no IIO device {device} in {root}; there is {there}")


class IioScale:
    """What the kernel says of the numbers of one channel."""

    def __init__(self, folder: Path, channel: str, *, is_bare: bool = False) -> None:
        """Read scale and offset of the channel; raises NotConnectedError.

        is_bare: the value is the register, without the kernel's scale and offset.
        """
        kind = channel.rstrip("0123456789")
        self._scale, self._offset = 1.0, 0.0
        if not is_bare:
            self._scale = _number(folder, f"{channel}_scale", f"{kind}_scale", default=1.0)
            self._offset = _number(folder, f"{channel}_offset", f"{kind}_offset", default=0.0)
        if not math.isfinite(self._scale) or self._scale == 0:
            raise NotConnectedError(f"IIO device {folder.name} gives channel {channel} the scale {self._scale}")

    def value(self, raw: int) -> float:
        """Return the kernel's value of a register."""
        return (raw + self._offset) * self._scale

    def raw(self, value: float) -> int:
        """Return the register that is nearest to a value."""
        return round(value / self._scale - self._offset)


class IioChannel:
    """One channel."""

    def __init__(self, folder: Path, channel: str, *, is_bare: bool = False) -> None:
        """Find the files of the channel; raises NotConnectedError.

        is_bare: the value is the register, without the kernel's scale and offset.
        """
        self._raw, self._input = folder / f"{channel}_raw", folder / f"{channel}_input"
        self.is_scaled = self._input.exists() and not is_bare
        if not self.is_scaled and not self._raw.exists():
            raise NotConnectedError(f"IIO device {folder.name} has no channel {channel}: there is no {self._raw.name}")
        self._scale = IioScale(folder, channel, is_bare=is_bare or self.is_scaled)

    def read(self) -> float:
        """Return the kernel's value; raises OSError if the chip does not answer, ValueError for a strange text."""
        if self.is_scaled:
            return float(self._input.read_text())
        return self._scale.value(int(self._raw.read_text()))

    def write(self, value: float) -> float:
        """Write a value, rounded to what the register can hold; returns that value. Raises OSError."""
        raw = self._scale.raw(value)
        self._raw.write_text(str(raw))
        return self._scale.value(raw)


def _number(folder: Path, *files: str, default: float) -> float:
    for file in files:
        if (folder / file).exists():
            try:
                return float((folder / file).read_text())
            except (OSError, ValueError):
                raise NotConnectedError(
                    f"the kernel has a file {file} for IIO device {folder.name} and cannot tell the number in it; with "
                    "the option 'raw' the register is taken as it is"
                ) from None
    return default


def _text(file: Path) -> str:
    try:
        return file.read_text().strip()
    except OSError:
        return ""


def channel_of(options: Mapping[str, Any]) -> IioChannel:
    """Return the channel that the options name; raises NotConnectedError."""
    folder = device_folder(Path(options["root"]), options["device"])
    return IioChannel(folder, options["channel"], is_bare=options["raw"])


class IioInput(SensorDriver):
    """A channel that is read."""

    OPTIONS: ClassVar = OPTIONS

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        options = setup.options
        self._channel = channel_of(options)

    def read(self) -> float:
        """Read the channel."""
        return self._channel.read() * float(self.setup.options["scale"]) + float(self.setup.options["offset"])


class IioOutput(ActuatorDriver):
    """A channel that is written. It cannot be released: name a value as its `safe` action."""

    OPTIONS: ClassVar = OPTIONS

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        options = setup.options
        self._channel = channel_of(options)
        self._factor, self._added = float(options["scale"]), float(options["offset"])
        if self._channel.is_scaled or self._factor == 0:
            raise NotConnectedError(f"channel {options['channel']} cannot be written with scale {self._factor}")

    def command(self, value: float) -> float:
        """Write the channel."""
        return self._channel.write((value - self._added) / self._factor) * self._factor + self._added
