"""How long many PEs take until their configuration runs, and who uses the processors meanwhile.

    python -m lab.benches.many_pes [--pes 34] [--heartbeats 20 50 100 200] [--seconds 122]

Real processes on a software bus, with one module on each PE. With N PEs every node reads N state frames in a heartbeat
period: the work of one computer grows with the square of N, and falls with the period. Reported for each period:

    first, whole      from the start of the PEs until the first configuration runs, and until one runs for which every
                      PE had joined: in seconds, None where it did not happen within --seconds
    share of a core   that the manager, its planner, the software bus and an agent (the mean, with its partition) take
                      from the start of the PEs until then
    frames            on the bus, per second
    events            of the manager until then, by kind

Exit code 1 where the whole aircraft is not configured with the longest of the periods.
"""

import argparse
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from heronry_manager import events
from heronry_tools.console.number_arguments import whole_number
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet
from heronry_tools.runtime.softbus.client import SoftBus
from heronry_wire.identifiers import PE_NODES
from lab.benches.fleets import aircraft
from lab.benches.harness import Benchmark, Report, option, seconds_option
from lab.benches.processes import children, cpu_s

_HERE = "lab.benches.reaction"
_BITRATE = 1_000_000


def spec_text(pes: int, heartbeat_ms: int) -> str:
    """Return the text of a spec with one module and one function for each PE."""
    lines = ["dg: 1", "name: many_pes"]
    lines += [f"buses: {{can0: {{bitrate: {_BITRATE}, heartbeat_ms: {heartbeat_ms}}}}}", "pes:"]
    first = PE_NODES[0]
    lines += [f"  pe_{i}: {{node_id: {first + i}, buses: [can0], cpu: 1, ram: 1MiB, flash: 1MiB}}" for i in range(pes)]
    lines += ["variables:", *(f"  talker_{i}_0: {{type: FLOAT}}" for i in range(pes)), "modules:"]
    size = "cpu: 0.1, ram: 1KiB, rate_hz: 1"
    lines += [
        f'  talker_{i}: {{image: "{_HERE}:Talks", gives: {{talker_{i}_0: 1}}, runs_on: [pe_{i}], {size}}}'
        for i in range(pes)
    ]
    lines += ["functions:", *(f"  said_{i}: {{output: talker_{i}, criticality: B}}" for i in range(pes))]
    return "\n".join([*lines, ""])


@dataclass(slots=True)
class _Start:
    """How a fleet started."""

    first_s: float | None = None
    whole_s: float | None = None
    shares: dict[str, float] = field(default_factory=dict)
    frames_per_s: float = 0.0
    events: Counter[str] = field(default_factory=Counter)


def _started(pes: int, heartbeat_ms: int, longest_s: float) -> _Start:
    found, joined = _Start(), set[str]()
    with TemporaryDirectory() as folder:
        file = Path(folder, "many_pes.dg.yaml")
        file.write_text(spec_text(pes, heartbeat_ms))
        with aircraft(str(file)) as flown, SoftBus(flown.main.channel) as bus:
            stream = EventStream(flown.fleet.start_manager())
            begun_s = time.monotonic()
            flown.start_pes()
            before, sent = _used_s(flown.fleet), bus.statistics().frames
            while (passed_s := time.monotonic() - begun_s) < longest_s and found.whole_s is None:
                for told in stream.take(min(1.0, longest_s - passed_s)):
                    found.events[told.kind] += 1
                    match told:
                        case events.PeJoined():
                            joined.add(told.pe)
                        case events.PeLost():
                            joined.discard(told.pe)
                        case events.Reconfigured() | events.PlanUnchanged():
                            now_s = time.monotonic() - begun_s
                            found.first_s = now_s if found.first_s is None else found.first_s
                            found.whole_s = now_s if len(joined) == pes else None
            used = _used_s(flown.fleet)
            found.shares = {name: (used[name] - before[name]) / passed_s for name in used}
            found.frames_per_s = (bus.statistics().frames - sent) / passed_s
    return found


def _used_s(fleet: Fleet) -> dict[str, float]:
    """Return the processor time of manager, planners, bus, and of an agent with its partition (the mean)."""
    pids = fleet.processes()
    agents = [pid for name, pid in pids.items() if name.startswith("pe:")]
    manager = next(pid for name, pid in pids.items() if name.startswith("manager"))
    bus = next(pid for name, pid in pids.items() if name.startswith("bus"))
    return {
        "manager": cpu_s(manager),
        "planner": sum(map(cpu_s, children(manager))),
        "bus": cpu_s(bus),
        "agent": sum(cpu_s(one) for pid in agents for one in (pid, *children(pid))) / max(len(agents), 1),
    }


def measure(arguments: argparse.Namespace, report: Report) -> None:
    """Start the aircraft with each period, and report."""
    for heartbeat_ms in arguments.heartbeats:
        report.begin(f"{arguments.pes} PEs, heartbeats of {heartbeat_ms} ms, software bus")
        found = _started(arguments.pes, heartbeat_ms, arguments.seconds)
        report.figures(
            "  first configuration after {first} s, whole after {whole} s; {frames_per_s:.0f} frames a second",
            first=_rounded(found.first_s),
            whole=_rounded(found.whole_s),
            frames_per_s=found.frames_per_s,
        )
        report.figures(
            "  share of a core: manager {manager:.1%}, planner {planner:.1%}, bus {bus:.1%}, an agent {agent:.1%}",
            **found.shares,
        )
        report.figures("  events: " + ", ".join(f"{kind} {{{kind}}}" for kind in found.events), **found.events)
        if heartbeat_ms == max(arguments.heartbeats):
            report.require(found.whole_s is not None)


def _rounded(seconds: float | None) -> float | str:
    return "None" if seconds is None else round(seconds, 1)


main = Benchmark(
    "many_pes",
    __doc__,
    measure,
    option("--pes", 34, "PEs; 34 at most", whole_number),
    lambda parser: parser.add_argument(
        "--heartbeats", type=int, nargs="+", default=[20, 50, 100, 200], metavar="MS", help="(default: 20 50 100 200)"
    ),
    seconds_option(122.0, "longest time of a start"),
)
if __name__ == "__main__":
    sys.exit(main())
