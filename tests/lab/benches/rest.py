"""What the processes of an aircraft cost while nothing happens: processor time and wake-ups, on software buses.

    python -m lab.benches.rest [--spec big_blue] [--seconds 60] [--settle 5]

The benchmark starts the aircraft as the demo does, waits until its first configuration runs and `--settle` seconds
more, and then only watches for `--seconds`. Reported for each kind of process, and in all:

    share of a core    user and system time, by the time that was watched
    wake-ups           voluntary context switches, per second: how often a process that had waited ran again
    per frame          processor time of the agents, in us, by each frame that the hubs have handed to them

The planners' processes are told, but do not count in all: they use what the others leave. What the manager tells
meanwhile is counted, too; at rest it tells nothing.
"""

import sys
import time
from argparse import Namespace
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path

from heronry_manager.events import Reconfigured
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet
from heronry_tools.runtime.softbus.client import SoftBus
from heronry_wire.identifiers import NMT_ID
from lab.benches.fleets import Aircraft, aircraft
from lab.benches.harness import Benchmark, Report, option, seconds_option, spec_option
from lab.benches.processes import children, cpu_s

_START_S = 120.0
_KINDS = ("agents", "partitions", "hubs", "manager", "planners")
_PLANNERS = "planners"


def wake_ups(pid: int) -> int:
    """Return the voluntary context switches of all threads of a process."""
    found = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):  # the thread has ended
            lines = (task / "status").read_text(encoding="ascii", errors="replace").splitlines()
            found += next(int(line.split()[1]) for line in lines if line.startswith("voluntary_ctxt_switches"))
    return found


def processes_by_kind(fleet: Fleet) -> dict[str, list[int]]:
    """Return the process numbers of an aircraft that flies, by the kinds of this benchmark."""
    found: dict[str, list[int]] = {kind: [] for kind in _KINDS}
    for name, pid in fleet.processes().items():
        if name.startswith("pe:"):
            found["agents"].append(pid)
            found["partitions"] += children(pid)
        elif name.startswith("manager"):
            found["manager"].append(pid)
            found[_PLANNERS] += children(pid)
        else:
            found["hubs"].append(pid)
    return found


def measure(arguments: Namespace, report: Report) -> None:
    """Start the aircraft, and watch it."""
    with aircraft(arguments.spec) as flown, ExitStack() as stack:
        events = EventStream(flown.fleet.start_manager())
        flown.start_pes()
        _until_configured(events)
        _gathered(events, arguments.settle)
        buses = [stack.enter_context(SoftBus(choice.channel)) for choice in flown.buses.values()]
        for bus in buses:
            bus.set_filters([{"can_id": NMT_ID, "can_mask": 0x7FF, "extended": False}])  # which nobody sends
        pids = processes_by_kind(flown.fleet)
        before, frames = _sample(pids), _frames(buses, flown)
        begun_s = time.monotonic()
        told = _gathered(events, arguments.seconds)
        watched_s = time.monotonic() - begun_s
        after, received = _sample(pids), _frames(buses, flown) - frames
    report.begin(f"{arguments.spec} at rest for {arguments.seconds:g} s")
    for kind in _KINDS:
        _tell(report, kind, len(pids[kind]), *_spent(before[kind], after[kind], watched_s))
    counted = [kind for kind in _KINDS if kind != _PLANNERS]
    spent = [_spent(before[kind], after[kind], watched_s) for kind in counted]
    number = sum(len(pids[kind]) for kind in counted)
    _tell(report, "in all", number, sum(cpu for cpu, _ in spent), sum(woke for _, woke in spent))
    agents_s = after["agents"][0] - before["agents"][0]
    report.figures(
        "agents: {received_per_s:.0f} frames received a second, {us_per_frame:.0f} us of processor time for each",
        received_per_s=received / watched_s,
        us_per_frame=agents_s / max(received, 1) * 1e6,
    )
    report.figures(
        "the manager told {told} events: " + (", ".join(f"{n} {kind}" for kind, n in told.items()) or "none"),
        told=told.total(),
    )


def _until_configured(events: EventStream) -> None:
    until_s = time.monotonic() + _START_S
    while time.monotonic() < until_s:
        if any(isinstance(told, Reconfigured) for told in events.take(1.0)):
            return
    raise SystemExit(f"the benchmark ends here: nothing was configured within {_START_S:g} s")


def _gathered(events: EventStream, seconds: float) -> "Counter[str]":
    """Read events for some time; gives how many of each kind came."""
    until_s, found = time.monotonic() + seconds, Counter[str]()
    while (left_s := until_s - time.monotonic()) > 0:
        found.update(told.kind for told in events.take(left_s))
    return found


def _sample(pids: dict[str, list[int]]) -> dict[str, tuple[float, int]]:
    """Return the processor time (s) and the wake-ups of each kind so far."""
    return {kind: (sum(map(cpu_s, own)), sum(map(wake_ups, own))) for kind, own in pids.items()}


def _frames(buses: list[SoftBus], flown: Aircraft) -> int:
    """Return how many frames the hubs have handed to the agents so far."""
    agents = {pid for name, pid in flown.fleet.processes().items() if name.startswith("pe:")}
    return sum(client.received for bus in buses for client in bus.statistics().clients if client.pid in agents)


def _spent(before: tuple[float, int], after: tuple[float, int], seconds: float) -> tuple[float, float]:
    return (after[0] - before[0]) / seconds, (after[1] - before[1]) / seconds


def _tell(report: Report, kind: str, number: int, share: float, woke_per_s: float) -> None:
    name = kind.replace(" ", "_")
    report.figures(
        f"{kind:<12}{number:>3} processes {{{name}_share:>7.1%}} of a core {{{name}_wake_ups_per_s:>7.0f}} wake-ups/s",
        **{f"{name}_share": share, f"{name}_wake_ups_per_s": woke_per_s},
    )


main = Benchmark(
    "rest",
    __doc__,
    measure,
    spec_option("big_blue"),
    seconds_option(60.0, "of watching"),
    option("--settle", 5.0, "seconds from the first configuration on, before it is watched", float, "S"),
)
if __name__ == "__main__":
    sys.exit(main())
