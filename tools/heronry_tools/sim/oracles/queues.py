"""No queue fills up: a node to which nothing is done gets rid of the frames that it has to send.

A bus on which a frame waits is never idle (arbitration is work-conserving), so a bus that has been idle since the last
look has emptied every queue meanwhile. That is read from the bits that were sent: as many as the time has room for mean
that it never fell idle. An error-passive controller pauses for 8 bits after each frame; that is not idleness enough.

And no frame is left behind: on a bus that keeps to its budget none waits for as long as from one look to the next but
one, unless its sender holds it back for ever.
"""

from collections.abc import Mapping

from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import SimulatedBus

_NS_PER_S = 1_000_000_000
_FULL = 0.95  # of the bits that there was time for


class QueueCheck:
    """Compares how busy the buses are from one look to the next."""

    def __init__(self, t_ns: int, buses: Mapping[str, SimulatedBus]) -> None:
        """Begin with a first look."""
        self._t_ns = t_ns
        self._bits = {name: bus.busy_bits for name, bus in buses.items()}
        self._offered = self._offered_before = dict.fromkeys(buses, 0)

    def look(self, t_ns: int, buses: Mapping[str, SimulatedBus]) -> list[Violation]:
        """Give the buses that have not been idle since the last look."""
        passed_ns, before = t_ns - self._t_ns, self._bits
        self._t_ns, self._bits = t_ns, {name: bus.busy_bits for name, bus in buses.items()}
        before_that, self._offered_before = self._offered_before, self._offered
        self._offered = {name: bus.offered for name, bus in buses.items()}
        stories = []
        for name, bus in buses.items():
            share = (bus.busy_bits - before[name]) * _NS_PER_S / (bus.bitrate * passed_ns)
            if share > _FULL:
                story = f"{bus.queued} frames pile up on {name}, which has not been idle for {passed_ns / 1e6:.0f} ms"
                stories.append(Violation(t_ns, "queues", story))
            left = bus.longest_waiting
            if left is not None and left.offer <= before_that[name]:
                story = (
                    f"{left.frame.can_id} of {left.station.name} waits on {name} for more than {passed_ns / 1e6:.0f} ms"
                )
                stories.append(Violation(t_ns, "queues", story))
        return stories
