"""The ways of frames from the PEs to the managers, and the radios on which gateways report there.

Nothing here depends on what is down.
"""

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
    report_way: the buses that carry the reports, from the gateway to the manager's bus.
    beyond: the PEs that the manager can reach only over this bus.
    """

    bus: str
    link_id: int
    gateway: str
    report_way: tuple[str, ...]
    beyond: frozenset[str]


def uplinks(spec: Spec) -> dict[str, tuple[str, ...]]:
    """Return the buses from each PE that a manager reaches to the manager's bus, this bus included, in order."""
    left, hub = survivors(spec, Situation()), spec.manager.bus
    doors = [pe.name for pe in spec.pes.values() if hub in pe.buses]
    ways: dict[str, tuple[str, ...]] = {}
    for pe in left.pe_cpu_millis:
        route = (hub,) if hub in spec.pes[pe].buses else left.route(pe, doors[0]) or ()
        ways[pe] = route if hub in route else (*route, hub)
    return ways


def radios(spec: Spec) -> dict[str, Radio]:
    """Return every radio that a gateway reports on, by name; gateways can report on the first nine radios of a spec."""
    wireless = [bus.name for bus in spec.buses.values() if bus.kind == "wireless"][: len(GATEWAY_IDS)]
    ways = uplinks(spec) if wireless else {}
    found = {}
    for number, bus in enumerate(wireless):
        near = (pe for pe, way in ways.items() if bus in spec.pes[pe].buses and bus not in way)
        gateway = next(near, None)
        if gateway is not None:
            beyond = frozenset(pe for pe, way in ways.items() if bus in way)
            found[bus] = Radio(bus, link_id(number), gateway, ways[gateway], beyond)
    return found
