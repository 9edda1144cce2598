"""Driver `pwm`: a servo on a PWM output that the kernel shows in sysfs.

`pwmchipN/export` takes the number of an output, which then has a folder `pwmM` with `period` and `duty_cycle` in ns,
and `enable`. A command from `low` to `high` becomes a pulse from `least_us` to `most_us`. A release ends the pulses:
most servos then have no force, and some hold their last angle; know yours.
"""

import time
from pathlib import Path
from typing import ClassVar

from heronry_agent.device_driver import ActuatorDriver, NotConnectedError, Option, OptionError, Setup

_APPEARS_S = 1.0
_NS_PER_US = 1_000


def pulse_ns(value: float, low: float, high: float, least_us: float, most_us: float) -> int:
    """Return the length of the pulse for a command, clipped to the two ends."""
    share = min(max((value - low) / (high - low), 0.0), 1.0)
    return round((least_us + share * (most_us - least_us)) * _NS_PER_US)


class PwmServo(ActuatorDriver):
    """The servo."""

    OPTIONS: ClassVar = {
        "chip": Option("Number of the PWM chip: N of pwmchipN.", int, 0, least=0),
        "output": Option("Number of the output of the chip.", int, least=0),
        "period_us": Option("Time from pulse to pulse.", float, 20_000.0, least=100, most=1_000_000),
        "least_us": Option("Length of the pulse at `low`.", float, 1_000.0, least=1),
        "most_us": Option(
            "Length of the pulse at `high`; less than `least_us` turns the servo around.", float, 2_000.0
        ),
        "low": Option("Command for `least_us`.", float, -1.0),
        "high": Option("Command for `most_us`.", float, 1.0),
        "root": Option("Folder with the chips.", str, "/sys/class/pwm"),
    }

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        options = setup.options
        self._ends: tuple[float, ...] = tuple(options[name] for name in ("low", "high", "least_us", "most_us"))
        if options["low"] >= options["high"]:
            raise OptionError("option 'low' must be less than 'high'; exchange 'least_us' and 'most_us' to turn around")
        if not 0 < max(options["least_us"], options["most_us"]) < options["period_us"] or options["most_us"] <= 0:
            raise OptionError("options 'least_us' and 'most_us' must be more than 0 and less than 'period_us'")
        self._output = _exported(Path(options["root"]) / f"pwmchip{options['chip']}", options["output"])
        self._period_ns = round(options["period_us"] * _NS_PER_US)
        if (self._output / "enable").read_text().strip() != "1":
            (self._output / "duty_cycle").write_text("0")  # the kernel refuses a period below the pulse
            (self._output / "period").write_text(str(self._period_ns))

    def command(self, value: float) -> float:
        """Set the pulse, and switch the output on; returns the value of the pulse that was set."""
        low, high, least_us, most_us = self._ends
        length_ns = pulse_ns(value, low, high, least_us, most_us)
        (self._output / "duty_cycle").write_text(str(length_ns))
        (self._output / "enable").write_text("1")
        if most_us == least_us:
            return value
        return low + (length_ns / _NS_PER_US - least_us) / (most_us - least_us) * (high - low)

    def release(self) -> None:
        """End the pulses."""
        (self._output / "enable").write_text("0")


def _exported(chip: Path, number: int) -> Path:
    """Return the folder of an output, which is exported if it is not yet; raises NotConnectedError."""
    output = chip / f"pwm{number}"
    if not chip.is_dir():
        raise NotConnectedError(f"there is no {chip}; enable the PWM of the board")
    if not output.is_dir():
        (chip / "export").write_text(str(number))
    end_s = time.monotonic() + _APPEARS_S
    while not (output / "enable").exists():
        if time.monotonic() > end_s:
            raise NotConnectedError(f"{chip} does not give its output {number}")
        time.sleep(0.01)
    return output
