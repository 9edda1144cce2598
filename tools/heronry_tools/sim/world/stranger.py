"""A foreign node: it repeats one frame, without pause or with a period.

The oracles recognize a foreign node by its name, which begins with `STRANGER`; no node of a spec has such a name.
"""

from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_wire.frame import Frame
from heronry_wire.timing import exact_bits

STRANGER = "stranger "
_NS_PER_S = 1_000_000_000


class Stranger:
    """A foreign node, which sends from its creation until `leave`."""

    def __init__(self, clock: Clock, bus: SimulatedBus, frame: Frame, every_ns: int | None = None) -> None:
        """Send `frame` with the period `every_ns`; None: without pause."""
        self._clock, self._bus, self._frame = clock, bus, frame
        self._every_ns = every_ns or exact_bits(frame) * _NS_PER_S // bus.bitrate
        self._station = bus.join(f"{STRANGER}{frame.can_id}", 0, lambda _: None, ())
        self._send()

    def leave(self) -> None:
        """Leave the bus."""
        if self._station.present:
            self._bus.leave(self._station)

    def _send(self) -> None:
        if not self._station.present:
            return
        if self._station.mailbox is None:
            self._bus.offer(
                self._station, Frame(self._frame.can_id, self._frame.data, self._frame.extended)
            )  # a new transmission
        self._clock.at(self._clock.now_ns + self._every_ns, self._send)
