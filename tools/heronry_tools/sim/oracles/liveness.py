"""How long an aircraft that is left alone may take until all is well: the bound of the second half of a flight.

From the moment at which nothing more is done to it (`bound_ns`), one after the other and each at its longest:

    controllers     a bus-off controller is started again, and what was queued for T_lease is sent
    a manager       one that has just been started listens for T_lease, and its start-up window is open for PEs that
                    will never be heard
    an old epoch    one that was under way is abandoned when a PE has kept it waiting for all its patience
    the way back    a PE starts and speaks, and is held down; after each loss for twice as long, up to a minute. How
                    often it was lost is read from ALIVE, which names the available PEs: losses that lie further
                    back than a minute of availability are forgotten; a new mastership may remember the others, and
                    each mastership's end may be one, for a manager that has lost all PEs sends nothing more. One
                    more loss may follow from what was done last
    radios          what is measured of one is ten periods old, and more bandwidth is believed after a hold-down, in two
                    steps at most: the first while the measure still rises
    new epochs      one for each of the last changes, `_LAST_EPOCHS` times a quarter of the patience, and the time that
                    silence goes unnoticed

So the bound is long only where a PE has been lost again and again (quarantine).
"""

from heronry_dg.model import Spec
from heronry_manager.core.topology import radios, uplink_bus
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
    """How often each PE was lost, as the ALIVE frames of the active manager show."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._names = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._periods = {pe: spec.buses[uplink_bus(spec, pe)].heartbeat_ns for pe in spec.pes}
        periods_ns = [spec.buses[radio].heartbeat_ns for radio in radios(spec)]
        radio_periods = RADIO_WINDOW_PERIODS + 2 * (HOLD_DOWN_PERIODS << RADIO_DOUBLINGS)
        self._radios_ns = radio_periods * max(periods_ns, default=0)
        self._mastership = ActiveTerm(spec)
        self._available: dict[str, int] = {}  # and since when
        self._losses = dict.fromkeys(spec.pes, 0)

    def alive(self, t_ns: int, message: Alive) -> None:
        """Follow an ALIVE; of two managers at once the active one counts."""
        before = self._mastership.number
        if not self._mastership.named(t_ns, message.term):
            return
        named = {self._names[node] for node in message.nodes if node in self._names}
        still = named if message.term == before else frozenset()  # a new mastership finds the available PEs by itself
        for pe in self._available.keys() - still:
            forgiven = t_ns - self._available.pop(pe) >= FORGIVEN_AFTER_NS
            self._losses[pe] = 1 if forgiven else self._losses[pe] + 1
        for pe in named - self._available.keys():
            self._available[pe] = t_ns

    @property
    def available(self) -> frozenset[str]:
        """PEs that the last ALIVE named."""
        return frozenset(self._available)

    def bound_ns(self) -> int:
        """Longest time from now on until all is well, if nothing more is done."""
        patience_ns = PATIENCE_PERIODS * max(self._periods.values())
        held_ns = max(
            min(period_ns * HOLD_DOWN_PERIODS << self._losses[pe], LONGEST_HOLD_DOWN_NS)
            for pe, period_ns in self._periods.items()
        )
        new_epochs_ns = _LAST_EPOCHS * patience_ns // 4 + unnoticed_ns(self._spec)
        at_rest_ns = RESTART_NS + 2 * self._mastership.lease_ns + START_UP_WINDOW_NS + patience_ns
        return at_rest_ns + held_ns + self._radios_ns + new_epochs_ns
