"""The one world of a run, and the window through which each PE's devices meet it.

In flight every process has a bench of its own and follows the others by their echoes. In one process there can be one
world, and it is the truer one: a surface stays where it is when its processor restarts, and a servo that has failed
stays failed. Each PE reads it on its own clock.
"""

from heronry_agent.bench import Bench
from heronry_agent.module import Value


class Window(Bench):
    """A bench that hands everything on to the world, `ahead_ns` earlier."""

    def __init__(self, world: Bench, ahead_ns: int) -> None:
        super().__init__(ahead_ns)
        self._world, self._ahead_ns = world, ahead_ns

    def read(self, device: str, now_ns: int) -> Value | None:
        """What a device says now."""
        return self._world.read(device, now_ns - self._ahead_ns)

    def write(self, device: str, value: Value, now_ns: int) -> Value | None:
        """Move an actuator."""
        return self._world.write(device, value, now_ns - self._ahead_ns)

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Somebody told that an actuator moved: the world knows."""
