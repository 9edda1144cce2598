"""Faults of managers: death, pause, broken wires, a second manager with the same node-ID, a full disk."""

from collections.abc import Callable
from random import Random

from heronry_tools.sim.faults.fault import MANAGERS, Fault
from heronry_tools.sim.flight.injection.inject import End, Inject, loosen, nothing
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.world.simulated_manager import SimulatedManager

_OF_REPLAYED_COUNTERS = frozenset(("silence",))  # PEs with a key reject reused command numbers as a replay


def _on_manager(do: Callable[[SimulatedManager, Fault, Random], End]) -> Inject:
    """Make an injection that calls `do` with the manager that is the target, if it runs.

    The function that `do` returns ends the fault; it must have no effect if the manager has stopped in the meantime.
    """
    return _in_seat(lambda simulation, seat, fault, random: do(simulation.managers.running[seat], fault, random))


def _in_seat(do: Callable[[Simulation, int, Fault, Random], End | None]) -> Inject:
    """Make an injection that calls `do` with the seat of the running manager that is the target of the fault.

    The seat is the number of the computer on which the manager runs: its node-ID, or the negative node-ID of a second
    manager with the same node-ID. A target without a node-ID is the active manager or, if no manager is active, the
    running one with the lowest node-ID (`foremost`). The injection does nothing if the target does not run.
    """

    def inject(simulation: Simulation, fault: Fault, random: Random) -> End | None:
        node, foremost = MANAGERS[fault.target], simulation.managers.foremost
        for seat, one in simulation.managers.running.items():
            if one.running and (seat == node or (node is None and one is foremost)):
                return do(simulation, seat, fault, random)
        return None

    return inject


def _dies(simulation: Simulation, seat: int, torn: Random | None) -> End:
    managers = simulation.managers
    if managers.running[seat].disk.problem is not None and simulation.key is not None:
        simulation.waivers.begin(_OF_REPLAYED_COUNTERS, simulation.now_ns)
    managers.kill(seat, torn=torn)
    return lambda: managers.start(seat) if seat > 0 and seat not in managers.running else None


def _crash(simulation: Simulation, seat: int, _fault: Fault, _random: Random) -> End:
    return _dies(simulation, seat, None)


def _power(simulation: Simulation, seat: int, _fault: Fault, random: Random) -> End:
    return _dies(simulation, seat, random)


def _double(simulation: Simulation, seat: int, fault: Fault, _: Random) -> End | None:
    managers = simulation.managers
    if seat < 0 or -seat in managers.running:
        return None
    managers.double(seat, standby=fault.level == 0)
    return lambda: managers.kill(-seat)


def _disk_full(simulation: Simulation, seat: int, _fault: Fault, _random: Random) -> End:
    disk = simulation.managers.running[seat].disk
    disk.refuses = True
    simulation.checks.may_forget_phase()
    simulation.checks.may_count_again()

    def end() -> None:
        disk.refuses = False

    return end


def _loose(simulation: Simulation, seat: int, _fault: Fault, random: Random) -> End:
    return loosen(simulation, simulation.managers.running[seat], random)


def _pause(manager: SimulatedManager, fault: Fault, _: Random) -> End:
    manager.pause(fault.lasts_ms * MS)
    return nothing


def _clock_jump(simulation: Simulation, seat: int, fault: Fault, _random: Random) -> End:
    ahead_ns = fault.level * MS
    simulation.managers.running[seat].jump(ahead_ns)
    simulation.checks.manager_jumped(simulation.now_ns, ahead_ns)
    return nothing


def _wire(direction: str) -> Inject:
    """Return an injection that breaks the wires of a manager.

    direction: `transmit_failed` or `receive_failed` for one direction, `cut_off` for both.
    """

    def do(manager: SimulatedManager, _fault: Fault, _random: Random) -> End:
        manager.wire(**{direction: True})
        return lambda: manager.wire(**{direction: False}) if manager.running else None

    return _on_manager(do)


ON_MANAGERS: dict[str, Inject] = {
    "manager_crash": _in_seat(_crash),
    "manager_power": _in_seat(_power),
    "manager_double": _in_seat(_double),
    "disk_full": _in_seat(_disk_full),
    "manager_loose": _in_seat(_loose),
    "manager_pause": _on_manager(_pause),
    "manager_clock_jump": _in_seat(_clock_jump),
    "manager_cut": _wire("cut_off"),
    "manager_mute": _wire("transmit_failed"),
    "manager_deaf": _wire("receive_failed"),
}
