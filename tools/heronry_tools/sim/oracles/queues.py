"""No queue of frames grows without end, and no frame is left behind, while no fault is present.

`look` is called at intervals, and verifies two rules:

- Between two calls, each bus must have been idle at some moment. A bus is never idle while a frame waits
  (arbitration is work-conserving), so an idle moment proves that every queue was empty. If frames fill nearly the whole
  interval (`_FULL`), the bus was never idle. An error-passive controller pauses for 8 bits after each frame; this pause
  counts as idle.
- No frame may wait from one call of `look` to the second call after it. If a frame waits so long on a bus within its
  budget, its sender has left the frame behind.
"""

from collections.abc import Mapping

from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import SimulatedBus

_NS_PER_S = 1_000_000_000
_FULL = 0.95  # share of an interval that frames must fill for the bus to count as never idle


class QueueCheck:
    """Compares the load and the queues of the buses from one call of `look` to the next."""

    def __init__(self, t_ns: int, buses: Mapping[str, SimulatedBus]) -> None:
        """Record how many bits each bus has carried so far."""
        self._t_ns = t_ns
        self._bits = {name: bus.busy_bits for name, bus in buses.items()}
        self._offered = self._offered_before = dict.fromkeys(buses, 0)

    def look(self, t_ns: int, buses: Mapping[str, SimulatedBus]) -> list[Violation]:
        """Return the violations: buses that were not idle since the last call, and frames that wait too long.

        There is one violation for each such bus, and one for each bus with such a frame. A frame waits too long
        if it was waiting already at the second call before this one.
        """
        passed_ns, before = t_ns - self._t_ns, self._bits
        self._t_ns, self._bits = t_ns, {name: bus.busy_bits for name, bus in buses.items()}
        before_that, self._offered_before = self._offered_before, self._offered
        self._offered = {name: bus.offered for name, bus in buses.items()}
        stories = []
        for name, bus in buses.items():
            share = (bus.busy_bits - before[name]) * _NS_PER_S / (bus.bitrate * passed_ns)
            if share > _FULL:
                story = f"{bus.queued} frames wait on {name}, which has not been idle for {passed_ns / 1e6:.0f} ms"
                stories.append(Violation(t_ns, "queues", story))
            left = bus.longest_waiting
            if left is not None and left.offer <= before_that[name]:
                story = (
                    f"{left.frame.can_id} of {left.station.name} has waited on {name} for over {passed_ns / 1e6:.0f} ms"
                )
                stories.append(Violation(t_ns, "queues", story))
        return stories
