"""Faults of PEs: death, pause, broken wires, slow or hanging modules, an inspection by a diagnostic client."""

from collections.abc import Callable
from random import Random

from heronry_tools.sim.faults.fault import KINDS, Fault, replicated_bus
from heronry_tools.sim.flight.injection.inject import End, Inject, in_turns, loosen, nothing
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.world.simulated_pe import SimulatedPe

_STARTS_AGAIN_MS = (5, 200)


def _on_pe(do: Callable[[SimulatedPe, Fault, Random], End]) -> Inject:
    """Make an injection that applies `do` to the PE that the fault names; it does nothing if this PE does not run.

    When the fault ends, nothing is done if the incarnation of the PE into which the fault was injected has ended.
    """

    def inject(simulation: Simulation, fault: Fault, random: Random) -> End | None:
        pe = simulation.fleet.running.get(fault.name)
        if pe is None:
            return None
        end = do(pe, fault, random)
        return lambda: end() if pe.running else None

    return inject


def _on_living(do: Callable[[Simulation, Fault, Random], End | None]) -> Inject:
    """Make an injection that applies `do` to the PE that a fault names; no effect if this PE does not run.

    The PE may restart during the fault. Then the end of the fault applies to the new incarnation.
    """

    def inject(simulation: Simulation, fault: Fault, random: Random) -> End | None:
        return do(simulation, fault, random) if fault.name in simulation.fleet.running else None

    return inject


def _crash(simulation: Simulation, fault: Fault, _: Random) -> End:
    simulation.fleet.kill(fault.name)
    return lambda: simulation.fleet.restore(fault.name)


def _blank(simulation: Simulation, fault: Fault, _: Random) -> End:
    """Let a PE die; at the end of the fault a node without a table takes its place."""
    simulation.fleet.kill(fault.name)
    simulation.fleet.make_blank(fault.name)
    return lambda: simulation.fleet.restore(fault.name)


def _brownout(simulation: Simulation, fault: Fault, random: Random) -> End:
    fleet = simulation.fleet

    def turn() -> int:
        if fault.name in fleet.running:
            fleet.kill(fault.name)
        else:
            fleet.restore(fault.name)
        return random.randint(*_STARTS_AGAIN_MS) * MS

    over = in_turns(simulation, turn)

    def end() -> None:
        over()
        fleet.restore(fault.name)

    return end


def _stale_table(simulation: Simulation, fault: Fault, _: Random) -> End:
    """Restart a PE with the table of another spec; at the end of the fault, restart it with the right table."""
    fleet = simulation.fleet

    def restart() -> None:
        fleet.kill(fault.name)
        fleet.restore(fault.name)

    def end() -> None:
        fleet.make_fresh(fault.name)
        if fault.name in fleet.running:
            restart()

    fleet.make_stale(fault.name)
    restart()
    return end


def _transmit_failed(pe: SimulatedPe, _fault: Fault, _random: Random) -> End:
    pe.wire(transmit_failed=True)
    return lambda: pe.wire(transmit_failed=False)


def _receive_failed(pe: SimulatedPe, _fault: Fault, _random: Random) -> End:
    pe.wire(receive_failed=True)
    return lambda: pe.wire(receive_failed=False)


def _cut(simulation: Simulation, fault: Fault, _: Random) -> End:
    simulation.fleet.cut(fault.name)
    return lambda: simulation.fleet.mend(fault.name)


def _half_cut(simulation: Simulation, fault: Fault, _: Random) -> End | None:
    pe, name = simulation.fleet.running[fault.name], replicated_bus(simulation.spec, fault.name)
    if name is None:
        return None
    wire = simulation.wiring.wires[name][fault.level - 1]
    station = next(station for bus, station in pe.stations if bus is wire)
    wire.wire(station, cut_off=True)
    return lambda: wire.wire(station, cut_off=False) if station.present else None


def _loose(simulation: Simulation, fault: Fault, random: Random) -> End:
    return loosen(simulation, simulation.fleet.running[fault.name], random)


def _pause(pe: SimulatedPe, fault: Fault, _random: Random) -> End:
    pe.pause(fault.lasts_ms * MS)
    return nothing


def _slow(pe: SimulatedPe, _fault: Fault, random: Random) -> End:
    pe.steps.slow = random

    def end() -> None:
        pe.steps.slow = None

    return end


def _stuck(simulation: Simulation, fault: Fault, _: Random) -> End:
    pe = simulation.fleet.running[fault.name]
    pe.steps.stuck = True
    for module in pe.modules:
        simulation.truth.excuse(module)
    return pe.unstick


def _clock_jump(pe: SimulatedPe, fault: Fault, _random: Random) -> End:
    pe.jump(fault.level * MS)
    return nothing


def _bus_off(pe: SimulatedPe, _fault: Fault, _random: Random) -> End:
    for bus, station in pe.stations:
        bus.turn_off(station)
    return nothing


def _bad_transmitter(pe: SimulatedPe, _fault: Fault, _random: Random) -> End:
    for _, station in pe.stations:
        station.fails = True

    def end() -> None:
        for _, station in pe.stations:
            station.fails = False

    return end


def _late(pe: SimulatedPe, fault: Fault, random: Random) -> End:
    pe.outbox.delays = lambda: random.randrange(fault.level * MS)

    def end() -> None:
        pe.outbox.delays = None

    return end


def _inspect(simulation: Simulation, fault: Fault, _: Random) -> End:
    diagnostic_client = simulation.inspect(fault.name)

    def end() -> None:
        if not diagnostic_client.is_done and fault.lasts_ms >= KINDS[fault.kind].lasts_ms[0]:
            simulation.checks.wrong(simulation.now_ns, f"the inspection of {fault.name} did not end")
        diagnostic_client.leave()

    return end


ON_PES: dict[str, Inject] = {
    "crash": _on_living(_crash),
    "reboot": _on_living(_crash),
    "blank": _on_living(_blank),
    "brownout": _on_living(_brownout),
    "stale_table": _on_living(_stale_table),
    "mute": _on_pe(_transmit_failed),
    "deaf": _on_pe(_receive_failed),
    "cut": _on_living(_cut),
    "half_cut": _on_living(_half_cut),
    "loose": _on_living(_loose),
    "pause": _on_pe(_pause),
    "slow": _on_pe(_slow),
    "stuck": _on_living(_stuck),
    "clock_jump": _on_pe(_clock_jump),
    "bus_off": _on_pe(_bus_off),
    "bad_transmitter": _on_pe(_bad_transmitter),
    "late": _on_pe(_late),
    "inspect": _on_living(_inspect),
}
