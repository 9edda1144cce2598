"""The 11-bit identifiers that a system itself may use on each bus, in any configuration, with their senders.

On a bus with a PE these are the identifiers of its EMCYs, emergency events, states, SDO frames, CANopen heartbeats and
echoes, and of those PEs whose frames gateways forward to the bus; those of both managers; those of the reports on
radios; and those of the data and checkpoints that some configuration sends there. Commands of CANopen (NMT, TIME,
SYNC) and node services are not among them.
"""

from collections import defaultdict
from collections.abc import Iterator

from heronry_dg.checkpoints import carriers, kept_modules
from heronry_dg.echo_rates import EchoRates
from heronry_dg.model import Module, Spec
from heronry_dg.situation import Situation, Survivors, hosts_when_all_is_up, survivors
from heronry_dg.traffic import Hop, identifiers
from heronry_dg.uplinks import radios
from heronry_wire.identifiers import (
    MANAGER_NODES,
    Command,
    actuator_echo_id,
    checkpoint_id,
    emcy_id,
    emergency_event_id,
    heartbeat_id,
    management_id,
    sdo_request_id,
    sdo_response_id,
    state_id,
)


def own_identifiers(spec: Spec) -> dict[str, dict[int, str]]:
    """Return for each bus each identifier that the system may use there, with words for what it carries.

    Raises WireError where the spec has more sources than identifiers.
    """
    rates, given, hops = EchoRates(spec), identifiers(spec), possible_hops(spec)
    measured, used = radios(spec).values(), dict[str, dict[int, str]]()
    left = survivors(spec, Situation())
    for bus in spec.buses:
        here = used[bus] = dict(_of_the_managers())
        for pe in spec.pes.values():
            if rates.carries(bus, pe.name):
                here.update(_of_a_pe(pe.node_id, pe.name))
        here.update((one.link_id, f"reports on '{one.bus}'") for one in measured if bus in one.report_way)
        here.update(_of_checkpoints(spec, left, bus))
        here.update((given[h.producer, h.variable], f"'{h.variable}' from '{h.producer}'") for h in hops[bus])
    return used


def possible_hops(spec: Spec) -> dict[str, list[Hop]]:
    """Return for each bus every source that may have to be sent there.

    These are the sources for which the bus lies between a PE on which the producer may run and a PE on which
    another module that reads the variable may run. The mode of a hop is the one in which the producer gives
    the variable at the fastest rate.
    """
    left = survivors(spec, Situation())
    hosts = {name: hosts_when_all_is_up(spec, module) for name, module in spec.modules.items()}
    readers = _readers(spec)
    found: dict[str, list[Hop]] = {bus: [] for bus in spec.buses}
    for producer, variable in spec.sources():
        read_on = {pe for reader in readers[variable] if reader != producer for pe in hosts[reader]}
        crossed = {bus for here in hosts[producer] for there in read_on for bus in left.route(here, there) or ()}
        mode = _fastest(spec.modules[producer], variable)
        for bus in found.keys() & crossed:
            found[bus].append(Hop(producer, variable, mode, bus))
    return found


def _of_the_managers() -> Iterator[tuple[int, str]]:
    for node in MANAGER_NODES:
        yield from ((management_id(node, command), command.name) for command in Command)
        yield emcy_id(node), "EMCYs of a manager"
        yield heartbeat_id(node), "CANopen heartbeats of a manager"
        yield sdo_request_id(node), "SDO requests to a manager"
        yield sdo_response_id(node), "SDO answers of a manager"


def _of_checkpoints(spec: Spec, left: Survivors, bus: str) -> Iterator[tuple[int, str]]:
    """Yield the identifiers of the PEs whose checkpoints a bus may carry."""
    for name in kept_modules(spec):
        for pe in hosts_when_all_is_up(spec, spec.modules[name]):
            if bus in carriers(left, spec.modules[name], pe):
                yield checkpoint_id(spec.pes[pe].node_id), f"checkpoints of pe '{pe}'"


def _of_a_pe(node: int, name: str) -> Iterator[tuple[int, str]]:
    yield emcy_id(node), f"EMCYs of pe '{name}'"
    yield emergency_event_id(node), f"emergency events of pe '{name}'"
    yield state_id(node), f"states of pe '{name}'"
    yield sdo_response_id(node), f"SDO answers of pe '{name}'"
    yield sdo_request_id(node), f"SDO requests to pe '{name}'"
    yield heartbeat_id(node), f"CANopen heartbeats of pe '{name}'"
    yield actuator_echo_id(node), f"echoes of pe '{name}'"


def _readers(spec: Spec) -> dict[str, set[str]]:
    readers: dict[str, set[str]] = defaultdict(set)
    for module in spec.modules.values():
        for mode in module.modes.values():
            for _, leaf in mode.leaves():
                readers[leaf.variable].add(module.name)
    return readers


def _fastest(module: Module, variable: str) -> str:
    giving = [mode for mode in module.modes.values() if variable in mode.gives]
    return max(giving, key=lambda mode: mode.rate_mhz).name
