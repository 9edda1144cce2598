"""How fast the frames of a table follow one another: as fast as the analysis of what runs allows (protocol rule 10).

A transfer has one request of 8 bytes in each period, and at most one answer. Both count in the analysis as frames of
other equipment do (`foreign`), under the SDO identifiers of their PE, and so do the requests that follow at once when
the manager's process was late (LATE_NS). The period is the shortest one of SHARES, and no longer than LONGEST_NS, with
which

    - no datum of the running configuration can miss its deadline on any bus
    - data, checkpoints, foreign frames and transfer together stay below `max_load` without the reserve of management,
      on each bus on the way to the PE, and within what is left of a radio

While nothing runs, the shortest period is used, and while something unknown runs, or a configuration is on its way,
none. The routes are those of a system without faults, so a datum counts on each bus that it may cross.

The analysis takes about a millisecond; its result is kept until another configuration runs.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from math import ceil

from heronry_dg.checkpoints import loads_mbit_per_s
from heronry_dg.configuration import Configuration
from heronry_dg.model import Bus, Foreign, Spec
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation, room_mbit_per_s, survivors
from heronry_dg.traffic import Hop, bus_loads_mbit_per_s, hops
from heronry_manager.core.epochs import Deployment
from heronry_manager.core.situation import KnownSituation
from heronry_wire.identifiers import sdo_request_id, sdo_response_id
from heronry_wire.sansio import NEVER_NS
from heronry_wire.sdo import LATE_NS, MESSAGE_BYTES
from heronry_wire.timing import worst_bits

SHARES = (10, 20, 40, 80, 160, 320)
"""One request in so many frames of full length: the shortest period first, a tenth of the slowest bus on the way."""

LONGEST_NS = 500_000_000  # a PE drops its client after a second of silence
_NS_PER_S = 1_000_000_000
_FRAMES = 2  # in each period: a request and an answer


class Pace:
    """Gives the period of a transfer, for what runs at the moment."""

    def __init__(self, spec: Spec, deployment: Deployment, situation: KnownSituation) -> None:
        """Analyse nothing yet; `situation` knows what is left of radios."""
        self._spec, self._deployment, self._situation = spec, deployment, situation
        self._all_up = survivors(spec, Situation())
        self._found: tuple[Configuration | None, str, Mapping[str, Fraction], int | None] | None = None

    def way(self, pe: str) -> list[Bus]:
        """Return the buses from the manager to a PE in a system without faults; empty: there is no way."""
        return [self._spec.buses[bus] for bus in self._all_up.way(self._spec.manager.bus, pe)]

    def is_held(self) -> bool:
        """Tell whether no frame of a transfer may be sent now: another configuration is on its way, or one unknown."""
        return self._deployment.is_under_way() or self._deployment.is_held()

    def period_ns(self, pe: str) -> int | None:
        """Return the time in ns from one request to the next one; None: no period of SHARES is long enough.

        pe: the PE that gets a table.
        """
        configuration, limits = self._deployment.configuration, self._situation.links.limits()
        if self._found is None or self._found[0] is not configuration or self._found[1:3] != (pe, limits):
            running = () if configuration is None else hops(self._all_up, configuration)
            way = self.way(pe)
            loads = Counter(bus_loads_mbit_per_s(self._spec, running))
            loads.update({} if configuration is None else loads_mbit_per_s(self._all_up, configuration))
            room = {bus.name: room_mbit_per_s(bus, limits.get(f"bus:{bus.name}", Fraction(1))) for bus in way}
            free = min(room[bus] - loads[bus] for bus in room)
            fits = (one for one in _periods_ns(way) if _takes(one) <= free and self._is_harmless(running, pe, way, one))
            self._found = configuration, pe, limits, next(fits, None)
        return self._found[3]

    def _is_harmless(self, running: tuple[Hop, ...], pe: str, way: list[Bus], period_ns: int) -> bool:
        """Tell whether no datum misses its deadline beside a transfer with this period."""
        spec, node = self._spec, self._spec.pes[pe].node_id
        request, answer = sdo_request_id(node), sdo_response_id(node)
        late = ((request, NEVER_NS),) * ceil(LATE_NS / period_ns)  # each of them at most once while a datum waits
        frames = tuple(
            Foreign(identifier, None, extended=False, data_bytes=MESSAGE_BYTES, period_ns=each_ns)
            for identifier, each_ns in ((request, period_ns), (answer, period_ns), *late)
        )
        loaded = {bus.name: replace(bus, foreign=(*bus.foreign, *frames)) for bus in way}
        return all(
            one.meets_deadline
            for one in ResponseTimes(replace(spec, buses={**spec.buses, **loaded})).responses(running)
        )


def _takes(period_ns: int) -> int:
    """Return what a transfer takes of a bus, in thousandths of a bit/s."""
    return 1000 * _FRAMES * worst_bits(MESSAGE_BYTES) * _NS_PER_S // period_ns


def _periods_ns(way: list[Bus]) -> Iterator[int]:
    slowest = min(bus.bitrate for bus in way)
    periods_ns = (share * worst_bits(MESSAGE_BYTES) * _NS_PER_S // slowest for share in SHARES)
    return (one for one in periods_ns if one <= LONGEST_NS)
