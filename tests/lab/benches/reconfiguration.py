"""The four times of a reconfiguration, measured with real processes on a software bus.

    python -m lab.benches.reconfiguration [--kills 30] [--spec big_blue] [--contingencies FILE|none]

Kills PEs with SIGKILL and waits for the system to run again. With contingencies on board each kill is the first one of
a fleet of its own: they are made for what runs while nothing has failed. Without, one PE after the other is killed, is
brought back, is waited for, and the manager has three seconds to think ahead before the next one.
*Detect* counts from the kill itself, the other three are the manager's own. Prints median, p99 and the longest.
"""

import argparse
import platform
import statistics
import sys
import time
from collections.abc import Mapping
from typing import Any

from heronry_manager.contingency.contingencies import Contingencies
from heronry_tools.analysis.made_ahead import Source, add_contingencies_argument, contingencies_of
from heronry_tools.console.errors import exit_code
from heronry_tools.console.spec_argument import load_spec, spec_path
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.fleet import Fleet, run_folder

_NAMES = ("detect", "decide", "distribute", "activate")
_DECIDED, _IN_ALL = "decision to active", "fault to active"
_SETTLED = ("reconfigured", "plan_unchanged")
PAUSE_S = 3.0  # between two kills: time to think ahead, as in flight


def main() -> int:
    """Run the benchmark; returns the exit code."""
    parser = argparse.ArgumentParser(description="Measure the four times of a reconfiguration with real processes.")
    parser.add_argument("--kills", type=int, default=30, metavar="N", help="how many kills (default 30)")
    parser.add_argument("--spec", default="big_blue", metavar="SPEC", help="default big_blue")
    add_contingencies_argument(parser, "to fly with and to carry on board")
    arguments = parser.parse_args()
    times = measure(arguments.spec, arguments.kills, arguments.contingencies)
    machine = f"{platform.machine()}, Python {platform.python_version()}"
    print(f"{arguments.spec}, {arguments.kills} kills, software bus; {machine}")
    print(f"{'ms':<19}{'median':>9}{'p99':>9}{'longest':>9}")
    for name, values in times.items():
        print(f"{name:<19}{statistics.median(values):>9.1f}{_p99(values):>9.1f}{max(values):>9.1f}")
    return 0


def measure(spec_name: str, kills: int, source: Source) -> dict[str, list[float]]:
    """Give the times in milliseconds, by name, one per kill.

    Every PE dies once in a fleet's life: whoever dies again and again is held down longer each time, by design.
    """
    times: dict[str, list[float]] = {name: [] for name in (*_NAMES, _DECIDED, _IN_ALL)}
    spec = load_spec(spec_name)
    made, pes = contingencies_of(spec, source), tuple(spec.pes)
    each = len(pes) if made is None else 1
    for first in range(0, kills, each):
        victims = pes[: kills - first] if made is None else pes[first % len(pes) :][:1]
        _fly(spec_name, victims, times, made)
        print(f"\r{min(kills, first + each)} of {kills} kills", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return times


def _fly(spec_name: str, pes: tuple[str, ...], times: dict[str, list[float]], made: Contingencies | None) -> None:
    """Start a fleet, and kill and restore these PEs one after the other."""
    spec = load_spec(spec_name)
    folder = run_folder()
    with Fleet(spec, spec_path(spec_name), folder, made) as fleet:
        fleet.start_buses(choose(spec, folder, {}, None, prefer_vcan=False))
        events = AwaitedEvents(fleet, fleet.start_manager())
        for pe in spec.pes:
            fleet.start_pe(pe)
        events.wait(*_SETTLED)
        for pe in pes:
            time.sleep(PAUSE_S)
            killed_ns = time.monotonic_ns()
            fleet.kill_pe(pe)
            lost = events.wait("pe_lost", pe=pe)
            done = events.wait(*_SETTLED)
            if done["event"] == "reconfigured":
                _note(times, killed_ns, lost["t_ns"], done)
            if pe != pes[-1]:
                fleet.start_pe(pe)
                events.wait("pe_joined", pe=pe)
                events.wait(*_SETTLED)


def _note(times: dict[str, list[float]], killed_ns: int, lost_ns: int, done: Mapping[str, Any]) -> None:
    four = {**done["times_ns"], "detect": lost_ns - killed_ns}
    for name in _NAMES:
        times[name].append(four[name] / 1e6)
    times[_DECIDED].append(times["distribute"][-1] + times["activate"][-1])
    times[_IN_ALL].append((done["t_ns"] - killed_ns) / 1e6)


def _p99(values: list[float]) -> float:
    return sorted(values)[min(len(values) - 1, int(0.99 * len(values)))]


if __name__ == "__main__":
    sys.exit(exit_code(main, "bench"))
