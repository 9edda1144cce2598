"""An observer of one bus of the spec, which receives each frame once.

The bus may be replicated: then the observer takes each frame from either channel. When one channel fails, the observer
goes on with the other channel, and opens the failed one again, as the nodes do. When the only channel of a bus ends,
the observer raises an error, which ends the flight.
"""

import time
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Any, Self

from heronry_dg.model import Bus
from heronry_tools.runtime.demo.buses import BusChoice
from heronry_wire.arrival_times import ArrivalTimes
from heronry_wire.bare_can import can
from heronry_wire.bus_opening import open_bus
from heronry_wire.frame_port import Arrival
from heronry_wire.python_can import frame_of
from heronry_wire.replicated_link import ReplicatedLink


class Ear:
    """Receives the frames of one bus; as a context manager it closes the bus at the end."""

    def __init__(self, choice: BusChoice, bus: Bus) -> None:
        """Open the bus; raises LinkError."""
        configs = choice.configs()
        self._times = ArrivalTimes()
        self._bus: can.BusABC | ReplicatedLink = (
            open_bus(configs[0]).bus if len(configs) == 1 else ReplicatedLink(configs, bus.heartbeat_ns, bus.misses)
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(self._bus, ReplicatedLink):
            self._bus.close()
        else:
            self._bus.shutdown()

    @property
    def readers(self) -> Sequence[Any]:
        """Return the descriptors that become readable when a frame has come."""
        return self._bus.readers if isinstance(self._bus, ReplicatedLink) else (self._bus,)

    def hear(self) -> Iterator[Arrival]:
        """Yield the frames that have come, each with its time in ns of CLOCK_MONOTONIC."""
        if isinstance(self._bus, ReplicatedLink):
            yield from _both(self._bus)
            return
        self._times.look()
        while (message := self._bus.recv(0)) is not None:
            yield Arrival(self._times.arrived_ns(message), frame_of(message))
        self._times.found_empty()


def _both(link: ReplicatedLink) -> Iterator[Arrival]:
    link.pump(time.monotonic_ns())
    while arrivals := link.receive(time.monotonic_ns()):
        yield from arrivals
