"""The cost of a PE's agent, and how regular its frames are: real processes on a software bus.

    python -m lab.benches.agent [--spec big_blue] [--seconds 20] [--busy 2]

The benchmark flies the spec twice for `--seconds`, with its data on the bus: on an idle computer, and beside `--busy`
processes that compute without end. It prints the start-up time of the agent's code. For each agent it prints the
memory, the processor time, that of its partitions, the processor time per frame, and by how much the interval between
two state frames is longer than their period. The last line is the processor time of all processes of the flight, hubs
and manager included.
"""

import os
import statistics
import subprocess
import sys
import time
from argparse import Namespace
from collections.abc import Sequence

from can.typechecking import CanFilter

from heronry_manager.events import Reconfigured
from heronry_manager.events.reading import read_event
from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.runtime.softbus.protocol import BusStatistics, ClientStatistics
from heronry_wire.identifiers import state_id
from lab.benches.fleets import aircraft
from lab.benches.harness import Benchmark, Report, option, seconds_option, spec_option
from lab.benches.processes import busy, family_cpu_s, resident_mib
from lab.benches.state_frames import forget_waiting, lateness_ms

_SETTLE_S = 3.0  # from the first configuration on: the manager plans ahead, and late PEs join
_START_UP = (  # VmHWM begins anew with exec; getrusage(2) would tell the memory of the process that started this one
    "import re, time; start = time.process_time(); import heronry_agent.shell.cli; "
    "print(time.process_time() - start, re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])"
)


def measure(arguments: Namespace, report: Report) -> None:
    """Measure the start-up, and both flights."""
    _tell_start_up(report)
    for others in (0, arguments.busy):
        with busy(others) as said:
            report.begin(f"\n{arguments.spec}, {said}")
            _fly(arguments.spec, arguments.seconds, report)


def _tell_start_up(report: Report) -> None:
    compiled = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    runs = [subprocess.check_output([sys.executable, "-c", _START_UP], text=True, env=compiled) for _ in range(5)]
    seconds, kibibytes = zip(*(map(float, run.split()) for run in runs), strict=True)
    report.figures(
        "import of the agent: {import_s:.3f} s of CPU, {import_mib:.1f} MiB",
        import_s=statistics.median(seconds),
        import_mib=max(kibibytes) / 1024,
    )


def _fly(spec_name: str, seconds: float, report: Report) -> None:
    with aircraft(spec_name) as flown:
        spec = flown.spec
        events = flown.fleet.start_manager()
        pids = flown.start_pes()
        while not isinstance(read_event(events.readline()), Reconfigured):
            pass
        wired = [pe for pe in spec.pes.values() if spec.manager.bus in pe.buses]
        states: list[CanFilter] = [{"can_id": state_id(pe.node_id), "can_mask": 0x7FF} for pe in wired]
        with SoftBus(flown.main.channel, states) as observer:
            time.sleep(_SETTLE_S)
            forget_waiting(observer)
            before, cpu_before = observer.statistics(), family_cpu_s(os.getpid())
            late_ms = lateness_ms(observer, spec.buses[spec.manager.bus].heartbeat_ns / 1e6, seconds)
            after, cpu_after = observer.statistics(), family_cpu_s(os.getpid())
            used = {pid: (parent, s - cpu_before.get(pid, (0, 0.0))[1]) for pid, (parent, s) in cpu_after.items()}
            _tell_agents(pids, used, (before.clients, after.clients), seconds, report)
    _tell_bus(used, before, after, seconds, report)
    report.times("state frames, later than due", late_ms)


def _tell_bus(
    used: dict[int, tuple[int, float]], before: BusStatistics, after: BusStatistics, seconds: float, report: Report
) -> None:
    report.figures(
        "all processes {cpu:.0%} of a core; bus load {load:.0%}, {frames_per_s:.0f} frames/s",
        cpu=sum(used_s for _, used_s in used.values()) / seconds,
        load=after.load_since(before),
        frames_per_s=(after.frames - before.frames) / seconds,
    )


def _tell_agents(
    pids: dict[str, int],
    used: dict[int, tuple[int, float]],
    statistics_of: tuple[Sequence[ClientStatistics], Sequence[ClientStatistics]],
    seconds: float,
    report: Report,
) -> None:
    before, after = statistics_of
    frames_before = {client.pid: client.sent + client.received for client in before}
    clients = {client.pid: client for client in after}
    report.lines([f"{'PE':<10}{'MiB':>6}{'CPU':>7}{'partitions':>12}{'frames/s':>10}{'us/frame':>10}{'lost':>6}"])
    for pe, pid in pids.items():
        used_s, partitions_s = used[pid][1], sum(cpu for parent, cpu in used.values() if parent == pid)
        line = f"{pe:<10}{resident_mib(pid):>6.1f}{used_s / seconds:>7.1%}{partitions_s / seconds:>12.1%}"
        if pid in clients:
            client = clients[pid]
            frames = client.sent + client.received - frames_before[pid]
            line += f"{frames / seconds:>10.0f}{used_s / max(frames, 1) * 1e6:>10.0f}{client.overruns:>6}"
        report.lines([line])


main = Benchmark(
    "agent",
    __doc__,
    measure,
    spec_option("big_blue"),
    seconds_option(20.0, "of each flight"),
    option("--busy", os.cpu_count(), "processes that compute"),
)
if __name__ == "__main__":
    sys.exit(main())
