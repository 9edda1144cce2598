"""The data on each bus stay within the bus's budget in every second, as the frames show.

The budget is `max_load` minus `reserve`, as a share of the bit rate. The data of all nodes of the spec count, each
frame with its worst-case length. A quarter more than the budget is tolerated: a node whose wire was mended sends at
once the frames that it has queued, up to those of one T_lease. (`transitions` verifies the budget at each moment of a
reconfiguration.)
"""

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.timing import worst_bits

_WINDOW_NS = 1_000_000_000
_TOLERANCE = 1.25


class LoadCheck(Oracle):
    """Adds up the bits of data frames on each bus, second by second, and compares them with the bus's budget."""

    def __init__(self, spec: Spec) -> None:
        super().__init__()
        self._budget = {
            bus.name: float(bus.bitrate * (bus.max_load - bus.reserve)) * _TOLERANCE for bus in spec.buses.values()
        }
        self._window = 0
        self._bits = dict.fromkeys(spec.buses, 0)
        self._worst = [worst_bits(size) for size in range(9)]

    def published(self, sent: Sent) -> None:
        """Add the largest possible number of bits of a data frame to the sum of its bus in this second."""
        window = sent.end_ns // _WINDOW_NS
        if window != self._window:
            self._close(sent.end_ns)
            self._window = window
        self._bits[sent.bus] += self._worst[len(sent.frame.data)]

    def _close(self, t_ns: int) -> None:
        for bus, bits in self._bits.items():
            if bits > self._budget[bus]:
                story = f"{bus} carried {bits} bits of data in a second, but its budget is {self._budget[bus]:.0f} bits"
                self.violations.append(Violation(t_ns, "load", story))
            self._bits[bus] = 0
