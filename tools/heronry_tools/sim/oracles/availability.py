"""With a key, forged frames that take less than a tenth of a bus deny no service (protocol rule 11).

The oracle verifies only flights with a key in which all faults are forged frames, and these take less than a tenth of a
bus. Three things must hold in such a flight:

- A function that was heard is never silent for longer than its limit. The limit is T_lease of the slowest bus, or
  `Witness.patience_ns` if that is longer: the longest silence in which the function still counts as served.
- Each ALIVE of the active manager names every PE that the ALIVE before it named.
- The active manager ends no session (it sends no RENEW).

Not verified: a flight with any other fault, or with an order of the operator. Only the other oracles verify such a
flight.
"""

from collections.abc import Collection

from heronry_dg.model import Spec
from heronry_tools.runtime.witness import Witness
from heronry_tools.sim.faults.denial import DENIALS
from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.oracles.limits import LEASE_PERIODS, UNPRICED_PERCENT
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.management import Control, ManagementMessage, Operation


class AvailabilityCheck(Oracle):
    """Finds denials of service: silent functions, and PEs or sessions that the active manager gives up.

    The active manager gives up a PE when ALIVE no longer names the PE, and a session when it sends RENEW.
    """

    def __init__(self, spec: Spec) -> None:
        super().__init__()
        self._spec = spec
        self._pe_of = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._named: frozenset[str] = frozenset()
        self._lost: list[Violation] = []

    def alive(self, t_ns: int, pes: frozenset[str]) -> None:
        """Record the PEs that this ALIVE of the active manager does not name, though the ALIVE before it named them."""
        self._lost += [_violation(t_ns, f"{pe} was left out by the manager") for pe in sorted(self._named - pes)]
        self._named = pes

    def commanded(self, t_ns: int, _station: str, message: ManagementMessage) -> None:
        """Record that the active manager ends the session of a PE, if the command is a RENEW."""
        if isinstance(message, Control) and message.operation is Operation.RENEW:
            self._lost.append(_violation(t_ns, f"the manager has ended its session with {self._pe_of[message.node]}"))

    def denials(self, faults: Collection[Fault], witness: Witness, span_ns: range) -> list[Violation]:
        """Return a violation for each denial of service from the first configuration to the end of a flight.

        These are denials of service:

        - a function is silent for longer than T_lease of the slowest bus and `Witness.patience_ns`
        - an ALIVE of the active manager does not name a PE that the ALIVE before it named
        - the active manager ends its session with a PE

        The list is empty if there was no fault, if any fault was something other than forged frames, or if
        forged frames took a tenth of a bus or more.

        faults: everything that was injected
        span_ns: time of the first configuration, and of the end of the flight
        """
        cheap = all(fault.kind in DENIALS and fault.level < UNPRICED_PERCENT for fault in faults)
        if not faults or not cheap:
            return []
        lease_ns = LEASE_PERIODS * max(bus.heartbeat_ns for bus in self._spec.buses.values())
        silent = [o for o in witness.outages(span_ns.stop) if o.from_ns >= span_ns.start]
        silent = [o for o in silent if (o.to_ns or span_ns.stop) - o.from_ns > lease_ns]
        lost = [one for one in self._lost if one.t_ns >= span_ns.start]
        return lost + [_violation(o.from_ns + lease_ns, f"{o.function} fell silent", o.from_ns) for o in silent]


def _violation(t_ns: int, what: str, since_ns: int | None = None) -> Violation:
    return Violation(t_ns, "availability", f"{what}, though only a few forged frames disturbed the bus", since_ns)
