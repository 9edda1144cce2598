"""What befalls PEs: they die, stand still, are not heard, compute slowly or for ever, or are inspected."""

from collections.abc import Callable
from random import Random

from heronry_tools.sim.faults.fault import KINDS, Act, replicated_bus
from heronry_tools.sim.flight.injection.strike import End, Strike, in_turns, loosen, nothing
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.world.simulated_pe import SimulatedPe

_STARTS_AGAIN_MS = (5, 200)


def _on_pe(do: Callable[[SimulatedPe, Act, Random], End]) -> Strike:
    """Strike a PE that lives; what ends it is done to that very incarnation."""

    def strike(simulation: Simulation, act: Act, random: Random) -> End | None:
        pe = simulation.fleet.running.get(act.name)
        if pe is None:
            return None
        end = do(pe, act, random)
        return lambda: end() if pe.running else None

    return strike


def _on_living(do: Callable[[Simulation, Act, Random], End | None]) -> Strike:
    """Strike where a PE of that name lives; what ends it is done to whatever runs under its name then."""

    def strike(simulation: Simulation, act: Act, random: Random) -> End | None:
        return do(simulation, act, random) if act.name in simulation.fleet.running else None

    return strike


def _crash(simulation: Simulation, act: Act, _: Random) -> End:
    simulation.fleet.kill(act.name)
    return lambda: simulation.fleet.restore(act.name)


def _brownout(simulation: Simulation, act: Act, random: Random) -> End:
    fleet = simulation.fleet

    def turn() -> int:
        if act.name in fleet.running:
            fleet.kill(act.name)
        else:
            fleet.restore(act.name)
        return random.randint(*_STARTS_AGAIN_MS) * MS

    over = in_turns(simulation, turn)

    def end() -> None:
        over()
        fleet.restore(act.name)

    return end


def _stale_table(simulation: Simulation, act: Act, _: Random) -> End:
    """A PE is restarted with the table of another spec, and at the end with the right one."""
    fleet = simulation.fleet

    def restart() -> None:
        fleet.kill(act.name)
        fleet.restore(act.name)

    def end() -> None:
        fleet.make_fresh(act.name)
        if act.name in fleet.running:
            restart()

    fleet.make_stale(act.name)
    restart()
    return end


def _mute(pe: SimulatedPe, _act: Act, _random: Random) -> End:
    pe.wire(mute=True)
    return lambda: pe.wire(mute=False)


def _deaf(pe: SimulatedPe, _act: Act, _random: Random) -> End:
    pe.wire(deaf=True)
    return lambda: pe.wire(deaf=False)


def _cut(simulation: Simulation, act: Act, _: Random) -> End:
    simulation.fleet.cut(act.name)
    return lambda: simulation.fleet.mend(act.name)


def _half_cut(simulation: Simulation, act: Act, _: Random) -> End | None:
    pe, name = simulation.fleet.running[act.name], replicated_bus(simulation.spec, act.name)
    if name is None:
        return None
    wire = simulation.wiring.wires[name][act.level - 1]
    station = next(station for bus, station in pe.stations if bus is wire)
    wire.wire(station, cut_off=True)
    return lambda: wire.wire(station, cut_off=False) if station.present else None


def _loose(simulation: Simulation, act: Act, random: Random) -> End:
    return loosen(simulation, simulation.fleet.running[act.name], random)


def _pause(pe: SimulatedPe, act: Act, _random: Random) -> End:
    pe.pause(act.lasts_ms * MS)
    return nothing


def _slow(pe: SimulatedPe, _act: Act, random: Random) -> End:
    pe.steps.slow = random

    def end() -> None:
        pe.steps.slow = None

    return end


def _stuck(simulation: Simulation, act: Act, _: Random) -> End:
    pe = simulation.fleet.running[act.name]
    pe.steps.stuck = True
    for module in pe.modules:
        simulation.truth.excuse(module)
    return pe.unstick


def _clock_jump(pe: SimulatedPe, act: Act, _random: Random) -> End:
    pe.jump(act.level * MS)
    return nothing


def _bus_off(pe: SimulatedPe, _act: Act, _random: Random) -> End:
    for bus, station in pe.stations:
        bus.turn_off(station)
    return nothing


def _bad_transmitter(pe: SimulatedPe, _act: Act, _random: Random) -> End:
    for _, station in pe.stations:
        station.fails = True

    def end() -> None:
        for _, station in pe.stations:
            station.fails = False

    return end


def _late(pe: SimulatedPe, act: Act, random: Random) -> End:
    pe.outbox.delays = lambda: random.randrange(act.level * MS)

    def end() -> None:
        pe.outbox.delays = None

    return end


def _inspect(simulation: Simulation, act: Act, _: Random) -> End:
    technician = simulation.inspect(act.name)

    def end() -> None:
        if not technician.is_done and act.lasts_ms >= KINDS[act.kind].lasts_ms[0]:
            simulation.checks.wrong(simulation.now_ns, f"{act.name}: the inspection has not come to its end")
        technician.leave()

    return end


ON_PES: dict[str, Strike] = {
    "crash": _on_living(_crash),
    "reboot": _on_living(_crash),
    "brownout": _on_living(_brownout),
    "stale_table": _on_living(_stale_table),
    "mute": _on_pe(_mute),
    "deaf": _on_pe(_deaf),
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
