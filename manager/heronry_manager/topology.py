"""How the PEs of a spec hang together, seen from the manager's bus. Nothing here depends on what is down."""

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors


def uplink_bus(spec: Spec, pe: str) -> str:
    """Bus on which a PE reports: the manager's bus, or the first one on the way there.

    A PE without any way to the manager reports on its first bus, and is never heard.
    """
    buses = spec.pes[pe].buses
    if spec.manager.bus in buses:
        return spec.manager.bus
    everything = survivors(spec, Situation())
    for other in spec.pes.values():
        route = everything.route(pe, other.name)
        if route and spec.manager.bus in other.buses:
            return route[0]
    return buses[0]


def reached_by_wire(spec: Spec) -> frozenset[str]:
    """PEs that have no radio between themselves and the manager's bus."""
    radios = frozenset(f"bus:{bus.name}" for bus in spec.buses.values() if bus.kind == "wireless")
    return frozenset(survivors(spec, Situation(radios)).pe_cpu_millis)
