"""Reports of a PE that it has restarted a module: one event for each restart, though the PE repeats its EMCY.

An EMCY carries the number of restarts of the module, its *count*. The PE repeats the EMCY in each heartbeat period.

    unheard    no EMCY about this module has come, or the last one had another count: an EMCY makes an event
    heard      the last EMCY had this count, and came at most T_lease of the PE's uplink ago: an EMCY makes no event

So there is one event, even if an EMCY is lost, late or doubled. After T_lease without an EMCY, the same count tells of
a new restart, and makes another event. The PE may use a count a second time because it counts from one again in two
cases: the module has run well for long enough, or the PE itself has restarted.

A forged EMCY makes a false event. A manager that restarts may repeat its last event.
"""

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.topology import uplink_bus
from heronry_manager.core.turn import Turn
from heronry_wire.protocol_times import t_lease_ns


class RestartsTold:
    """Reports each restart of a module as one event, though the PE repeats its EMCY."""

    def __init__(self, spec: Spec, turn: Turn) -> None:
        self._spec, self._turn = spec, turn
        self._heard: dict[tuple[str, str], tuple[int, int]] = {}  # by PE and element: the count, and when it came

    def reported(self, pe: str, element: str, times: int) -> None:
        """Process an EMCY in which a PE says how often (`times`) it has restarted the module `element`.

        Emit an event unless the EMCY only repeats the last one.
        """
        now_ns = self._turn.now_ns
        lease_ns = t_lease_ns(self._spec.buses[uplink_bus(self._spec, pe)].heartbeat_ns)
        said, at_ns = self._heard.get((pe, element), (0, 0))
        self._heard[pe, element] = times, now_ns
        if said != times or now_ns - at_ns > lease_ns:
            self._turn.emit(events.ModuleRestarted, element=element, by=pe, times=times)
