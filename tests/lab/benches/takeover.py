"""How long an aircraft is without a manager: in the simulator, and with real processes, after SIGKILL.

    python -m lab.benches.takeover [--seeds 40] [--kills 5] [--spec elevator_and_chute]

Three times, from the death of the active manager to the first LEASE of the next one, on the bus, that names the
configuration that runs:

    standby, simulator    with a standby manager; the kill comes at a drawn moment of a heartbeat period
    standby, processes    the same with processes on a software bus, each pair killed once
    restart, processes    without a standby manager: the same manager is started again immediately. The time in which
                          Python and the solver load has a row of its own: from the kill to the manager's first frame,
                          and from there to that LEASE

*Silent* counts the functions whose outputs were late meanwhile, by their own limits: there should be none, since a
take-over stops no module.

Processes are killed once every PE is available and a configuration runs. On a busy computer the standby manager may
have taken over before: the active manager is killed, whichever that is. Or a PE is lost at that very moment: then the
next manager has to plan, and commands when the plan is deployed. Such a kill counts like any other, and is reported.
"""

import select
import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass

from heronry_dg.model import Spec
from heronry_manager.events import Event, ManagerStarted, PeJoined, PeLost, Reconfigured, StandingBy
from heronry_tools.console.spec_files import load_spec
from heronry_tools.runtime.demo.awaited_events import LONGEST_S, AwaitedEvents
from heronry_tools.runtime.demo.ear import Ear
from heronry_tools.runtime.witness import Witness
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER, MANAGER_NODES, Command, management_id
from heronry_wire.management import Lease, Step, decode_command
from lab.benches.fleets import Aircraft, aircraft
from lab.benches.harness import Benchmark, Report, option, spec_option

_BEFORE_S = 2.0  # before the kill: the functions are heard, and the manager plans ahead
_AFTER_S = 1.0  # for functions that fall silent
_LEASE_IDS = {management_id(node, Command.LEASE) for node in MANAGER_NODES}


def measure(arguments: Namespace, report: Report) -> None:
    """Measure the time without a manager in each of the three ways."""
    spec = load_spec(arguments.spec)
    beat_ms = spec.buses[spec.manager.bus].heartbeat_ns // MS
    report.begin(f"{spec.name}, heartbeats every {beat_ms} ms")
    _tell("standby, simulator", [_in_simulator(spec, seed) for seed in range(arguments.seeds)], report)
    _tell("standby, processes", [_standby(arguments.spec) for _ in range(arguments.kills)], report)
    restarts = [_restart(arguments.spec) for _ in range(arguments.kills)]
    _tell("restart, processes: all of it", restarts, report)
    report.times("  of it Python and the solver", [one.loading_ms for one in restarts])
    report.times("  of it from then on", [one.gone_ms - one.loading_ms for one in restarts])


@dataclass(frozen=True, slots=True)
class _Gone:
    """The figures of one death of a manager."""

    gone_ms: float  # until the next manager named the configuration that runs
    silent: int  # functions whose outputs were late meanwhile
    loading_ms: float = 0.0  # until the next manager's first frame


@dataclass(slots=True)
class _Heard:
    """What was received on the bus around a manager's death."""

    witness: Witness
    killed_ns: int | None = None
    commanded_ns: int | None = None  # first LEASE since then that names the configuration that runs

    def see(self, t_ns: int, frame: Frame) -> None:
        """Process a frame of the manager's bus, which ended at `t_ns`."""
        self.witness.see(t_ns, frame)
        if frame.can_id in _LEASE_IDS and self.killed_ns is not None and self.commanded_ns is None:
            lease = decode_command(Command.LEASE, frame.data)
            if t_ns > self.killed_ns and isinstance(lease, Lease) and lease.step is not Step.PREPARED:
                self.commanded_ns = t_ns

    def gone(self, end_ns: int, loading_ms: float = 0.0) -> _Gone:
        """Return the figures of this death, once a manager commands again."""
        assert self.killed_ns is not None
        assert self.commanded_ns is not None
        silent = {
            outage.function for outage in self.witness.outages(end_ns) if (outage.to_ns or end_ns) > self.killed_ns
        }
        return _Gone((self.commanded_ns - self.killed_ns) / MS, len(silent), loading_ms)


def _in_simulator(spec: Spec, seed: int) -> _Gone:
    simulation, heard = Simulation(spec, seed, standby=True), _Heard(Witness(spec))
    simulation.wiring.tap(spec.manager.bus, lambda sent: heard.see(sent.end_ns, sent.frame))
    while not simulation.events_of(Reconfigured) or simulation.unsettled():
        simulation.run_for(50 * MS)
    simulation.run_for(1_000 * MS + seed * 7_919_000 % (20 * MS))
    heard.killed_ns = simulation.now_ns
    simulation.managers.kill()
    simulation.run_for(1_000 * MS)
    return heard.gone(simulation.now_ns)


