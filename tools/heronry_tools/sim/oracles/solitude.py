"""Which PEs heard no node for T_lease, and when that ended: they may have missed a command (protocol rule 8).

As the frames of a PE's uplink show: no other node sent there, or the PE did not, since its wire was broken or it stood
still. A PE that was started anew knows nothing of what was before, and while a bus is in two parts it cannot be known
which node heard which.
"""

from heronry_dg.model import Spec
from heronry_manager.core.topology import uplink_bus
from heronry_tools.sim.oracles.limits import LEASE_PERIODS

_SLOWER_PPM = 1_000  # clocks run apart, a PE's and ours: a silence that is as good as T_lease counts


class Solitude:
    """Follows which nodes send on each bus."""

    def __init__(self, spec: Spec) -> None:
        """Begin with every PE having heard another node."""
        self._on = {bus: {pe for pe in spec.pes if uplink_bus(spec, pe) == bus} for bus in spec.buses}
        lease_ns = {name: LEASE_PERIODS * bus.heartbeat_ns for name, bus in spec.buses.items()}
        self._silence_ns = {bus: ns * (10**6 - _SLOWER_PPM) // 10**6 for bus, ns in lease_ns.items()}
        self._last: dict[str, tuple[str, int, int]] = {}  # by bus: its last sender, when, and when another one sent
        self._spoke_ns: dict[tuple[str, str], int] = {}  # by bus and speaker
        self._incarnations: dict[str, int] = {}
        self._ended_ns: dict[str, int] = {}

    def ended_ns(self, pe: str) -> int:
        """Give when a PE heard another node again, the last time; 0 if it always did."""
        return self._ended_ns.get(pe, 0)

    def heard(self, t_ns: int, bus: str, speaker: str) -> None:
        """A PE's state or a manager's ALIVE was on a bus."""
        last, last_ns, other_ns = self._last.get(bus, (speaker, t_ns, t_ns))
        silence_ns = self._silence_ns[bus]
        if t_ns - self._spoke_ns.get((bus, speaker), t_ns) >= silence_ns:
            self._end(t_ns, {speaker} & self._on[bus])
        if t_ns - last_ns >= silence_ns:
            self._end(t_ns, self._on[bus])
        elif speaker != last and t_ns - other_ns >= silence_ns:
            self._end(t_ns, {last} & self._on[bus])
        self._spoke_ns[bus, speaker] = t_ns
        self._last[bus] = (speaker, t_ns, other_ns if speaker == last else last_ns)

    def started(self, t_ns: int, pe: str, incarnation: int) -> None:
        """A PE reports its incarnation."""
        if self._incarnations.setdefault(pe, incarnation) != incarnation:
            self._incarnations[pe] = incarnation
            self._end(t_ns, {pe})

    def split(self, t_ns: int, bus: str) -> None:
        """A bus is broken in the middle, or whole again."""
        self._end(t_ns, self._on[bus])

    def _end(self, t_ns: int, pes: set[str]) -> None:
        self._ended_ns |= dict.fromkeys(pes, t_ns)
