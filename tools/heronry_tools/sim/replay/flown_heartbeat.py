"""Finds the heartbeat period with which a recording was flown: that of the spec, or a longer one.

On a computer that cannot keep the spec's heartbeat period, `heronry demo` uses a longer one: the usual period
(`USUAL_HEARTBEAT_NS`), doubled as often as needed. Every time of the protocol follows from the period of the flight, so
the core that replays must use the same period.

The recording shows the period, since a manager sends one LEASE in each period. A late LEASE makes one interval between
two LEASEs longer and the next one shorter, so the median of all intervals is close to the period. Of all possible
periods, the one that is nearest to the median is taken. A recording with fewer than `_FEWEST` intervals shows too
little, and is replayed with the spec's own period.
"""

from itertools import pairwise
from math import log2
from statistics import median

from heronry_dg.model import Spec
from heronry_tools.recording.masterships import RecordedMastership
from heronry_tools.runtime.wake_ups import LONGEST_HEARTBEAT_NS, with_heartbeat
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS

_FEWEST = 4


def as_flown(spec: Spec, masterships: list[RecordedMastership]) -> Spec:
    """Return the spec with the heartbeat periods with which the recording was flown.

    Returns `spec` itself if the recording was flown with the spec's own periods, or has fewer than `_FEWEST`
    intervals between two LEASEs.
    """
    intervals = [
        later - earlier for one in masterships for (earlier, _), (later, _) in pairwise(one.leases) if later > earlier
    ]
    if len(intervals) < _FEWEST:
        return spec
    measured_ns = median(intervals)
    slower = [with_heartbeat(spec, period_ns) for period_ns in _stretched()]
    return min((spec, *slower), key=lambda one: abs(log2(period_ns(one) / measured_ns)))


def period_ns(spec: Spec) -> int:
    """Return the heartbeat period of the manager's bus."""
    return spec.buses[spec.manager.bus].heartbeat_ns


def _stretched() -> list[int]:
    periods = [USUAL_HEARTBEAT_NS]
    while periods[-1] < LONGEST_HEARTBEAT_NS:
        periods.append(2 * periods[-1])
    return periods
