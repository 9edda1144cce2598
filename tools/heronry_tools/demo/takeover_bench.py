"""How long an aircraft is without a manager: in the simulator, and with real processes, after SIGKILL.

    python -m heronry_tools.demo.takeover_bench [--seeds 40] [--kills 5] [--spec elevator_and_chute]

Three times, from the death of the manager that reigned to the first LEASE of the next one that names what runs:

    standby, simulator    a second manager stands by; the kill comes at a drawn moment of a heartbeat period
    standby, processes    the same with processes on a software bus, each pair killed once
    restart, processes    no standby: the same manager is started again at once. What Python and the solver take to load
                          is told apart: from the kill to the manager's first word, and from there to that LEASE

Prints median, p99 and the longest.
"""

import argparse
import json
import statistics
import sys
import time
from collections.abc import Iterator
from typing import IO, Any

from heronry_dg.model import Spec
from heronry_tools.demo.buses import choose
from heronry_tools.demo.fleet import Fleet, run_folder
from heronry_tools.simulator.simulation import MS, Simulation
from heronry_tools.spec_argument import load_spec, spec_path
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER

_PAUSE_S = 2.0
_ADOPTED = "adopted"


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
        primary = _events(fleet.start_manager(standby=True))
        _wait(fleet, primary, "manager_started")  # or the other one might come first, and reign
        standby = _events(fleet.start_manager(LAST_MANAGER, standby=True))
        _wait(fleet, standby, "standing_by")
        _fly(fleet, spec, primary)
        killed_ns = time.monotonic_ns()
        fleet.kill_manager()
        return float(_wait(fleet, standby, _ADOPTED)["t_ns"] - killed_ns) / MS


def _restart(spec_name: str) -> tuple[float, float]:
    spec = load_spec(spec_name)
    folder = run_folder()
    with Fleet(spec, spec_path(spec_name), folder) as fleet:
        fleet.start_buses(choose(spec, folder, {}, None, prefer_vcan=False))
        _fly(fleet, spec, _events(fleet.start_manager()))
        killed_ns = time.monotonic_ns()
        fleet.kill_manager()
        again = _events(fleet.start_manager(FIRST_MANAGER))
        started_ns = _wait(fleet, again, "manager_started")["t_ns"]
        adopted_ns = _wait(fleet, again, _ADOPTED)["t_ns"]
        return (started_ns - killed_ns) / MS, (adopted_ns - started_ns) / MS


def _fly(fleet: Fleet, spec: Spec, events: Iterator[dict[str, Any]]) -> None:
    for pe in spec.pes:
        fleet.start_pe(pe)
    _wait(fleet, events, "reconfigured")
    time.sleep(_PAUSE_S)


def _events(stream: IO[bytes]) -> Iterator[dict[str, Any]]:
    for line in stream:
        yield json.loads(line)


def _wait(fleet: Fleet, events: Iterator[dict[str, Any]], kind: str) -> dict[str, Any]:
    for one in events:
        if one["event"] == kind:
            return one
    raise SystemExit(f"the benchmark ends here: {fleet.ended() or 'a manager has closed its events'}")


def _tell(what: str, values: list[float]) -> None:
    p99 = sorted(values)[min(len(values) - 1, int(0.99 * len(values)))]
    print(f"{what:<32}{statistics.median(values):>9.1f}{p99:>9.1f}{max(values):>9.1f}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
