"""The end of a flight, and all that is said of it then: one way for drawn flights, scenario files and exhaustive cases.

What must never be is judged all the time, and silences up to here. Then everything that can be ended is ended, and the
aircraft is left alone until all is well, or for longer than that may take (`oracles.liveness`).
"""

from collections.abc import Iterable

from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.flight.injections import Injections
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.silence import stopped_by_silence
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.sansio import InvariantError


def end_flight(simulation: Simulation, injections: Injections, targets: Iterable[str]) -> list[Violation]:
    """End what can be ended, and give every violation; `targets` are all that anything was done to."""
    start_ns = next((event["t_ns"] for event in simulation.events_of("reconfigured")), simulation.now_ns)
    injections.heal()
    silences = simulation.checks.silences(injections.injected, simulation.now_ns)
    violations = simulation.settle()
    stopped = stopped_by_silence(simulation.spec, targets, simulation.witness, start_ns, simulation.now_ns)
    return violations + silences + stopped


def not_injected(fault: Fault, text: str, injections: Injections) -> str | None:
    """Say that an act has struck nothing, or not in the state that it names; None where it has."""
    state = injections.state_of.get(fault)
    if state is not None and fault.during in ("", state):
        return None
    injected = ", ".join(f"{kind} in {now}" for kind, now in injections.hits) or "nothing"
    return f"'{text}' did not strike so (what did: {injected}); try another seed"


def ended_by(simulation: Simulation, error: Exception) -> list[Violation]:
    """Give the violations of a flight that a core has ended, by whatever it died of."""
    story = str(error) if isinstance(error, InvariantError) else f"{type(error).__name__}: {error}"
    return [*simulation.broken(), Violation(simulation.now_ns, "invariant", story)]
