"""Driver `gpio`: a burn wire, a solenoid or a lamp on a GPIO line, on for a longest time; needs gpiod.

A command of 0.5 or more switches the line on, a smaller one off. The line goes off after `longest_ms`, whoever commands
it: then only an order to be off is executed, until one has come (`lasts_ms` of the API). The kernel gives the line back
when the process ends; what it does then depends on the board, so a burn wire also wants a resistor that keeps it off.
"""

from typing import Any, ClassVar

from heronry_agent.device_driver import ActuatorDriver, Option, Setup

_ON = 0.5


class GpioLine(ActuatorDriver):
    """The line."""

    OPTIONS: ClassVar = {
        "chip": Option("Device file of the chip.", str, "/dev/gpiochip0"),
        "line": Option("Number of the line on the chip.", int, least=0),
        "longest_ms": Option("Longest time on, in ms.", int, least=1, most=3_600_000),
        "active_low": Option("Whether the line is on at the low voltage.", bool, default=False),
    }

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        import gpiod  # noqa: PLC0415 - head of `device_driver`
        from gpiod.line import Direction, Value  # noqa: PLC0415 - as above

        options = setup.options
        self._line, self._on, self._off = options["line"], Value.ACTIVE, Value.INACTIVE
        settings = gpiod.LineSettings(
            direction=Direction.OUTPUT, output_value=Value.INACTIVE, active_low=options["active_low"]
        )
        self._request: Any = gpiod.request_lines(
            options["chip"], consumer=f"heronry {setup.device}"[:31], config={self._line: settings}
        )

    def lasts_ms(self, value: float) -> float | None:
        """The line may be off without end, and on for its longest time."""
        return float(self.setup.options["longest_ms"]) if value >= _ON else None

    def command(self, value: float) -> float:
        """Switch the line; returns 1 or 0."""
        is_on = value >= _ON
        self._request.set_value(self._line, self._on if is_on else self._off)
        return float(is_on)

    def release(self) -> None:
        """Switch the line off."""
        self._request.set_value(self._line, self._off)

    def close(self) -> None:
        """Give the line back."""
        self._request.release()
