"""The bound on the time in which an aircraft must converge after its last fault (`Losses.bound_ns`).

The bound is the sum of these times, each at its longest:

    controllers     the restart of a bus-off controller, and T_lease for the frames that wait in its queue
    a manager       T_lease, for which a manager listens after its start, and its start-up window, in which it waits for
                    PEs that are never heard
    an old epoch    one patience: an epoch that is under way is abandoned when a PE has not answered for so long
    the way back    the hold-down of a PE. It doubles after each loss, up to a minute. The last fault may cause one more
                    loss
    radios          the window in which a radio is measured (ten periods), and two hold-downs of the radio: the first
                    value that is measured may still be rising
    new epochs      one epoch for each of the last changes (`_LAST_EPOCHS` times a quarter of the patience), and the
                    time for which a silence may stay undetected

The losses of a PE are counted from the ALIVE frames of the active manager, which name the available PEs. They are
forgotten after a minute in which the PE is available. The end of a mastership counts as a loss of each PE. The reasons:
a manager that has lost all PEs sends no more ALIVE, and a new manager may remember older losses.

Only a PE that was lost again and again (quarantine) makes the bound long.
"""

from heronry_dg.model import Spec
from heronry_dg.uplinks import radios
from heronry_manager.core.topology import uplink_bus
from heronry_tools.sim.oracles.active_term import ActiveTerm
from heronry_tools.sim.oracles.end_state import unnoticed_ns
from heronry_tools.sim.oracles.limits import (
    FORGIVEN_AFTER_NS,
    HOLD_DOWN_PERIODS,
    LONGEST_HOLD_DOWN_NS,
    PATIENCE_PERIODS,
    RADIO_DOUBLINGS,
    RADIO_WINDOW_PERIODS,
    START_UP_WINDOW_NS,
)
from heronry_tools.sim.world.station import RESTART_NS
from heronry_wire.management import Alive

_LAST_EPOCHS = 4


class Losses:
    """Counts for each PE how often it was lost, as the ALIVE frames of the active manager show."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._names = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._periods = {pe: spec.buses[uplink_bus(spec, pe)].heartbeat_ns for pe in spec.pes}
        periods_ns = [spec.buses[radio].heartbeat_ns for radio in radios(spec)]
        radio_periods = RADIO_WINDOW_PERIODS + 2 * (HOLD_DOWN_PERIODS << RADIO_DOUBLINGS)
        self._radios_ns = radio_periods * max(periods_ns, default=0)
        self._mastership = ActiveTerm(spec)
        self._available: dict[str, int] = {}  # PEs that ALIVE names, and since when (ns)
        self._losses = dict.fromkeys(spec.pes, 0)

    def alive(self, t_ns: int, message: Alive) -> None:
        """Read an ALIVE; an ALIVE of a manager that is not active has no effect."""
        before = self._mastership.number
        if not self._mastership.named(t_ns, message.term):
            return
        named = {self._names[node] for node in message.nodes if node in self._names}
        still = named if message.term == before else frozenset()  # a new mastership may not know the PEs' losses
        for pe in self._available.keys() - still:
            forgiven = t_ns - self._available.pop(pe) >= FORGIVEN_AFTER_NS
            self._losses[pe] = 1 if forgiven else self._losses[pe] + 1
        for pe in named - self._available.keys():
            self._available[pe] = t_ns

    @property
    def available(self) -> frozenset[str]:
        """Return the PEs that the last ALIVE of the active manager named."""
        return frozenset(self._available)

    def bound_ns(self) -> int:
        """Return the longest time in ns from the last fault until the aircraft must have converged.

        Each loss of a PE that was counted so far may make this time longer.
        """
        patience_ns = PATIENCE_PERIODS * max(self._periods.values())
        held_ns = max(
            min(period_ns * HOLD_DOWN_PERIODS << self._losses[pe], LONGEST_HOLD_DOWN_NS)
            for pe, period_ns in self._periods.items()
        )
        new_epochs_ns = _LAST_EPOCHS * patience_ns // 4 + unnoticed_ns(self._spec)
        at_rest_ns = RESTART_NS + 2 * self._mastership.lease_ns + START_UP_WINDOW_NS + patience_ns
        return at_rest_ns + held_ns + self._radios_ns + new_epochs_ns
