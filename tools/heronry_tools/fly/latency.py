"""Measures the latency from a sensor to a servo: how long it takes until a step of the pitch rate moves the elevator.

The step is added to the pitch rate in the samples of both inertial units. It passes over the buses, and through three
modules: the reader of the inertial unit, the pitch control, and the driver of the servo. The flight has still air, and
its inertial units have no errors.

The damping of the pitch control answers a step of the rate at once. So the latency begins with the first sample that
contains the step. It ends with the first elevator command that differs from the command before it by at least half of
the full answer of the damping. A real change of the rate would also wait for the next sample; that wait is not
measured.
"""

from heronry_agent.module import Value

STEP_DEG_PER_S = 10.0
_ANSWER_DEG = 0.15 * STEP_DEG_PER_S / 2.0
_FIRST_NS = 3_000_000_000  # when the flight has settled
_EVERY_NS = 500_000_000
_LOST_NS = 400_000_000


class LatencyProbe:
    """Adds steps to the measured pitch rate, up and down in turn, and measures how late the elevator answers."""

    def __init__(self) -> None:
        self.latencies_ns: list[int] = []
        self.unanswered = 0
        self._is_up = False
        self._since_ns: int | None = None  # time of the first sample with a step that is not answered yet
        self._next_ns = _FIRST_NS
        self._before_deg: float | None = None

    def offset_deg_per_s(self, sampled_ns: int) -> float:
        """Return what the probe adds to the true pitch rate in a sample of the inertial unit: `STEP_DEG_PER_S` or 0.

        sampled_ns: time of the sample.
        """
        if sampled_ns >= self._next_ns:
            self.unanswered += self._since_ns is not None
            self._is_up, self._since_ns = not self._is_up, sampled_ns
            self._next_ns += _EVERY_NS
        return STEP_DEG_PER_S if self._is_up else 0.0

    def commanded(self, device: str, value: Value, now_ns: int) -> None:
        """Note a command to an actuator; if the elevator answers a step of the pitch rate by it, record the latency.

        An elevator command is the answer if it differs from the elevator command before it by `_ANSWER_DEG` or more.
        A latency of `_LOST_NS` or more is not recorded.

        now_ns: time of the flight, like that of the samples.
        """
        if not device.startswith("elevator") or not isinstance(value, (int, float)):
            return
        before_deg, self._before_deg = self._before_deg, float(value)
        if self._since_ns is None or before_deg is None or abs(value - before_deg) < _ANSWER_DEG:
            return
        if now_ns - self._since_ns < _LOST_NS:
            self.latencies_ns.append(now_ns - self._since_ns)
        self._since_ns = None
