"""The end of a flight: the same for drawn flights, scenario files and exhaustive cases.

1. When the time for faults is over, every fault that can be ended is ended, and a change to another spec that is not
   under way is not ordered again. The oracle `service` verifies silences of critical functions up to this moment.
2. The flight continues without a new fault. It ends when the aircraft has converged, or when the longest time for
   converging is over (`oracles.liveness`). All other rules that must hold in the whole flight are verified up to this
   end.
"""

from collections.abc import Collection, Iterable

from heronry_manager.events import Reconfigured
from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.sansio import InvariantError


def end_flight(simulation: Simulation, injections: Injections, targets: Iterable[str]) -> list[Violation]:
    """End every fault that can be ended, let the aircraft converge, and return all violations of the flight.

    targets: all targets into which faults were injected.
    """
    targets = list(targets)
    start_ns = next((event.t_ns for event in simulation.events_of(Reconfigured)), simulation.now_ns)
    injections.heal()
    if simulation.reloads is not None:
        simulation.reloads.rest()
    silences = simulation.checks.silences(injections.injected, simulation.now_ns)
    violations = simulation.settle()
    stopped = simulation.checks.stopped(targets, range(start_ns, simulation.now_ns))
    return violations + silences + stopped + _missed(simulation, injections, targets, start_ns)


def _missed(simulation: Simulation, injections: Injections, targets: Collection[str], start_ns: int) -> list[Violation]:
    faults = list(injections.state_of)
    has_others = set(targets) != {fault.target for fault in faults} or simulation.reloads is not None
    denied = simulation.checks.denials(faults, range(start_ns, simulation.now_ns), has_others=has_others)
    missed = simulation.checks.missed_steps(faults)
    return denied + missed + simulation.checks.untold(faults, has_others=has_others)


def not_injected(fault: Fault, text: str, injections: Injections) -> str | None:
    """Return a sentence if a fault was not injected, or not in the state that it names.

    None: the fault was injected, and in the state that it names, if it names one.

    text: the fault as the sentence quotes it.
    """
    state = injections.state_of.get(fault)
    if state is not None and fault.during in ("", state):
        return None
    injected = ", ".join(f"{kind} in {now}" for kind, now in injections.hits) or "nothing"
    return f"'{text}' was not injected as given (injected: {injected}); try another seed"


def ended_by(simulation: Simulation, error: Exception) -> list[Violation]:
    """Return the violations of a flight that ended because a core raised an exception."""
    story = str(error) if isinstance(error, InvariantError) else f"{type(error).__name__}: {error}"
    return [*simulation.broken(), Violation(simulation.now_ns, "invariant", story)]