def _standby(spec_name: str) -> _Gone:
    with aircraft(spec_name) as flown:
        fleet = flown.fleet
        primary = AwaitedEvents(fleet, fleet.start_manager(standby=True))
        primary.wait(ManagerStarted)  # or the other manager might come first, and become the active one
        standby = AwaitedEvents(fleet, fleet.start_manager(LAST_MANAGER, standby=True))
        standby.wait(StandingBy)
        _fly(flown, primary)
        with Ear(flown.main, flown.spec.buses[flown.main.name]) as ear:
            death = _Death(flown, ear)
            victim = fleet.active_manager()
            death.kill(victim)
            death.wait_for_commands(standby if victim == FIRST_MANAGER else primary)
            return death.gone()


def _restart(spec_name: str) -> _Gone:
    with aircraft(spec_name) as flown:
        fleet = flown.fleet
        _fly(flown, AwaitedEvents(fleet, fleet.start_manager()))
        with Ear(flown.main, flown.spec.buses[flown.main.name]) as ear:
            death = _Death(flown, ear)
            death.kill(FIRST_MANAGER)
            death.wait_for_commands(AwaitedEvents(fleet, fleet.start_manager()))
            return death.gone()


class _Death:
    """A manager's death, as it is seen on the bus; times are those of CLOCK_MONOTONIC, as the ear gives them."""

    def __init__(self, flown: Aircraft, ear: Ear) -> None:
        """Listen for `_BEFORE_S` first."""
        self._fleet, self._ear, self._heard = flown.fleet, ear, _Heard(Witness(flown.spec))
        self._loading_ms = 0.0
        self._listen(_BEFORE_S)

    def kill(self, manager: int) -> None:
        """Kill this manager now."""
        self._hear()
        self._heard.killed_ns = time.monotonic_ns()
        self._fleet.kill_manager(manager)

    def wait_for_commands(self, events: AwaitedEvents) -> None:
        """Listen until the next manager commands, and `_AFTER_S` longer; ends the benchmark where none does."""
        heard, until_s = self._heard, time.monotonic() + LONGEST_S
        while heard.commanded_ns is None:
            if time.monotonic() > until_s:
                raise SystemExit(f"the benchmark ends here: no manager commands in {LONGEST_S:g} s")
            self._listen(0.01)
            for told in events.take():
                self._note(told)
        self._listen(_AFTER_S)

    def gone(self) -> _Gone:
        """Return the figures of this death."""
        return self._heard.gone(time.monotonic_ns(), self._loading_ms)

    def _note(self, told: Event) -> None:
        assert self._heard.killed_ns is not None
        at_ns = told.t_ns
        if isinstance(told, ManagerStarted):
            self._loading_ms = (at_ns - self._heard.killed_ns) / MS
        if isinstance(told, Reconfigured) and at_ns > self._heard.killed_ns:
            print(f"  the next manager had to plan: {', '.join(told.causes)}", file=sys.stderr)

    def _listen(self, duration_s: float) -> None:
        until_s = time.monotonic() + duration_s
        while (left_s := until_s - time.monotonic()) > 0:
            select.select(self._ear.readers, [], [], left_s)
            self._hear()

    def _hear(self) -> None:
        for at_ns, frame in self._ear.hear():
            self._heard.see(at_ns, frame)


def _fly(flown: Aircraft, events: AwaitedEvents) -> None:
    """Start every PE, and wait until it has joined and a configuration runs."""
    flown.start_pes()
    there: set[str] = set()
    while there != flown.spec.pes.keys():
        match events.wait(PeJoined, PeLost):
            case PeJoined(pe=pe):
                there.add(pe)
            case PeLost(pe=pe):
                there.discard(pe)
            case _:
                pass
    events.wait(Reconfigured)


def _tell(what: str, deaths: Sequence[_Gone], report: Report) -> None:
    report.times(what, [death.gone_ms for death in deaths])
    if silent := sum(death.silent for death in deaths):
        report.figures("  {silent} functions fell silent meanwhile", silent=silent)


main = Benchmark(
    "takeover",
    __doc__,
    measure,
    option("--seeds", 40, "flights in the simulator"),
    option("--kills", 5, "kills of each kind with real processes"),
    spec_option("elevator_and_chute"),
)
if __name__ == "__main__":
    sys.exit(main())
