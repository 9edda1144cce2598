"""Driver `iio_buffer`: a channel of an IIO chip whose samples the kernel takes by a trigger, and keeps in a buffer.

A trigger (the chip's own data-ready line, a timer, another program) makes the kernel take a sample, with the time at
which it was taken. So readings are evenly spaced, and their times are not those of a busy process. In the folder of the
device

    scan_elements/CHANNEL_en          1: the channel is part of each sample
    scan_elements/CHANNEL_index       the order of the channels in a sample
    scan_elements/CHANNEL_type        `le:s12/16>>4`: byte order, sign, bits / bits of storage, shift to the right
    current_timestamp_clock           the clock of the times
    trigger/current_trigger           the trigger, by its name
    buffer/length, buffer/enable      how many samples are kept; 1 begins

/dev/iio:deviceN gives the samples. In a sample each element begins at a multiple of its own size, and so does the next
sample at one of the largest.
"""

import os
import re
import select
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from heronry_agent.device_driver import Measured, NotConnectedError, Option, SensorDriver, Setup
from heronry_agent.drivers.iio import OPTIONS, IioScale, device_folder

_WAIT_MS = 200
_TYPE = re.compile(r"(le|be):([su])(\d+)/(8|16|32|64)(?:X1)?(?:>>(\d+))?")
_TIMESTAMP = "in_timestamp"


@dataclass(frozen=True, slots=True)
class Element:
    """How a number stands in a sample."""

    is_little: bool
    is_signed: bool
    bits: int
    size: int  # in bytes
    shift: int

    @staticmethod
    def of(text: str) -> "Element":
        """Read a type such as `le:s12/16>>4`; raises NotConnectedError for one that is not understood."""
        match = _TYPE.fullmatch(text.strip())
        if match is None or not 0 < int(match[3]) <= int(match[4]):
            raise NotConnectedError(
                f"the kernel gives a channel the type {text.strip()!r:.40}, which is not understood"
            )
        order, sign, bits, stored, shift = match.groups()
        return Element(order == "le", sign == "s", int(bits), int(stored) // 8, int(shift or 0))

    def number(self, data: bytes) -> int:
        """Return the number in the bytes of the element."""
        raw = int.from_bytes(data, "little" if self.is_little else "big") >> self.shift & (1 << self.bits) - 1
        return raw - (1 << self.bits) if self.is_signed and raw >> self.bits - 1 else raw


def places(elements: Sequence[Element]) -> tuple[tuple[int, ...], int]:
    """Return where each element of a sample begins, in the order given, and the size of a sample, in bytes."""
    found, end = [], 0
    for element in elements:
        begin = _aligned(end, element.size)
        found.append(begin)
        end = begin + element.size
    return tuple(found), _aligned(end, max(element.size for element in elements))


def _aligned(place: int, size: int) -> int:
    return -(-place // size) * size


class Scan:
    """What is in the samples of a buffer: one channel, and its time."""

    def __init__(self, channel: Element, time: Element, *, time_first: bool) -> None:
        """Lay a sample out; time_first: the index of the time is the lower one."""
        self._channel, self._time = channel, time
        order = (time, channel) if time_first else (channel, time)
        begins, self.size = places(order)
        self._time_at, self._channel_at = begins if time_first else begins[::-1]

    def newest(self, data: bytes) -> tuple[int, int] | None:
        """Return number and time in ns of the last whole sample; None if there is none."""
        whole = len(data) // self.size * self.size
        if whole == 0:
            return None
        sample = data[whole - self.size : whole]
        return self._at(sample, self._channel, self._channel_at), self._at(sample, self._time, self._time_at)

    @staticmethod
    def _at(sample: bytes, element: Element, begin: int) -> int:
        return element.number(sample[begin : begin + element.size])


class IioBuffer(SensorDriver):
    """One channel, by the buffer of its device: nothing else may use that buffer."""

    OPTIONS: ClassVar = {
        **OPTIONS,
        "trigger": Option("Name of the trigger, as its file `name` has it; the present one if left out.", str, ""),
        "length": Option("How many samples the kernel keeps.", int, 16, least=2, most=4096),
        "devices": Option("Folder with the device files.", str, "/dev"),
    }
    WAITS: ClassVar = True

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        options = setup.options
        folder = device_folder(Path(options["root"]), options["device"])
        self._scale = IioScale(folder, options["channel"], is_bare=options["raw"])
        self._enable = folder / "buffer" / "enable"
        self._scan = _configured(folder, options)
        self._file = os.open(Path(options["devices"]) / folder.name, os.O_RDONLY | os.O_NONBLOCK)
        self._most = self._scan.size * options["length"]
        self._poll = select.poll()
        self._poll.register(self._file, select.POLLIN)

    def read(self) -> Measured | None:
        """Wait for samples; the newest counts. Raises OSError if the kernel takes the device away."""
        if not self._poll.poll(_WAIT_MS):
            return None
        found = self._scan.newest(os.read(self._file, self._most))
        if found is None:
            return None
        number, time_ns = found
        value = self._scale.value(number) * self.setup.options["scale"] + self.setup.options["offset"]
        return Measured(value, time_ns)

    def close(self) -> None:
        """End the sampling."""
        os.close(self._file)
        with suppress(OSError):
            self._enable.write_text("0")


def _configured(folder: Path, options: Mapping[str, Any]) -> Scan:
    elements, channel = folder / "scan_elements", options["channel"]
    if not (elements / f"{channel}_en").exists():
        raise NotConnectedError(f"IIO device {folder.name} has no channel {channel} in its buffer; use the driver iio")
    try:
        (folder / "buffer" / "enable").write_text("0")
        for one in elements.glob("*_en"):
            one.write_text("1" if one.name in (f"{channel}_en", f"{_TIMESTAMP}_en") else "0")
        (folder / "current_timestamp_clock").write_text("monotonic")
        if options["trigger"]:
            (folder / "trigger" / "current_trigger").write_text(options["trigger"])
        (folder / "buffer" / "length").write_text(str(options["length"]))
        (folder / "buffer" / "enable").write_text("1")
        own, time = (Element.of((elements / f"{name}_type").read_text()) for name in (channel, _TIMESTAMP))
        own_at, time_at = (int((elements / f"{name}_index").read_text()) for name in (channel, _TIMESTAMP))
    except OSError as error:
        raise NotConnectedError(
            f"the kernel does not begin the buffer of IIO device {folder.name} ({error.strerror}): it needs a trigger, "
            "which the option 'trigger' names; /sys/bus/iio/devices/trigger*/name has those that there are"
        ) from None
    return Scan(own, time, time_first=time_at < own_at)
