"""What grows in a long flight: two real managers on a software bus, and a PE that is killed every ten seconds.

    python -m lab.benches.kills [--minutes 60] [--every 10] [--seed 1] [--spec big_blue]

A PE drawn from the seed is killed with SIGKILL. Half a period later it is started again, and the operator clears it, as
somebody does who has exchanged it; without that its hold-down doubles with every loss. The first PE of the spec is
spared: one agent flies for the whole time.

The flight has four quarters. In each are measured

    times           from the kill until the new configuration runs, from the kill until the manager noticed, and from
                    the manager's decision until the new configuration runs: in ms, of the kills that led to one
    memory          of the managers, the buses, the spared PE and their helper processes, at the end of the quarter
    descriptors     of the same processes
    files           what all nodes have written so far: journals, states, logs, in bytes

At the end the benchmark names what has grown since the end of the first quarter: a process by more than 2 MiB or any
descriptor, the files by any byte. Exit code 1 where a process has ended by itself, a descriptor was not closed, or a
kill was not followed by a new configuration or by the manager's decision that the old one stays.
"""

import select
import sys
import time
from argparse import Namespace
from contextlib import suppress
from dataclasses import dataclass, field
from random import Random
from typing import Final

from heronry_manager import events
from heronry_manager.core.vocabulary import ClearElement
from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_place import ControlError
from heronry_tools.console.progress import Progress
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER
from lab.benches.fleets import Aircraft, aircraft
from lab.benches.harness import Benchmark, Report, option, spec_option
from lab.benches.processes import children, open_descriptors, resident_mib

_QUARTERS: Final = 4
_SETTLED: Final = (events.Reconfigured, events.PlanUnchanged)
_START_S: Final = 60.0
_MOST_GROWTH_MIB: Final = 2.0
_DETECT, _DECIDED, _IN_ALL = "detect", "decision to active", "fault to active"


@dataclass(slots=True)
class Quarter:
    """What one quarter of the flight showed."""

    kills: int = 0
    unanswered: int = 0
    times_ms: dict[str, list[float]] = field(default_factory=lambda: {_IN_ALL: [], _DETECT: [], _DECIDED: []})
    memory_mib: dict[str, float] = field(default_factory=dict)
    descriptors: dict[str, int] = field(default_factory=dict)
    files: dict[str, int] = field(default_factory=dict)


class Kill:
    """One kill, and the manager's events that answer it."""

    def __init__(self, pe: str, quarter: Quarter) -> None:
        self.pe, self.quarter, self.killed_ns = pe, quarter, time.monotonic_ns()
        self._lost_ns: int | None = None
        self.is_answered = False

    def take(self, told: events.Event) -> None:
        """Read an event of the active manager."""
        if isinstance(told, events.PeLost) and told.pe == self.pe:
            self._lost_ns = told.t_ns
        elif self._lost_ns is not None and not self.is_answered and isinstance(told, _SETTLED):
            self.is_answered = True
            if isinstance(told, events.Reconfigured):
                times, parts = self.quarter.times_ms, told.times_ns.by_name()
                times[_DETECT].append((self._lost_ns - self.killed_ns) / 1e6)
                times[_DECIDED].append(sum(parts[name] or 0 for name in ("distribute", "activate")) / 1e6)
                times[_IN_ALL].append((told.t_ns - self.killed_ns) / 1e6)


class _Flight:
    def __init__(self, flown: Aircraft, spared: str) -> None:
        self._fleet, self._spared = flown.fleet, spared
        self._streams = {
            node: EventStream(flown.fleet.start_manager(node, standby=True)) for node in (FIRST_MANAGER, LAST_MANAGER)
        }
        flown.start_pes()

    def fly(self, until_s: float, kill: Kill | None = None, *, settled: bool = False) -> bool:
        """Read what the managers tell, until a time, or until something is settled; gives whether it is."""
        while (left_s := until_s - time.monotonic()) > 0:
            if ended := self._fleet.ended():
                raise SystemExit(f"the benchmark ends here: {ended}")
            for stream in select.select(list(self._streams.values()), [], [], left_s)[0]:
                for told in stream.take():
                    if kill is not None:
                        kill.take(told)
                    if settled and isinstance(told, _SETTLED):
                        return True
        return False

    def kill(self, pe: str) -> None:
        self._fleet.kill_pe(pe)

    def restore(self, pe: str) -> None:
        self._fleet.start_pe(pe)
        with suppress(ControlError):  # a busy manager; then the hold-down is longer
            call(self._fleet.control_socket(self._fleet.active_manager()), ClearElement(f"pe:{pe}"))

    def look(self, quarter: Quarter) -> None:
        """Note memory, descriptors and files."""
        own = {name: pid for name, pid in self._fleet.processes().items() if not name.startswith("pe:")}
        own[f"pe:{self._spared}"] = self._fleet.processes()[f"pe:{self._spared}"]
        helpers = {f"a helper of {name}": child for name, pid in own.items() for child in children(pid)}
        for name, pid in (own | helpers).items():
            quarter.memory_mib[name] = resident_mib(pid)
            quarter.descriptors[name] = open_descriptors(pid)
        quarter.files = {path.name: path.stat().st_size for path in self._fleet.folder.iterdir() if path.is_file()}


