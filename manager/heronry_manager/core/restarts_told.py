"""Modules that failed and were built anew by their PE: one event each, though the PE repeats its EMCY.

    unheard    no EMCY of this module, or with another count
    heard      this PE has sent this count of this module, and again within T_lease of its bus: no further event

A PE repeats the EMCY in each heartbeat period. Lost, late or doubled: there is one event. An EMCY after a gap of
T_lease makes another event: a PE counts from one anew once it has forgiven a module, or was started anew. Forged: a
false line in the story. A manager that restarts may repeat its last event.
"""

from heronry_dg.model import Spec
from heronry_manager.core.topology import uplink_bus
from heronry_manager.core.turn import Turn
from heronry_wire.protocol_times import t_lease_ns


class RestartsTold:
    """The last restart count of each module, by PE."""

    def __init__(self, spec: Spec, turn: Turn) -> None:
        self._spec, self._turn = spec, turn
        self._heard: dict[tuple[str, str], tuple[int, int]] = {}  # by PE and element: the count, and when it came

    def reported(self, pe: str, element: str, times: int) -> None:
        """Take a PE's report of how often it has built a module anew."""
        now_ns = self._turn.now_ns
        lease_ns = t_lease_ns(self._spec.buses[uplink_bus(self._spec, pe)].heartbeat_ns)
        said, at_ns = self._heard.get((pe, element), (0, 0))
        self._heard[pe, element] = times, now_ns
        if said != times or now_ns - at_ns > lease_ns:
            self._turn.emit("module_restarted", element=element, by=pe, times=times)
