"""How long an aircraft is without a manager: in the simulator, and with real processes, after SIGKILL.

    python -m heronry_tools.demo.takeover_bench [--seeds 40] [--kills 5] [--spec elevator_and_chute]

Three times, from the death of the manager that reigned to the first LEASE of the next one that names what runs:

    standby, simulator    a second manager stands by; the kill comes at a drawn moment of a heartbeat period
    standby, processes    the same with processes on a software bus, each pair killed once
    restart, processes    no standby: the same manager is started again at once. What Python and the solver take to load
                          is told apart: from the kill to the manager's first word, and from there to that LEASE

Processes are killed once every PE is counted on and a configuration runs. On a busy computer the standby may have taken
over before: whichever reigns is killed. Or a PE is lost at that very moment: then the next manager has to plan, and
commands when that is deployed. Such a kill counts like any other, and is told of.

Prints median, p99 and the longest.
"""

import argparse
import statistics
import sys
import time
from collections import deque
from typing import IO, Any

from heronry_dg.model import Spec
from heronry_tools.demo.buses import choose
from heronry_tools.demo.event_stream import EventStream
from heronry_tools.demo.fleet import Fleet, run_folder
from heronry_tools.errors import exit_code
from heronry_tools.simulator.simulation import MS, Simulation
from heronry_tools.spec_argument import load_spec, spec_path
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER

_PAUSE_S = 2.0
_LONGEST_S = 60.0  # Python and the solver may take long to load; nothing else does
_COMMANDS = ("adopted", "reconfigured")


def main() -> int:
    """Run the benchmark; returns the exit code."""
    parser = argparse.ArgumentParser(description="Measure how long an aircraft is without a manager.")
    parser.add_argument("--seeds", type=int, default=40, help="flights in the simulator (default 40)")
    parser.add_argument("--kills", type=int, default=5, help="kills of each kind with real processes (default 5)")
    parser.add_argument("--spec", default="elevator_and_chute", metavar="SPEC")
    arguments = parser.parse_args()
    spec = load_spec(arguments.spec)
    print(f"{'ms':<32}{'median':>9}{'p99':>9}{'longest':>9}")
    _tell("standby, simulator", [_in_simulator(spec, seed) for seed in range(arguments.seeds)])
    if arguments.kills:
        _tell("standby, processes", [_standby(arguments.spec) for _ in range(arguments.kills)])
        restarts = [_restart(arguments.spec) for _ in range(arguments.kills)]
        _tell("restart, processes: loading", [loading for loading, _ in restarts])
        _tell("restart, processes: commanding", [commanding for _, commanding in restarts])
    return 0


def _in_simulator(spec: Spec, seed: int) -> float:
    simulation = Simulation(spec, seed, standby=True)
    while not simulation.events_of("reconfigured") or simulation.unsettled():
        simulation.run_for(50 * MS)
    simulation.run_for(1_000 * MS + seed * 7_919_000 % (20 * MS))
    killed_ns = simulation.now_ns
    simulation.kill_manager()
    simulation.run_for(1_000 * MS)
    return float(simulation.events_of("taken_over")[-1]["t_ns"] - killed_ns) / MS


def _standby(spec_name: str) -> float:
    spec = load_spec(spec_name)
    folder = run_folder()
    with Fleet(spec, spec_path(spec_name), folder) as fleet:
        fleet.start_buses(choose(spec, folder, {}, None, prefer_vcan=False))
        primary = _Events(fleet, fleet.start_manager(standby=True))
        primary.wait("manager_started")  # or the other one might come first, and reign
        standby = _Events(fleet, fleet.start_manager(LAST_MANAGER, standby=True))
        standby.wait("standing_by")
        _fly(fleet, spec, primary)
        victim = fleet.reigning()
        killed_ns = time.monotonic_ns()
        fleet.kill_manager(victim)
        return (_commanding_ns(standby if victim == FIRST_MANAGER else primary, killed_ns) - killed_ns) / MS


def _restart(spec_name: str) -> tuple[float, float]:
    spec = load_spec(spec_name)
    folder = run_folder()
    with Fleet(spec, spec_path(spec_name), folder) as fleet:
        fleet.start_buses(choose(spec, folder, {}, None, prefer_vcan=False))
        _fly(fleet, spec, _Events(fleet, fleet.start_manager()))
        killed_ns = time.monotonic_ns()
        fleet.kill_manager()
        again = _Events(fleet, fleet.start_manager(FIRST_MANAGER))
        started_ns = int(again.wait("manager_started")["t_ns"])
        return (started_ns - killed_ns) / MS, (_commanding_ns(again, killed_ns) - started_ns) / MS


class _Events:
    """The events of one manager, as they come."""

    def __init__(self, fleet: Fleet, stream: IO[bytes]) -> None:
        self._fleet, self._stream = fleet, EventStream(stream)
        self._come: deque[dict[str, Any]] = deque()

    def wait(self, *kinds: str) -> dict[str, Any]:
        """Give the next event of these kinds; ends the benchmark where none comes."""
        last, until_s = "nothing", time.monotonic() + _LONGEST_S
        while True:
            while self._come:
                told = self._come.popleft()
                last = told["event"]
                if last in kinds:
                    return told
            if time.monotonic() > until_s:
                raise SystemExit(f"the benchmark ends here: no {' or '.join(kinds)} in {_LONGEST_S:g} s, after {last}")
            self._come += self._stream.take(max(0.0, until_s - time.monotonic()))
            if self._stream.has_ended:
                raise SystemExit(f"the benchmark ends here: {self._fleet.ended() or 'a manager has closed its events'}")


def _fly(fleet: Fleet, spec: Spec, events: _Events) -> None:
    """Let every PE fly, and a while pass: the manager thinks ahead."""
    for pe in spec.pes:
        fleet.start_pe(pe)
    there: set[str] = set()
    while there != spec.pes.keys():
        told = events.wait("pe_joined", "pe_lost")
        (there.add if told["event"] == "pe_joined" else there.discard)(told["pe"])
    events.wait("reconfigured")
    time.sleep(_PAUSE_S)


def _commanding_ns(events: _Events, killed_ns: int) -> int:
    """When the next manager names what runs; what it did before the death of the other one is of no account."""
    told = events.wait(*_COMMANDS)
    while told["t_ns"] < killed_ns:
        told = events.wait(*_COMMANDS)
    if told["event"] != "adopted":
        print(f"  it had to plan: {', '.join(told['causes'])}", file=sys.stderr)
    return int(told["t_ns"])


def _tell(what: str, values: list[float]) -> None:
    p99 = sorted(values)[min(len(values) - 1, int(0.99 * len(values)))]
    print(f"{what:<32}{statistics.median(values):>9.1f}{p99:>9.1f}{max(values):>9.1f}", flush=True)


if __name__ == "__main__":
    sys.exit(exit_code(main, "takeover_bench"))
