"""What actuators move: one value with inertia, pushed by whichever actuator was driven last.

Two servos on one surface share one mechanism, and the one that was driven last holds it: a servo that has failed
slips its clutch and leaves the surface where it is until the other one takes it. States: where it was when it was last
pushed, and where to. A position not yet pushed rests at its initial value, so a process that was restarted agrees with
the others as soon as it has heard one push and a few time constants have passed.
"""

import math
from dataclasses import dataclass

NS_PER_S = 1_000_000_000


@dataclass(slots=True)
class Mechanism:
    """A first-order lag; `rise_s` and `fall_s` are its time constants away from zero and back to it."""

    rise_s: float
    fall_s: float
    _from: float = 0.0
    _target: float = 0.0
    _pushed_ns: int | None = None

    def push(self, target: float, now_ns: int, resting: float) -> None:
        """Move towards a target from where it is now; `resting` is where it is if it has not been pushed yet."""
        self._from = self.position(now_ns, resting)
        self._target, self._pushed_ns = target, now_ns

    def rate_per_s(self, now_ns: int, resting: float) -> float:
        """How fast it is moving."""
        if self._pushed_ns is None:
            return 0.0
        return (self._target - self.position(now_ns, resting)) / self._lag_s()

    def position(self, now_ns: int, resting: float) -> float:
        """Where it is; `resting` if it has not been pushed yet."""
        if self._pushed_ns is None:
            return resting
        elapsed_s = max(now_ns - self._pushed_ns, 0) / NS_PER_S
        return self._target + (self._from - self._target) * math.exp(-elapsed_s / self._lag_s())

    def _lag_s(self) -> float:
        return self.rise_s if abs(self._target) > abs(self._from) else self.fall_s