def measure(arguments: Namespace, report: Report) -> None:
    """Fly, and report each quarter."""
    every_s, random = arguments.every, Random(arguments.seed)
    with aircraft(arguments.spec) as flown, Progress() as progress:
        spared, *victims = flown.spec.pes
        flight = _Flight(flown, spared)
        if not flight.fly(time.monotonic() + _START_S, settled=True):
            raise SystemExit(f"the benchmark ends here: nothing was configured within {_START_S:g} s")
        kills = max(_QUARTERS, round(60 * arguments.minutes / every_s))
        progress.begin("kills", kills)
        quarters, next_s = [Quarter() for _ in range(_QUARTERS)], time.monotonic()
        for number in range(kills):
            quarter = quarters[number * _QUARTERS // kills]
            pe = random.choice(victims)
            flight.fly(next_s)
            flight.kill(pe)
            kill = Kill(pe, quarter)
            flight.fly(next_s + every_s / 2, kill)
            flight.restore(pe)
            quarter.kills, quarter.unanswered = quarter.kills + 1, quarter.unanswered + (not kill.is_answered)
            next_s += every_s
            if (number + 1) * _QUARTERS // kills != number * _QUARTERS // kills:
                flight.fly(next_s - every_s / 8)
                flight.look(quarter)
            progress.step()
    _tell(arguments, spared, quarters, report)


def _tell(arguments: Namespace, spared: str, quarters: list[Quarter], report: Report) -> None:
    for number, quarter in enumerate(quarters, 1):
        report.begin(f"{arguments.spec}, quarter {number} of {arguments.minutes:g} minutes; pe:{spared} is spared")
        for name, values in quarter.times_ms.items():
            report.times(name, values)
        report.figures(
            "  {kills} kills, {unanswered} of them unanswered; {files_bytes} bytes in files",
            kills=quarter.kills,
            unanswered=quarter.unanswered,
            files_bytes=sum(quarter.files.values()),
        )
        for name, mib in quarter.memory_mib.items():
            report.lines([f"  {name:<24}{mib:8.1f} MiB{quarter.descriptors[name]:6} descriptors"])
    first, last = quarters[0], quarters[-1]
    grown = {name: mib - first.memory_mib[name] for name, mib in last.memory_mib.items() if name in first.memory_mib}
    opened = {name: last.descriptors[name] - first.descriptors[name] for name in grown}
    report.begin("grown since the end of the first quarter")
    for name, mib in grown.items():
        if mib > _MOST_GROWTH_MIB or opened[name] > 0:
            report.lines([f"  {name}: {mib:+.1f} MiB, {opened[name]:+} descriptors"])
    more = {name: size - first.files.get(name, 0) for name, size in last.files.items()}
    report.lines(f"  file {name}: {size:+} bytes" for name, size in more.items() if size > 0)
    report.figures(
        "  in all {mib:+.1f} MiB, {descriptors:+} descriptors, {files_bytes:+} bytes in files",
        mib=sum(grown.values()),
        descriptors=sum(opened.values()),
        files_bytes=sum(more.values()),
    )
    report.require(max(opened.values(), default=0) <= 0 and not any(quarter.unanswered for quarter in quarters))


main = Benchmark(
    "kills",
    __doc__,
    measure,
    option("--minutes", 60.0, "of flight", float, "M"),
    option("--every", 10.0, "seconds from one kill to the next", float, "S"),
    option("--seed", 1, "of the PEs that are killed"),
    spec_option("big_blue"),
)
if __name__ == "__main__":
    sys.exit(main())
