"""Modules that watch devices, and the control loop of the rover's tracking head.

- `AccuracyMonitor` watches a GPS receiver with differential corrections. From the velocity over the last `WINDOW_S`
  seconds it computes where the receiver should be. If the receiver's position is off by more than `MOST_M` metres on
  one axis, three times in a row, the receiver has lost its corrections, and the monitor reports it. An error that takes
  longer than `WINDOW_S` to grow so far is not detected. The monitor reports nothing in its first `WINDOW_S`, because
  sensors that start at different times disagree at first.
- `SurfaceMonitor` computes from the commands where a surface with a healthy servo would be. If the surface is elsewhere
  for more than `APART_FOR_S` seconds, the monitor reports the servo that drives the surface. The version of the command
  tells which servo this is.
- `TrackingHead` points the camera at the aircraft that the camera sees. Camera, control loop and head are on the rover.
  After a second without an image, the head turns back to the approach.
"""

from collections import deque
from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number, numbers
from heronry_tools.fly.avionics.position import velocity

NS_PER_S = 1_000_000_000
WINDOW_S = 1.0
MOST_M = 1.5
IN_A_ROW = 3
APART_FOR_S = 0.15
_LAG_PERIODS = 6  # most periods between a command and the reading that shows its effect
_APPROACH_TENTH_MRAD = (0, 800)
_FORGETS_NS = 1_000_000_000


class AccuracyMonitor(Module):
    """Reports that the differential receiver has failed, when its position does not follow the measured velocity."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._way = [0.0, 0.0, 0.0]
        self._fixes: deque[tuple[int, tuple[float, ...]]] = deque()  # time, position less the way flown
        self._age_ns = 0
        self._wrong = 0
        self._looks_until_ns = ctx.now_ns + round(WINDOW_S * NS_PER_S)

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Compare a new position with the expected one; report the receiver after `IN_A_ROW` wrong positions in a row.

        Nothing is published.
        """
        moving, now_ns = velocity(inputs), self.ctx.now_ns
        fix = [number(inputs, f"differential_{axis}") for axis in ("x", "y", "height")]
        if moving is None:
            return {}
        self._way = [way + speed * self.ctx.period_ns / NS_PER_S for way, speed in zip(self._way, moving, strict=True)]
        age_ns = inputs["differential_x"].age_ns if fix[0] is not None else 0
        if None not in fix and age_ns <= self._age_ns and now_ns > self._looks_until_ns:
            self._compare(now_ns, tuple((at or 0.0) - way for at, way in zip(fix, self._way, strict=True)))
        self._age_ns = age_ns
        if self._wrong >= IN_A_ROW:
            self.ctx.report_failed("device:differential_receiver")
        return {}

    def _compare(self, now_ns: int, rest: tuple[float, ...]) -> None:
        while self._fixes and self._fixes[0][0] < now_ns - WINDOW_S * NS_PER_S:
            self._fixes.popleft()
        is_off = bool(self._fixes) and any(
            abs(new - old) > MOST_M for new, old in zip(rest, self._fixes[0][1], strict=True)
        )
        self._wrong = self._wrong + 1 if is_off else 0 if self._wrong < IN_A_ROW else self._wrong
        if not is_off:
            self._fixes.append((now_ns, rest))


class SurfaceMonitor(Module):
    """Reports that the servo that drives a surface has failed, when the surface does not follow the commands."""

    surface: ClassVar[str]
    position: ClassVar[str] = "angle"
    apart: ClassVar[float] = 3.0  # this and the rate in the unit of the surface
    rate_per_s: ClassVar[float] = 300.0

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._version = 0  # of the servo that is watched
        self._expected: deque[float] = deque(maxlen=_LAG_PERIODS)  # positions of a healthy servo, newest last
        self._apart_s = 0.0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Compare the surface's position with the range that a healthy servo could have reached."""
        angle, command = number(inputs, f"{self.surface}_{self.position}"), number(inputs, f"{self.surface}_command")
        if angle is None or command is None:
            return {}
        version, period_s = inputs[f"{self.surface}_command"].version, self.ctx.period_ns / NS_PER_S
        if version != self._version:
            self._version, self._apart_s = version, 0.0
            self._expected.clear()
            self._expected.append(angle)
        last = self._expected[-1]
        self._expected.append(last + held(command - last, self.rate_per_s * period_s))
        follows = min(self._expected) - self.apart <= angle <= max(self._expected) + self.apart
        self._apart_s = 0.0 if follows else self._apart_s + period_s
        if self._apart_s > APART_FOR_S:
            self.ctx.report_failed(f"device:{self.surface}_{version}")
        return {}


class ElevatorMonitor(SurfaceMonitor):
    """Watches the servos of the elevator."""

    surface = "elevator"


class AileronMonitor(SurfaceMonitor):
    """Watches the servos of the aileron."""

    surface = "aileron"


class RudderMonitor(SurfaceMonitor):
    """Watches the servos of the rudder."""

    surface = "rudder"


class ThrottleMonitor(SurfaceMonitor):
    """Watches the servos of the throttle."""

    surface, position, apart, rate_per_s = "throttle", "position", 0.1, 2.0


class TrackingHead(Module):
    """Commands the rover's head to the direction in which the camera saw the aircraft."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._seen_ns: int | None = None

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Publish the direction to which the head must turn, in units of 0.1 mrad.

        - With a new image: the direction of the aircraft in this image.
        - Without a new image, for a second after the last one: nothing is published.
        - Later, and before the first image: the direction of the approach.
        """
        angles = numbers(inputs, "image_angles", 2)
        if angles is not None:
            self._seen_ns = self.ctx.now_ns
            return {"head_demand": angles}
        if self._seen_ns is None or self.ctx.now_ns - self._seen_ns > _FORGETS_NS:
            return {"head_demand": _APPROACH_TENTH_MRAD}
        return {}
