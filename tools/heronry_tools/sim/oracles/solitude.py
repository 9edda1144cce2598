"""Which PEs heard no node for T_lease, and when this silence ended.

Such a PE may have missed a command (protocol rule 8). The silence is derived from the frames on the PE's uplink: either
no other node sent there, or the PE itself did not send, because its wire was broken or it was paused.

Two other events also count as the end of a silence:

- a restart of a PE: the PE has no commands from before its start;
- a break in the middle of a bus, or its repair, for every PE on the bus: the frames do not show which node heard which.
"""

from heronry_dg.model import Spec
from heronry_manager.core.topology import uplink_bus
from heronry_tools.sim.oracles.limits import LEASE_PERIODS

_SLOWER_PPM = 1_000  # a silence that is shorter than T_lease by this part counts, too: a PE's clock may be fast


class Solitude:
    """Finds each PE that heard no other node for T_lease, and the time at which it then heard a node again."""

    def __init__(self, spec: Spec) -> None:
        """Assume at the beginning that every PE has just heard another node."""
        self._on = {bus: {pe for pe in spec.pes if uplink_bus(spec, pe) == bus} for bus in spec.buses}
        lease_ns = {name: LEASE_PERIODS * bus.heartbeat_ns for name, bus in spec.buses.items()}
        self._silence_ns = {bus: ns * (10**6 - _SLOWER_PPM) // 10**6 for bus, ns in lease_ns.items()}
        self._last: dict[str, tuple[str, int, int]] = {}  # by bus: last sender, when it sent, when another sent
        self._spoke_ns: dict[tuple[str, str], int] = {}  # by bus and speaker
        self._incarnations: dict[str, int] = {}
        self._ended_ns: dict[str, int] = {}

    def ended_ns(self, pe: str) -> int:
        """Return the time in ns at which a PE last heard a node again after a silence of T_lease; 0 if never."""
        return self._ended_ns.get(pe, 0)

    def heard(self, t_ns: int, bus: str, speaker: str) -> None:
        """Record that `speaker`, a PE or a manager, was heard on a bus."""
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
        """Record the incarnation that a PE reports; a new incarnation counts as the end of a silence.

        After a silence a PE may have missed commands. In the same way, a restarted PE has no commands from before its
        start.
        """
        if self._incarnations.setdefault(pe, incarnation) != incarnation:
            self._incarnations[pe] = incarnation
            self._end(t_ns, {pe})

    def split(self, t_ns: int, bus: str) -> None:
        """Record that a bus has broken or was repaired; every PE on this bus may have missed a command."""
        self._end(t_ns, self._on[bus])

    def _end(self, t_ns: int, pes: set[str]) -> None:
        self._ended_ns |= dict.fromkeys(pes, t_ns)
