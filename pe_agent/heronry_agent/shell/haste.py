"""When the loop of an agent has to hurry, and what it need not receive.

While nothing is urgent, frames may take a moment, so that the loop wakes less often. Urgent is

    what the manager commands    PREPARE, SLICE, ACTIVATE and PING of either manager, and the time after them, since
                                 this PE's answers decide how long the reconfiguration takes
    what this PE reports         an EMCY or an emergency event

LEASE and ALIVE come in every period and are not urgent: a LEASE with something new follows an ACTIVATE. Data wake the
loop not at all, whether anything is urgent or not (`heronry_wire.patient_port`).
"""

from heronry_wire.frame_port import Arrival
from heronry_wire.identifiers import (
    MANAGER_NODES,
    PE_NODES,
    Command,
    emcy_id,
    emergency_event_id,
    management_id,
    state_id,
)
from heronry_wire.pe_table import PeTable
from heronry_wire.state_frames import NEWS_MASK
from heronry_wire.thinning import Thinned

_HURRY_PERIODS = 2
_COMMANDS = (Command.PREPARE, Command.SLICE, Command.ACTIVATE, Command.PING)


class Haste:
    """Whether something is urgent on a PE; it has no clock."""

    def __init__(self, table: PeTable) -> None:
        """Begin in a hurry: the PE has just started."""
        self._period_ns = table.ports[table.uplink].heartbeat_ns
        self._commands = frozenset(management_id(one, command) for one in MANAGER_NODES for command in _COMMANDS)
        self._reports = frozenset((emcy_id(table.node_id), emergency_event_id(table.node_id)))
        self._until_ns: int | None = None

    def heard(self, arrivals: list[Arrival], now_ns: int) -> None:
        """Note frames that have come."""
        commands = self._commands
        for arrival in arrivals:
            if arrival.frame.can_id in commands:
                self._until_ns = now_ns + _HURRY_PERIODS * self._period_ns

    def sends(self, can_id: int, now_ns: int) -> None:
        """Note a frame that this PE is about to send."""
        if can_id in self._reports:
            self._until_ns = now_ns + _HURRY_PERIODS * self._period_ns

    def is_calm(self, now_ns: int) -> bool:
        """Tell whether nothing is urgent."""
        if self._until_ns is None:
            self._until_ns = now_ns + _HURRY_PERIODS * self._period_ns
        return now_ns >= self._until_ns


def needed_states(table: PeTable) -> Thinned:
    """Return what a PE needs of its neighbours' states: what is new, and a sign of life now and then.

    LEASE is such a sign. Without a manager the signs are far more frequent than once in T_lease.
    """
    neighbours = frozenset(map(state_id, PE_NODES)) - {state_id(table.node_id)}
    signs = frozenset(management_id(one, Command.LEASE) for one in MANAGER_NODES)
    return Thinned(neighbours, signs, NEWS_MASK, table.ports[table.uplink].heartbeat_ns * 3 // 2)
