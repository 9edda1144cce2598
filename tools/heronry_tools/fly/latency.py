"""How long it takes from a sensor to a servo: the pitch rate is stepped, and the elevator must follow.

On the way lie the driver of the inertial unit, the pitch control and the driver of the servo, with buses between PEs.
The step is added to what both inertial units measure, in a flight in still air with sensors without noise. The pitch
control answers a step of the rate at once, by its damping; so the first elevator command that has changed by half of
that tells the time. What passes before the inertial unit takes its sample is not counted.
"""

from heronry_agent.module import Value

STEP_DEG_PER_S = 10.0
_ANSWER_DEG = 0.15 * STEP_DEG_PER_S / 2.0
_FIRST_NS = 3_000_000_000  # when the flight has settled
_EVERY_NS = 500_000_000
_LOST_NS = 400_000_000


class LatencyProbe:
    """Steps the pitch rate up and down, and notes when the elevator answers."""

    def __init__(self) -> None:
        self.latencies_ns: list[int] = []
        self.unanswered = 0
        self._is_up = False
        self._since_ns: int | None = None  # the sample with the step that is not answered yet
        self._next_ns = _FIRST_NS
        self._before_deg: float | None = None

    def offset_deg_per_s(self, sampled_ns: int) -> float:
        """Give what to add to the pitch rate of a sample at this time."""
        if sampled_ns >= self._next_ns:
            self.unanswered += self._since_ns is not None
            self._is_up, self._since_ns = not self._is_up, sampled_ns
            self._next_ns += _EVERY_NS
        return STEP_DEG_PER_S if self._is_up else 0.0

    def commanded(self, device: str, value: Value, now_ns: int) -> None:
        """Take a command to a servo."""
        if not device.startswith("elevator") or not isinstance(value, (int, float)):
            return
        before_deg, self._before_deg = self._before_deg, float(value)
        if self._since_ns is None or before_deg is None or abs(value - before_deg) < _ANSWER_DEG:
            return
        if now_ns - self._since_ns < _LOST_NS:
            self.latencies_ns.append(now_ns - self._since_ns)
        self._since_ns = None
