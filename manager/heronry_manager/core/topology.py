"""The routes between the PEs of a spec and the manager's bus. Nothing here depends on what is down."""

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors


def uplink_bus(spec: Spec, pe: str) -> str:
    """Return the bus on which a PE reports: the manager's bus, or else the first bus on the way to the manager's bus.

    A PE without a route to the manager's bus reports on its first bus, and the manager never hears it.
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


def command_period_ns(spec: Spec, pe: str) -> int:
    """Return the period in ns with which LEASE and ALIVE reach a PE: the longest heartbeat period on their route.

    For a PE without a route from the manager, the heartbeat period of its own bus.
    """
    way = {spec.manager.bus, uplink_bus(spec, pe)}
    everything = survivors(spec, Situation())
    for other in spec.pes.values():
        if spec.manager.bus in other.buses:
            way |= set(everything.route(pe, other.name) or ())
    return max(spec.buses[bus].heartbeat_ns for bus in way)


def reached_by_wire(spec: Spec) -> frozenset[str]:
    """Return the PEs that the manager can reach without crossing a radio."""
    radios = frozenset(f"bus:{bus.name}" for bus in spec.buses.values() if bus.kind == "wireless")
    return frozenset(survivors(spec, Situation(radios)).pe_cpu_millis)
