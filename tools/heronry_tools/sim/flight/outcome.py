"""The description of a drawn flight (`Scenario`), and its result (`Outcome`).

A flight starts when the first configuration runs. Then the faults are injected, and after them the aircraft gets time
to converge (`end_of_flight`).
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from heronry_dg.model import Spec
from heronry_manager.events import Reconfigured
from heronry_tools.sim.faults.fault import KINDS, Fault
from heronry_tools.sim.flight.end_of_flight import end_flight, ended_by, not_injected
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.violation import MISSED, Violation
from heronry_tools.sim.world.bus import Faults
from heronry_tools.sim.world.next_spec import next_spec
from heronry_wire.authentication import KEY_BYTES, Key

_NS_PER_S = 1_000_000_000
_MS = 1_000_000
KEY = Key(bytes(KEY_BYTES))
"""Key of all flights with a key; the attackers of the simulator do not know it."""

_LONGEST_START_NS = 20 * _NS_PER_S
_RELOADED_BY = 0.6  # share of the flight in which a reload is ordered first
_RELOAD_TRIES = 5  # how often it is ordered, until it is done


@dataclass(frozen=True, slots=True)
class Scenario:
    """The description of one flight: its faults, the quality of its buses, the number of managers, the key."""

    seed: int
    seconds: float
    faults: tuple[Fault, ...]
    loss: float = 0.0
    drawn: bool = False  # the faults are those that the seed draws
    keyed: bool = False  # managers and PEs have a key; they also have one if a fault needs it
    standby: bool = False  # there are two managers
    foreseen: int | None = None  # contingencies on board cover up to so many faults; None: no contingencies
    reload: Path | None = None  # file of the spec to which the aircraft changes at a time that the seed draws


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a flight.

    digest: digest of all frames
    frames: number of frames on all buses
    hits: number of injections by kind of fault and state of the protocol
    entered: how often each state of the protocol was entered
    unverified: by rule of an oracle, the time in ns in which the rule was waived
    reloaded: whether the aircraft has changed to the other spec; if not, why (`reloads`); empty without a reload
    """

    scenario: Scenario
    digest: str
    frames: int
    virtual_ns: int
    reconfigurations: tuple[Reconfigured, ...]
    violations: tuple[Violation, ...]
    hits: Counter[tuple[str, str]] = field(default_factory=Counter)
    entered: Counter[str] = field(default_factory=Counter)
    unverified: Counter[str] = field(default_factory=Counter)
    reloaded: str = ""


def lossy(share: float) -> Faults:
    """Return the quality of a bus that destroys the share `share` of all frames.

    Besides, each receiver misses the share `share` / 10 of the frames that are sent, and receives as many twice.
    """
    return Faults(share, share / 10, share / 10)


def need_key(faults: Iterable[Fault]) -> bool:
    """Tell whether a flight with these faults needs a key."""
    return any(KINDS[fault.kind].needs_key for fault in faults)


def bring_tables(faults: Iterable[Fault]) -> bool:
    """Tell whether the managers of a flight with these faults have to bring tables."""
    return any(fault.kind == "blank" for fault in faults)


def _nothing(_simulation: Simulation, _start_ns: int) -> None:
    """Do nothing: the default of `begun`."""


def _no_one() -> None:
    """Do nothing: the default of `second_passed`."""


def play(
    spec: Spec,
    scenario: Scenario,
    begun: Callable[[Simulation, int], None] = _nothing,
    second_passed: Callable[[], None] = _no_one,
) -> Outcome:
    """Simulate a flight to its end, and return its outcome.

    begun: is called once the first configuration runs, with the simulation and the time (ns) at which it began to run.
    second_passed: is called after each second of the time in which faults are injected (virtual time).
    """
    has_key = scenario.keyed or need_key(scenario.faults)
    simulation = Simulation(
        spec,
        scenario.seed,
        faults=lossy(scenario.loss),
        key=KEY if has_key else None,
        standby=scenario.standby,
        contingencies=scenario.foreseen,
        brings_tables=bring_tables(scenario.faults),
        following=None if scenario.reload is None else next_spec(scenario.reload),
    )
    hits: Counter[tuple[str, str]] = Counter()
    try:
        with redirect_stdout(sys.stderr):  # what modules print is no result
            violations = _fly(simulation, scenario, hits, begun, second_passed)
    except Exception as error:  # noqa: BLE001 - an exception of a core, of any type, is a finding
        violations = ended_by(simulation, error)
    return Outcome(
        scenario,
        simulation.digest(),
        sum(bus.frames for bus in simulation.wiring.buses.values()),
        simulation.now_ns,
        tuple(simulation.events_of(Reconfigured)),
        simulation.waivers.promised(violations),
        hits,
        simulation.managers.protocol.entered,
        Counter(simulation.waivers.unverified_ns(simulation.now_ns)),
        "" if simulation.reloads is None else simulation.reloads.told(),
    )


def _order_reload(simulation: Simulation) -> None:
    assert simulation.reloads is not None
    simulation.reloads.order(_RELOAD_TRIES)


def _fly(
    simulation: Simulation,
    scenario: Scenario,
    hits: Counter[tuple[str, str]],
    begun: Callable[[Simulation, int], None],
    second_passed: Callable[[], None],
) -> list[Violation]:
    while not simulation.events_of(Reconfigured):
        simulation.run_for(_MS)
        if simulation.now_ns > _LONGEST_START_NS:
            return [Violation(simulation.now_ns, "active", "no configuration has ever run")]
    start_ns = simulation.events_of(Reconfigured)[0].t_ns
    injections = Injections(simulation, scenario.faults, start_ns)
    injections.hits = hits
    begun(simulation, start_ns)
    if simulation.reloads is not None:
        at_ns = start_ns + Random(f"reload of {scenario.seed}").randrange(
            1 + round(_RELOADED_BY * scenario.seconds * _NS_PER_S)
        )
        simulation.at(at_ns, lambda: _order_reload(simulation))
    end_ns = start_ns + round(scenario.seconds * _NS_PER_S)
    for second_ns in range(start_ns + _NS_PER_S, end_ns + 1, _NS_PER_S):
        simulation.run_until(second_ns)
        second_passed()
    simulation.run_until(end_ns)
    violations = end_flight(simulation, injections, (fault.target for fault in scenario.faults))
    named = () if scenario.drawn else scenario.faults
    missed = (story for fault in named if (story := not_injected(fault, str(fault), injections)) is not None)
    return violations + [Violation(simulation.now_ns, MISSED, story) for story in missed]
