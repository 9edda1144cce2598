"""Faults of buses and their channels: noise, broken wires, a lower bit rate, broken links of gateways."""

from dataclasses import replace
from random import Random

from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.flight.injection.inject import End, Inject
from heronry_tools.sim.flight.simulation import Simulation
from heronry_wire.identifiers import MANAGER_NODES


def _channel_loss(simulation: Simulation, fault: Fault, _: Random) -> End:
    simulation.break_channel(fault.name)
    return lambda: simulation.mend_channel(fault.name)


def _bus_split(simulation: Simulation, fault: Fault, random: Random) -> End:
    """Break a bus in the middle, with one manager on each side; `random` decides on which side each PE is.

    If the level of the fault is 1, frames still pass in one of the two directions.
    """
    managers = [f"manager {node}" for node in random.sample(MANAGER_NODES, 2)]
    beyond = {managers[0], *(pe for pe in simulation.spec.pes if random.randrange(2))}
    wires, one_way = simulation.wiring.wires[fault.name], fault.level == 1

    def apart(sender: str, receiver: str) -> bool:
        return (sender in beyond) > (receiver in beyond) or (not one_way and (receiver in beyond) > (sender in beyond))

    def end() -> None:
        for wire in wires:
            wire.apart = None
        simulation.checks.bus_split(simulation.now_ns, fault.name, False)

    for wire in wires:
        wire.apart = apart
    simulation.checks.bus_split(simulation.now_ns, fault.name, True)
    return end


def _share(field: str) -> Inject:
    """Return an injection that sets one probability of a bus to the fault's level, in thousandths.

    field: the probability: `loss`, `omission` or `doubled`.
    """

    def inject(simulation: Simulation, fault: Fault, _: Random) -> End:
        wires, before = simulation.wiring.wires[fault.name], getattr(simulation.wiring.faults, field)
        for wire in wires:
            wire.faults = replace(wire.faults, **{field: fault.level / 1000})

        def end() -> None:
            for wire in wires:
                wire.faults = replace(wire.faults, **{field: before})

        return end

    return inject


def _burst(simulation: Simulation, fault: Fault, _: Random) -> End:
    wires = simulation.wiring.wires[fault.name]
    for wire in wires:
        wire.noisy += 1

    def end() -> None:
        for wire in wires:
            wire.noisy -= 1

    return end


def _collapse(simulation: Simulation, fault: Fault, _: Random) -> End:
    wires = simulation.wiring.wires[fault.name]
    for wire in wires:
        wire.slowdown = fault.level

    def end() -> None:
        for wire in wires:
            wire.slowdown = 1

    return end


def _link(direction: str) -> Inject:
    """Return an injection that breaks the link of every gateway to the fault's bus, in one direction or in both.

    direction: the argument of `SimulatedBus.wire` that is set: `cut_off`, `transmit_failed` or `receive_failed`.
    """

    def inject(simulation: Simulation, fault: Fault, _: Random) -> End | None:
        gateways = [pe for pe in simulation.fleet.running.values() if len({bus.name for bus, _ in pe.stations}) > 1]
        wires = [wire for pe in gateways for wire in pe.stations if wire[0].name == fault.name]
        for bus, station in wires:
            bus.wire(station, **{direction: True})

        def end() -> None:
            for bus, station in wires:
                bus.wire(station, **{direction: False})

        return end if wires else None

    return inject


ON_BUSES: dict[str, Inject] = {
    "channel_loss": _channel_loss,
    "bus_split": _bus_split,
    "loss": _share("loss"),
    "omission": _share("omission"),
    "doubled": _share("doubled"),
    "burst": _burst,
    "collapse": _collapse,
    "link_cut": _link("cut_off"),
    "link_up_only": _link("transmit_failed"),
    "link_down_only": _link("receive_failed"),
}
