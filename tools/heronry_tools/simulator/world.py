"""The one world of a run, and the window through which each PE's devices meet it.

In flight every process has a bench of its own and follows the others by their echoes. In one process there can be one
world, and it is the truer one: a surface stays where it is when its processor restarts, and a servo that has failed
stays failed. Whatever a PE's clock shows, the world is read and moved at the true time.
"""

from heronry_agent.bench import Bench
from heronry_agent.module import Value
from heronry_tools.simulator.clock import Clock


class Window(Bench):
    """A bench that hands everything on to the world."""

    def __init__(self, world: Bench, clock: Clock) -> None:
        super().__init__(0)
        self._world, self._clock = world, clock

    def read(self, device: str, now_ns: int) -> Value | None:  # noqa: ARG002 - the PE's own clock
        """What a device says now."""
        return self._world.read(device, self._clock.now_ns)

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:  # noqa: ARG002
        """Move an actuator."""
        return self._world.write(device, value, self._clock.now_ns)

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Somebody told that an actuator moved: the world knows."""
