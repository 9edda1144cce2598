"""Driver `sysfs_out`: an output that the kernel shows as a file in /sys which takes a whole number.

Digital potentiometers (`rdac0` of the kernel's ad525x_dpot, for the AD5241 and its kin), lamps (`brightness`) and fans
(`pwm1`) are such files. The file gets (value - offset) / scale, rounded.
"""

from pathlib import Path
from typing import ClassVar

from heronry_agent.device_driver import ActuatorDriver, NotConnectedError, Option, OptionError, Setup


class SysfsOutput(ActuatorDriver):
    """The file. It cannot be released: name a value as its `safe` action."""

    OPTIONS: ClassVar = {
        "file": Option("The file, such as /sys/bus/i2c/devices/1-002c/rdac0.", str),
        "scale": Option("Units of the command for one step of the number in the file.", float, 1.0),
        "offset": Option("Command at the number 0.", float, 0.0),
    }

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        options = setup.options
        self._file, self._scale, self._offset = Path(options["file"]), float(options["scale"]), float(options["offset"])
        if self._scale == 0:
            raise OptionError("option 'scale' must not be 0")
        if not self._file.is_file():
            raise NotConnectedError(f"there is no file {self._file}; load the kernel's driver of the chip")

    def command(self, value: float) -> float:
        """Write the number; returns the command that it stands for. Raises OSError if the kernel refuses it."""
        number = round((value - self._offset) / self._scale)
        self._file.write_text(str(number))
        return number * self._scale + self._offset
