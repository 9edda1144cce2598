"""A PE without a manager follows its policy; verified from its state frames and from the LEASEs on the managers' bus.

The PEs need some time to report that no manager sends. So the oracle begins to verify when no manager has sent for
T_lease and two more heartbeat periods. From then on two rules hold:

- No PE reports that it hears a LEASE, except in a state frame that was queued while the PE was cut off.
- With the policy `keep` every PE keeps what it runs: state, epoch and digest stay as they are until the PE restarts or
  a manager sends again. This rule does not apply to a PE for a heartbeat period after the PE is heard again: after a
  pause the PE first executes the commands that it received during the pause.

`safe_mode`, the other policy, is verified by `oracles.safe_mode`.
"""

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.state_frames import PeFlags, PeState, StatePage0, decode_state

_What = tuple[int, PeState, int, int]  # incarnation, state, epoch, digest
_SLACK = 2  # heartbeat periods: one until the PE reports, one for clock errors and queues


class OrphanCheck(Oracle):
    """Verifies what PEs report while no manager sends.

    No PE may report that it hears a LEASE. With the policy `keep`, no PE may change its state, epoch or digest.
    """

    def __init__(self, spec: Spec, *, has_digests: bool = True) -> None:
        """Begin with no state frame seen.

        has_digests: False in flights with a key, in which state frames have a tag in the place of the digest.
        """
        self._has_digests = has_digests
        super().__init__()
        bus = spec.buses[spec.manager.bus]
        self._keeps = spec.manager.without_manager == "keep"
        self._names = {pe.node_id: pe.name for pe in spec.pes.values() if spec.manager.bus in pe.buses}
        self._patience_ns = (LEASE_PERIODS + _SLACK) * bus.heartbeat_ns
        self._heartbeat_ns = bus.heartbeat_ns
        self._queued_ns = LEASE_PERIODS * bus.heartbeat_ns  # a frame may have waited for so long
        self._spoken_ns: int | None = None  # when any manager sent last
        self._heard_ns: dict[int, int] = {}
        self._back_ns: dict[int, int] = {}  # by node: when it was heard again after a silence
        self._orphans: dict[int, _What] = {}  # by node: its last report since managers fell silent

    def manager_heard(self, t_ns: int) -> None:
        """Record that a manager was heard on the managers' bus."""
        self._spoken_ns = t_ns

    def state_sent(self, t_ns: int, node: int, data: bytes) -> None:
        """Verify what a PE reports in a state frame on the managers' bus while no manager sends."""
        if t_ns - self._heard_ns.get(node, t_ns) > self._queued_ns:
            self._back_ns[node] = t_ns
        self._heard_ns[node] = t_ns
        if self._spoken_ns is None or t_ns - self._spoken_ns <= self._patience_ns:
            self._orphans.clear()
            return
        page = decode_state(data)
        if node not in self._names or not isinstance(page, StatePage0):
            return
        if PeFlags.HEARS_LEASE in page.flags and t_ns - self._spoken_ns > self._patience_ns + self._queued_ns:
            self._tell(t_ns, f"{self._names[node]} reports that it hears a manager, but no manager was on the bus")
        runs = (page.incarnation, page.state, page.epoch, page.digest if self._has_digests else 0)
        before, self._orphans[node] = self._orphans.get(node), runs
        is_settled = node not in self._back_ns or t_ns - self._back_ns[node] >= self._heartbeat_ns
        if self._keeps and is_settled and before is not None and before != runs and before[0] == runs[0]:
            story = (
                f"{self._names[node]} went from {before[1].name} in epoch {before[2]} to {runs[1].name} in {runs[2]}"
            )
            self._tell(t_ns, f"{story} while no manager was on the bus")

    def _tell(self, t_ns: int, story: str) -> None:
        self.violations.append(Violation(t_ns, "policy", story))
