"""A scenario and its outcome: what is done to an aircraft, and what came of it.

A flight starts when the first configuration runs. Then the acts are played, chaos first; at the end of the chaos the
aircraft is left alone until all is well, or for too long. Acts that nobody gave are drawn from the seed: one to three
PEs die, and most of them come back.
"""

from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.demo.script import Act
from heronry_tools.simulator.bus import Faults
from heronry_tools.simulator.simulation import Simulation
from heronry_tools.simulator.violation import Violation
from heronry_wire.sansio import InvariantError

_NS_PER_S = 1_000_000_000
_MS = 1_000_000
_LONGEST_START_NS = 20 * _NS_PER_S
_RETURNS = 0.7
_MOST_KILLS = 3


@dataclass(frozen=True, slots=True)
class Scenario:
    """What is done: acts in seconds after the first configuration runs, and how bad the buses are."""

    seed: int
    seconds: float
    acts: tuple[Act, ...]
    loss: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of it."""

    scenario: Scenario
    digest: str
    frames: int
    virtual_ns: int
    reconfigurations: tuple[dict[str, Any], ...]  # the events of that name
    violations: tuple[Violation, ...]


def drawn_acts(spec: Spec, seed: int, seconds: float) -> tuple[Act, ...]:
    """Draw who dies, when, and who comes back; times are in whole milliseconds."""
    random = Random(f"acts of {seed}")
    victims = random.sample(list(spec.pes), min(random.randint(1, _MOST_KILLS), len(spec.pes)))
    acts = []
    for pe in victims:
        dies_ms = random.randrange(max(1, round(800 * seconds)))
        acts.append(Act(dies_ms / 1000, "kill", pe))
        if random.random() < _RETURNS:
            acts.append(Act((dies_ms + random.randrange(round(500 * seconds) + 1)) / 1000, "restore", pe))
    return tuple(sorted(acts))


def play(spec: Spec, scenario: Scenario) -> Outcome:
    """Fly a scenario to its end."""
    faults = Faults(scenario.loss, scenario.loss / 10, scenario.loss / 10)
    simulation = Simulation(spec, scenario.seed, faults=faults)
    try:
        violations = _fly(simulation, scenario)
    except InvariantError as error:
        violations = [*simulation.broken(), Violation(simulation.now_ns, "invariant", str(error))]
    return Outcome(
        scenario,
        simulation.digest(),
        sum(bus.frames for bus in simulation.buses.values()),
        simulation.now_ns,
        tuple(simulation.events_of("reconfigured")),
        tuple(violations),
    )


def _fly(simulation: Simulation, scenario: Scenario) -> list[Violation]:
    while not simulation.events_of("reconfigured"):
        simulation.run_for(50 * _MS)
        if simulation.now_ns > _LONGEST_START_NS:
            return [Violation(simulation.now_ns, "active", "no configuration has ever run")]
    start_ns = simulation.events_of("reconfigured")[0]["t_ns"]
    for act in scenario.acts:
        do = simulation.kill if act.what == "kill" else simulation.restore
        simulation.at(start_ns + round(act.at_s * _NS_PER_S), partial(do, act.pe))
    simulation.run_until(start_ns + round(scenario.seconds * _NS_PER_S))
    return simulation.settle()
