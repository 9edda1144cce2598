"""With `without_manager: safe_mode`, a PE that hears no manager sends and drives only what is critical.

When no LEASE was on the managers' bus for T_lease, a PE becomes *orphaned* with its next state frame that reports no
LEASE. The PE stays orphaned until the next LEASE. Meanwhile a module of the PE that serves no critical function in the
PE's epoch must send no datum, and must drive no output. Data that were queued before may still go out for T_lease.

Other oracles verify that critical functions continue (`silence`, `service`), and that all functions return with a
manager (`end_state`). With the policy `keep` this oracle verifies nothing.

Not verified: an epoch whose configuration could not be read back from the frames, and a PE that hears no LEASE although
a LEASE was on the bus.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.traffic import identifiers
from heronry_tools.recording.commanded import Commanded
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.steps_seen import Driven
from heronry_wire.state_frames import PeFlags


def is_critical(spec: Spec, function: str) -> bool:
    """Tell whether there is a phase in which a function is wanted and is in one of the classes A to D."""
    found = spec.functions[function]
    return any(found.criticality_in(p) != "E" and found.priority_in(p) for p in spec.phases or (None,))


def rests(spec: Spec, configuration: Configuration) -> frozenset[str]:
    """Return the modules that stop without a manager: their outputs reach no critical function."""
    left = dict.fromkeys(configuration.modules, True)
    for function in spec.functions.values():
        if is_critical(spec, function.name):
            left |= dict.fromkeys(set(function.outputs) & left.keys(), False)
    changed = True
    while changed:
        needed = {wire.producer for consumer, _, wire in configuration.wires() if not left[consumer]}
        changed = any(left[name] for name in needed)
        left |= dict.fromkeys(needed, False)
    return frozenset(name for name, is_left in left.items() if is_left)


class SafeModeCheck(Oracle):
    """Verifies what PEs without a manager send and drive."""

    def __init__(self, spec: Spec, commanded: Commanded) -> None:
        super().__init__()
        self._applies = spec.manager.without_manager == "safe_mode"
        self._spec, self._commanded = spec, commanded
        self._lease_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns
        self._producer = {identifier: producer for (producer, _), identifier in identifiers(spec).items()}
        self._leased_ns: int | None = None
        self._orphans: dict[str, tuple[int, frozenset[str]]] = {}  # by PE: since when, and modules that must stop
        self._rests: dict[tuple[int, str], frozenset[str]] = {}  # by epoch and PE

    def leased(self, t_ns: int) -> None:
        """Record that a manager has sent a LEASE, so no PE counts as without a manager any more."""
        self._leased_ns = t_ns
        self._orphans.clear()

    def told(self, state: StateSaid) -> None:
        """Record that a PE is orphaned from now on, if the policy is `safe_mode` and three conditions hold.

        - The state of the PE reports that it hears no LEASE.
        - There was a LEASE on the bus, and the last one was sent more than T_lease ago.
        - The PE is not recorded as orphaned yet.
        """
        pe, t_ns, page = state.pe, state.t_ns, state.page
        alone = self._leased_ns is not None and t_ns - self._leased_ns > self._lease_ns
        if self._applies and alone and PeFlags.HEARS_LEASE not in page.flags and pe not in self._orphans:
            self._orphans[pe] = t_ns, self._resting(page.epoch, pe)

    def published(self, sent: Sent) -> None:
        """Verify that a PE without a manager sends no data of modules that serve nothing critical."""
        since_ns, resting = self._orphans.get(sent.sender, (sent.end_ns, frozenset()))
        producer = self._producer.get(sent.frame.can_id)
        if producer in resting and sent.end_ns - since_ns > self._lease_ns:
            self._tell(sent.end_ns, f"{sent.sender} sends {sent.frame.can_id} of {producer}")

    def driven(self, driven: Driven) -> None:
        """Verify that a PE which hears no manager drives no output with a module that serves nothing critical."""
        if driven.module in self._orphans.get(driven.pe, (0, frozenset()))[1]:
            self._tell(driven.t_ns, f"{driven.module} drives on {driven.pe}")

    def _resting(self, epoch: int, pe: str) -> frozenset[str]:
        known = self._commanded.epochs.get(epoch)
        if known is None or known.configuration is None:
            return frozenset()
        if (epoch, pe) not in self._rests:
            here = {name for name, running in known.configuration.modules.items() if running.pe == pe}
            self._rests[epoch, pe] = rests(self._spec, known.configuration) & here
        return self._rests[epoch, pe]

    def _tell(self, t_ns: int, what: str) -> None:
        self.violations.append(Violation(t_ns, "policy", f"{what} without a manager, but serves nothing critical"))
