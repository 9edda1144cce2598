"""A PE without a manager follows its policy, verified from its state frames and the LEASEs on the managers' bus.

Once no manager has been on the bus for T_lease, and a little longer for that to be reported,

- no PE reports that it hears a LEASE (but for what a PE that was cut off had queued before, and could not send);
- `keep`: every PE goes on with what it runs. State, epoch and digest stay as they are, until it restarts or some
  manager sends again. A PE that stood still executes first what it was sent meanwhile, and is verified a heartbeat
  period after that.

`safe_mode` is another policy, and verified by `oracles.safe_mode`.
"""

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.state_frames import PeFlags, PeState, StatePage0, decode_state

_What = tuple[int, PeState, int, int]  # incarnation, state, epoch, digest
_SLACK = 2  # heartbeat periods: one until it is reported, one for clocks and waiting


class OrphanCheck(Oracle):
    """Follows which PEs hear a manager."""

    def __init__(self, spec: Spec, *, has_digests: bool = True) -> None:
        """With a key state frames have a tag in the place of the digest."""
        self._has_digests = has_digests
        super().__init__()
        bus = spec.buses[spec.manager.bus]
        self._keeps = spec.manager.without_manager == "keep"
        self._names = {pe.node_id: pe.name for pe in spec.pes.values() if spec.manager.bus in pe.buses}
        self._patience_ns = (LEASE_PERIODS + _SLACK) * bus.heartbeat_ns
        self._heartbeat_ns = bus.heartbeat_ns
        self._queued_ns = LEASE_PERIODS * bus.heartbeat_ns  # a frame may have waited for so long
        self._spoken_ns: int | None = None  # when some manager sent anything last
        self._heard_ns: dict[int, int] = {}
        self._back_ns: dict[int, int] = {}  # when it was heard again after a silence
        self._orphans: dict[int, _What] = {}  # by node: what it ran when it heard none

    def manager_heard(self, t_ns: int) -> None:
        """A manager was heard on the managers' bus."""
        self._spoken_ns = t_ns

    def state_sent(self, t_ns: int, node: int, data: bytes) -> None:
        """A PE reports what it runs, on the managers' bus."""
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
            self._tell(t_ns, f"{self._names[node]} reports that it hears a manager, and there is none")
        runs = (page.incarnation, page.state, page.epoch, page.digest if self._has_digests else 0)
        before, self._orphans[node] = self._orphans.get(node), runs
        is_settled = node not in self._back_ns or t_ns - self._back_ns[node] >= self._heartbeat_ns
        if self._keeps and is_settled and before is not None and before != runs and before[0] == runs[0]:
            story = (
                f"{self._names[node]} went from {before[1].name} in epoch {before[2]} to {runs[1].name} in {runs[2]}"
            )
            self._tell(t_ns, f"{story} without any manager")

    def _tell(self, t_ns: int, story: str) -> None:
        self.violations.append(Violation(t_ns, "policy", story))
