"""The four times of a reconfiguration, measured with real processes on a software bus.

    python -m lab.benches.reconfiguration [--kills 30] [--spec big_blue] [--contingencies FILE|none] [--stuck-readers N]

Kills PEs with SIGKILL and waits until the system runs again. With contingencies on board each kill is the first one of
a fleet of its own: the contingencies are made for what runs without a fault. Without contingencies one PE after the
other is killed and started again; once it has joined, the manager has three seconds of pre-planning before the next
kill. *Detect* counts from the kill itself; the manager measures the other three.

With --stuck-readers the same kills are flown twice, in turn: without readers of the manager's events, and with N
readers that never read.
"""

import sys
import time
from argparse import Namespace
from contextlib import ExitStack
from typing import Final

from heronry_manager.contingency.contingencies import Contingencies
from heronry_manager.core.membership import Standing
from heronry_manager.core.vocabulary import AskStatus
from heronry_manager.events import Event, PeJoined, PeLost, PlanUnchanged, Reconfigured
from heronry_manager.shell.control_client import call, follow
from heronry_tools.analysis.made_ahead import contingencies_of
from heronry_tools.console.contingencies_argument import Source, add_contingencies_argument
from heronry_tools.console.number_arguments import whole_number
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_files import load_spec
from heronry_tools.runtime.demo.awaited_events import LONGEST_S, AwaitedEvents
from heronry_tools.runtime.demo.fleet import Fleet
from lab.benches.fleets import aircraft
from lab.benches.harness import Benchmark, Report, option, spec_option

_NAMES = ("detect", "decide", "distribute", "activate")
_DECIDED, _IN_ALL = "decision to active", "fault to active"
_SETTLED: Final[tuple[type[Event], ...]] = (Reconfigured, PlanUnchanged)
_LOOK_S = 0.2
_PAUSE_S = 3.0  # between two kills: time for pre-planning, as in flight


def measure(arguments: Namespace, report: Report) -> None:
    """Kill PEs, and report the times."""
    found = times_of(arguments.spec, arguments.kills, arguments.contingencies, arguments.stuck_readers)
    for readers, times in found.items():
        also = f", {readers} readers that never read" if readers else ""
        report.begin(f"{arguments.spec}, {arguments.kills} kills, software bus{also}")
        for name, values in times.items():
            report.times(name, values)


def times_of(spec_name: str, kills: int, source: Source, stuck_readers: int = 0) -> dict[int, dict[str, list[float]]]:
    """Return the times in milliseconds, by name, one per kill; by the number of readers that never read.

    Every PE dies once in a fleet's life, since its hold-down doubles with each loss.
    """
    times: dict[int, dict[str, list[float]]] = {
        readers: {name: [] for name in (*_NAMES, _DECIDED, _IN_ALL)} for readers in (0, stuck_readers)
    }
    spec = load_spec(spec_name)
    made, pes = contingencies_of(spec, source), tuple(spec.pes)
    each = len(pes) if made is None else 1
    with Progress() as progress:
        progress.begin("kills", kills)
        for first in range(0, kills, each):
            victims = pes[: kills - first] if made is None else pes[first % len(pes) :][:1]
            for readers, noted in times.items():
                _fly(spec_name, victims, noted, made, readers)
            progress.step(len(victims))
    return times


def _fly(
    spec_name: str, pes: tuple[str, ...], times: dict[str, list[float]], made: Contingencies | None, readers: int
) -> None:
    """Start a fleet, and kill and restore these PEs one after the other."""
    with aircraft(spec_name, made) as flown, ExitStack() as stuck:
        events = AwaitedEvents(flown.fleet, flown.fleet.start_manager())
        flown.start_pes()
        events.wait(*_SETTLED)
        for _ in range(readers):
            stuck.enter_context(follow(flown.fleet.control_socket()))
        for pe in pes:
            _wait_until_up(flown.fleet, pe)
            time.sleep(_PAUSE_S)
            events.take()
            killed_ns = time.monotonic_ns()
            flown.fleet.kill_pe(pe)
            lost = events.wait(PeLost, pe=pe)
            done = events.wait(*_SETTLED)
            if isinstance(done, Reconfigured):
                _note(times, killed_ns, lost.t_ns, done)
            if pe != pes[-1]:
                flown.fleet.start_pe(pe)
                events.wait(PeJoined, pe=pe)
                events.wait(*_SETTLED)


def _wait_until_up(fleet: Fleet, pe: str) -> None:
    """Wait until the manager counts a PE as up: a busy computer may have lost it, and a lost PE is not lost again."""
    until_s = time.monotonic() + LONGEST_S
    while time.monotonic() < until_s:
        status = call(fleet.control_socket(), AskStatus()).status
        if status is not None and status["pes"][pe]["state"] == Standing.UP.value:
            return
        time.sleep(_LOOK_S)
    raise SystemExit(f"the benchmark ends here: pe:{pe} is not up within {LONGEST_S:g} s")


def _note(times: dict[str, list[float]], killed_ns: int, lost_ns: int, done: Reconfigured) -> None:
    four = {**done.times_ns.by_name(), "detect": lost_ns - killed_ns}
    for name in _NAMES:
        times[name].append((four[name] or 0) / 1e6)
    times[_DECIDED].append(times["distribute"][-1] + times["activate"][-1])
    times[_IN_ALL].append((done.t_ns - killed_ns) / 1e6)


main = Benchmark(
    "reconfiguration",
    __doc__,
    measure,
    option("--kills", 30, "how many kills"),
    option("--stuck-readers", 0, "readers of the manager's events that never read; 15 at most", whole_number),
    spec_option("big_blue"),
    lambda parser: add_contingencies_argument(parser, "to fly with and to carry on board"),
)
if __name__ == "__main__":
    sys.exit(main())
