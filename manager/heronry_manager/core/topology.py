"""The routes between the PEs of a spec and the manager's bus. Nothing here depends on what is down."""

from dataclasses import dataclass

from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_wire.gateway_report import link_id
from heronry_wire.identifiers import GATEWAY_IDS


@dataclass(frozen=True, slots=True)
class Radio:
    """A wireless bus that a gateway reports on.

    link_id: CAN identifier of the gateway's reports on this bus.
    gateway: the PE between this bus and the manager.
    beyond: the PEs that the manager can reach only over this bus.
    """

    bus: str
    link_id: int
    gateway: str
    beyond: frozenset[str]


def uplink_bus(spec: Spec, pe: str) -> str:
    """Give the bus on which a PE reports: the manager's bus, or else the first bus on the way to the manager's bus.

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
    """Give the period in ns with which LEASE and ALIVE reach a PE: the longest heartbeat period on their route.

    For a PE without a route from the manager, the heartbeat period of its own bus.
    """
    way = {spec.manager.bus, uplink_bus(spec, pe)}
    everything = survivors(spec, Situation())
    for other in spec.pes.values():
        if spec.manager.bus in other.buses:
            way |= set(everything.route(pe, other.name) or ())
    return max(spec.buses[bus].heartbeat_ns for bus in way)


def reached_by_wire(spec: Spec) -> frozenset[str]:
    """Give the PEs that the manager can reach without crossing a radio."""
    radios = frozenset(f"bus:{bus.name}" for bus in spec.buses.values() if bus.kind == "wireless")
    return frozenset(survivors(spec, Situation(radios)).pe_cpu_millis)


def radios(spec: Spec) -> dict[str, Radio]:
    """Give every radio that a gateway reports on, by name; gateways can report on the first nine radios of a spec."""
    wireless = [bus.name for bus in spec.buses.values() if bus.kind == "wireless"][: len(GATEWAY_IDS)]
    all_pes = survivors(spec, Situation()).pe_cpu_millis.keys()
    found = {}
    for number, bus in enumerate(wireless):
        near = survivors(spec, Situation(frozenset({f"bus:{bus}"}))).pe_cpu_millis.keys()
        gateway = next((pe for pe in spec.pes if pe in near and bus in spec.pes[pe].buses), None)
        if gateway is not None:
            found[bus] = Radio(bus, link_id(number), gateway, frozenset(all_pes - near))
    return found
