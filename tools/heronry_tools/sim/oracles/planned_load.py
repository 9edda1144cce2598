"""Once the aircraft has converged, the buses carry the planned data, and no other data.

Frames are counted from `begin` on. No source of the last epoch may send at more than its rate, and no other source may
send anything. (A source that sends too little is detected by the oracles `freshness`, `service` and `end_state`.) A PE
that cannot reach the manager gets no plan, so its data are not counted.
"""

from collections import Counter

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_dg.traffic import hops, identifiers
from heronry_tools.recording.commanded import Epoch
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent

_MHZ_NS = 10**12
_MORE = 3  # tolerated frames of a source: one at either end of the time, and one early frame after a late one
_FAST = 1.002  # tolerated factor of a rate: clocks are inaccurate


class PlannedLoadCheck(Oracle):
    """Counts data frames by bus, identifier and sender, to find data that were not planned."""

    def __init__(self, spec: Spec) -> None:
        super().__init__()
        self._spec = spec
        self._all = survivors(spec, Situation())
        self._names = {number: source for source, number in identifiers(spec).items()}
        self._since_ns: int | None = None
        self._counts: Counter[tuple[str, int, str]] = Counter()  # bus, identifier, sender

    def begin(self, t_ns: int) -> None:
        """Count data frames from now on; earlier frames do not count."""
        self._since_ns = t_ns
        self._counts.clear()

    def published(self, sent: Sent) -> None:
        """Count a data frame for its bus, identifier and sender; no effect before `begin`."""
        if self._since_ns is not None:
            self._counts[sent.bus, sent.frame.can_id, sent.sender] += 1

    def unplanned(self, t_ns: int, current: Epoch | None, truth: Situation) -> list[Violation]:
        """Return a violation for each source that a bus has carried more often since `begin` than `current` plans.

        current: the epoch activated last; None: nothing is verified.
        truth: the real situation; frames of a PE that is down, or cut off from the manager, do not count.
        """
        if self._since_ns is None or current is None or current.configuration is None:
            return []
        modules = self._spec.modules
        planned = {
            (hop.bus, hop.producer, hop.variable): modules[hop.producer].modes[hop.mode].rate_mhz
            for hop in hops(self._all, current.configuration)
        }
        reached = survivors(self._spec, truth).pe_cpu_millis
        counts: Counter[tuple[str, int]] = Counter()
        for (bus, identifier, sender), count in self._counts.items():
            counts[bus, identifier] += count if sender in reached else 0
        found = []
        for (bus, identifier), count in sorted(counts.items()):
            producer, variable = self._names.get(identifier, ("no module", str(identifier)))
            rate_mhz = planned.get((bus, producer, variable), 0)
            most = (t_ns - self._since_ns) * rate_mhz / _MHZ_NS * _FAST + (_MORE if rate_mhz else 0)
            if count > most:
                story = f"{bus} carried {count} frames of {variable} of {producer}, but at most {most:.0f} were planned"
                found.append(Violation(t_ns, "planned_load", story))
        return found
