"""How fast the frames of a table follow one another: as fast as the analysis of what runs allows (protocol rule 10).

A transfer has one request of 8 bytes in each period, and at most one answer. Both count in the analysis as frames of
other equipment do (`foreign`), under the SDO identifiers of their PE. The period is the shortest one of SHARES, and no
longer than LONGEST_NS, with which

    - no datum of the running configuration can miss its deadline on any bus
    - data and transfer together stay below `max_load` without the reserve of management

While nothing runs, the shortest period is used, and while something unknown runs, or a configuration is on its way,
none. The routes are those of a system without faults, so a datum counts on each bus that it may cross.

The analysis takes about a millisecond; its result is kept until another configuration runs.
"""

from collections.abc import Iterator
from dataclasses import replace

from heronry_dg.configuration import Configuration
from heronry_dg.model import Bus, Foreign, Spec
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation, survivors
from heronry_dg.traffic import Hop, bus_loads_mbit_per_s, hops
from heronry_manager.core.epochs import Deployment
from heronry_wire.identifiers import sdo_request_id, sdo_response_id
from heronry_wire.sdo import MESSAGE_BYTES
from heronry_wire.timing import worst_bits

SHARES = (10, 20, 40, 80, 160, 320)
"""One request in so many frames of full length: the shortest period first, which takes a tenth of the bus."""

LONGEST_NS = 500_000_000  # a PE drops its client after a second of silence
_NS_PER_S = 1_000_000_000
_FRAMES = 2  # in each period: a request and an answer


class Pace:
    """Gives the period of a transfer, for what runs at the moment."""

    def __init__(self, spec: Spec, bus: Bus, deployment: Deployment) -> None:
        """Analyse nothing yet; `bus`: the one over which tables are brought."""
        self._spec, self._bus, self._deployment = spec, bus, deployment
        self._all_up = survivors(spec, Situation())
        self._found: tuple[Configuration | None, int, int | None] | None = None

    def is_held(self) -> bool:
        """Tell whether no frame of a transfer may be sent now: another configuration is on its way, or one unknown."""
        return self._deployment.is_under_way() or self._deployment.is_held()

    def period_ns(self, node: int) -> int | None:
        """Return the time in ns from one request to the next one; None: no period of SHARES is long enough.

        node: node-ID of the PE that gets a table.
        """
        configuration = self._deployment.configuration
        if self._found is None or self._found[0] is not configuration or self._found[1] != node:
            running = () if configuration is None else hops(self._all_up, configuration)
            fits = (one for one in _periods_ns(self._bus) if self._is_harmless(running, node, one))
            self._found = configuration, node, next(fits, None)
        return self._found[2]

    def _is_harmless(self, running: tuple[Hop, ...], node: int, period_ns: int) -> bool:
        bus = self._bus
        load = bus_loads_mbit_per_s(self._spec, running)[bus.name]
        load += 1000 * _FRAMES * worst_bits(MESSAGE_BYTES) * _NS_PER_S // period_ns
        if load > 1000 * bus.bitrate * (bus.max_load - bus.reserve):
            return False
        more = tuple(
            Foreign(identifier, None, extended=False, data_bytes=MESSAGE_BYTES, period_ns=period_ns)
            for identifier in (sdo_request_id(node), sdo_response_id(node))
        )
        loaded = replace(bus, foreign=(*bus.foreign, *more))
        spec = replace(self._spec, buses={**self._spec.buses, bus.name: loaded})
        return all(one.meets_deadline for one in ResponseTimes(spec).responses(running))


def _periods_ns(bus: Bus) -> Iterator[int]:
    periods_ns = (share * worst_bits(MESSAGE_BYTES) * _NS_PER_S // bus.bitrate for share in SHARES)
    return (one for one in periods_ns if one <= LONGEST_NS)
