"""The data on a bus stay within its budget: second by second, from the frames alone (`oracles.transitions`: at once).

What the spec's nodes publish may take `max_load` less `reserve` of the bit rate. Real frames are shorter than the worst
case that the plan counts, so the budget is only reached where something is published that no plan provides; a quarter
more is tolerated, since a node whose wire was mended sends in one go what it could not send for T_lease.
"""

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.timing import worst_bits

_WINDOW_NS = 1_000_000_000
_TOLERANCE = 1.25


class LoadCheck(Oracle):
    """Adds up the bits of data frames."""

    def __init__(self, spec: Spec) -> None:
        super().__init__()
        self._budget = {
            bus.name: float(bus.bitrate * (bus.max_load - bus.reserve)) * _TOLERANCE for bus in spec.buses.values()
        }
        self._window = 0
        self._bits = dict.fromkeys(spec.buses, 0)
        self._worst = [worst_bits(size) for size in range(9)]

    def published(self, sent: Sent) -> None:
        """A data frame was sent."""
        window = sent.end_ns // _WINDOW_NS
        if window != self._window:
            self._close(sent.end_ns)
            self._window = window
        self._bits[sent.bus] += self._worst[len(sent.frame.data)]

    def _close(self, t_ns: int) -> None:
        for bus, bits in self._bits.items():
            if bits > self._budget[bus]:
                story = f"{bus} carried {bits} bits of data in a second, and its budget is {self._budget[bus]:.0f}"
                self.violations.append(Violation(t_ns, "load", story))
            self._bits[bus] = 0
