"""The mechanism that actuators move: one value that follows the last command of an actuator with a lag.

A *push* is a command to the mechanism. Two servos on one surface share one mechanism, and the servo that pushed last
holds it. The clutch of a failed servo slips, and the surface stays where it is until the other servo pushes it.

The state is the position at the last push, and the target and time of this push. Before its first push a mechanism is
at the position `resting`, which the caller gives. If there were pushes before a restart of the process, `resting` may
be wrong. A few time constants after the next push, the position is right again.
"""

import math
from dataclasses import dataclass

NS_PER_S = 1_000_000_000


@dataclass(slots=True)
class Mechanism:
    """A first-order lag; `rise_s` and `fall_s` are its time constants for moving away from zero and back to zero."""

    rise_s: float
    fall_s: float
    _from: float = 0.0
    _target: float = 0.0
    _pushed_ns: int | None = None

    def push(self, target: float, now_ns: int, resting: float) -> None:
        """Move towards `target` from the present position; `resting` is the position before the first push."""
        self._from = self.position(now_ns, resting)
        self._target, self._pushed_ns = target, now_ns

    def rate_per_s(self, now_ns: int, resting: float) -> float:
        """Return the present rate of motion, in units of the position per second; 0 before the first push.

        resting: the position before the first push.
        """
        if self._pushed_ns is None:
            return 0.0
        return (self._target - self.position(now_ns, resting)) / self._lag_s()

    def position(self, now_ns: int, resting: float) -> float:
        """Return the present position; `resting` is the position before the first push."""
        if self._pushed_ns is None:
            return resting
        elapsed_s = max(now_ns - self._pushed_ns, 0) / NS_PER_S
        return self._target + (self._from - self._target) * math.exp(-elapsed_s / self._lag_s())

    def _lag_s(self) -> float:
        return self.rise_s if abs(self._target) > abs(self._from) else self.fall_s
