"""Modules of four_heights.dg.yaml: none watches its sensor, for the deadline of the device does."""

from heronry_agent.module import Inputs, Module, Value

_SEA_LEVEL_HPA, _M_PER_HPA = 1013.25, 8.3


class AsRead(Module):
    """Gives what the sensor reads."""

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - a sensor is its only input
        """Return the reading, or nothing without a valid one."""
        reading = self.ctx.read()
        return {} if reading is None else {"height": self.height(reading)}

    def height(self, reading: Value) -> float:
        """Return the height in m that a reading means."""
        return float(reading) if isinstance(reading, (int, float)) else 0.0


class FromPosition(AsRead):
    """Reads a satellite receiver, whose third number is the height in mm."""

    def height(self, reading: Value) -> float:
        """Return the height in m."""
        return reading[2] / 1000 if isinstance(reading, tuple) else super().height(reading)


class FromPressure(AsRead):
    """Reads a barometer in hPa."""

    def height(self, reading: Value) -> float:
        """Return the height in m above the level of 1013.25 hPa."""
        return (_SEA_LEVEL_HPA - super().height(reading)) * _M_PER_HPA


class Mover(Module):
    """Moves the elevator by as many steps as there are metres."""

    def step(self, inputs: Inputs) -> dict[str, Value]:
        """Write the height that came."""
        height = inputs.get("height")
        if height is not None:
            self.ctx.write(height.number())
        return {}
