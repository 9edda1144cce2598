"""What a PE's agent costs, and how steady it is: real processes on a software bus.

    python -m lab.benches.agent [--spec big_blue] [--seconds 20] [--busy 2]

Flies the spec twice for so long, its data on the bus: once with nothing else to do for this computer, once beside
`--busy` processes that compute without end. Prints the start-up of the agent's code, and of each agent the memory, the
processor time, that of its partitions, the agent's per frame, and by how much its state frames come later after one
another than their period says. At the end stands what all processes of the flight used: hubs and manager as well.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from can.typechecking import CanFilter

from heronry_tools.console.errors import exit_code
from heronry_tools.console.spec_argument import load_spec, spec_path
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.fleet import Fleet, run_folder
from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.runtime.softbus.protocol import ClientStatistics
from heronry_wire.identifiers import state_id

_SETTLE_S = 3.0  # from the first configuration on: the manager thinks ahead, and late-comers join
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_PAGE = 0xC0  # of a state frame, in its first byte; page 0 alone is periodic
_MS = 1e3
_START_UP = (
    "import resource, time; start = time.process_time(); import heronry_agent.shell.cli; "
    "print(time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; gives the exit code."""
    parser = argparse.ArgumentParser(description="Measure what agents cost and how steady they are.")
    parser.add_argument("--spec", default="big_blue", metavar="SPEC", help="default big_blue")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each flight (default 20)")
    parser.add_argument("--busy", type=int, default=os.cpu_count(), metavar="N", help="default one for each core")
    arguments = parser.parse_args(argv)
    print(f"{arguments.spec}; {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    _print_start_up()
    for others in (0, arguments.busy):
        with busy(others):
            print(f"\nbeside {others} busy processes" if others else "\nnothing else to do")
            _fly(arguments.spec, arguments.seconds)
    return 0


def _print_start_up() -> None:
    compiled = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    runs = [subprocess.check_output([sys.executable, "-c", _START_UP], text=True, env=compiled) for _ in range(5)]
    seconds, kibibytes = zip(*(map(float, run.split()) for run in runs), strict=True)
    print(f"import of the agent: {statistics.median(seconds):.3f} s of CPU, {max(kibibytes) / 1024:.1f} MiB")


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Keep this computer busy with so many processes that compute without end."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _fly(spec_name: str, seconds: float) -> None:
    spec = load_spec(spec_name)
    folder = run_folder()
    wired = [pe for pe in spec.pes.values() if spec.manager.bus in pe.buses]
    with ExitStack() as stack:
        fleet = stack.enter_context(Fleet(spec, spec_path(spec_name), folder))
        choices = choose(spec, folder, {}, None, prefer_vcan=False)
        fleet.start_buses(choices)
        events = fleet.start_manager()
        pids = {pe: fleet.start_pe(pe) for pe in spec.pes}
        while json.loads(events.readline())["event"] != "reconfigured":
            pass
        states: list[CanFilter] = [{"can_id": state_id(pe.node_id), "can_mask": 0x7FF} for pe in wired]
        observer = stack.enter_context(SoftBus(choices[spec.manager.bus].channel, states))
        time.sleep(_SETTLE_S)
        while observer.recv(0) is not None:
            pass
        before, cpu_before = observer.statistics(), _times(os.getpid())
        late_ms = lateness_ms(observer, spec.buses[spec.manager.bus].heartbeat_ns / 1e6, seconds)
        after, cpu_after = observer.statistics(), _times(os.getpid())
        used = {pid: (parent, s - cpu_before.get(pid, (0, 0.0))[1]) for pid, (parent, s) in cpu_after.items()}
        _print_agents(pids, used, before.clients, after.clients, seconds)
        print(f"all processes {sum(used_s for _, used_s in used.values()) / seconds:.0%} of a core")
        print(f"bus load {after.load_since(before):.0%}, {(after.frames - before.frames) / seconds:.0f} frames/s")
        print("state frames later than their period, ms: " + ", ".join(quantiles(sorted(late_ms))))


def lateness_ms(observer: SoftBus, period_ms: float, seconds: float) -> list[float]:
    """Listen for so long; by how much each state frame came later after the one before than a period, in ms."""
    last: dict[int, float] = {}
    late_ms = []
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        message = observer.recv(left)
        if message is not None and message.data[0] & _PAGE == 0:
            if message.arbitration_id in last:
                gap_ms = (message.timestamp - last[message.arbitration_id]) * _MS
                late_ms.append(max(0.0, gap_ms - period_ms))
            last[message.arbitration_id] = message.timestamp
    return late_ms


def quantiles(late_ms: Sequence[float]) -> Iterator[str]:
    """Words for what was sorted before."""
    for name, share in (("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999)):
        yield f"{name} {late_ms[int(share * (len(late_ms) - 1))]:.2f}"
    yield f"longest {late_ms[-1]:.2f} of {len(late_ms)}"


def _print_agents(
    pids: dict[str, int],
    used: dict[int, tuple[int, float]],
    before: Sequence[ClientStatistics],
    after: Sequence[ClientStatistics],
    seconds: float,
) -> None:
    frames_before = {client.pid: client.sent + client.received for client in before}
    clients = {client.pid: client for client in after}
    print(f"{'PE':<10}{'MiB':>6}{'CPU':>7}{'partitions':>12}{'frames/s':>10}{'us/frame':>10}{'lost':>6}")
    for pe, pid in pids.items():
        used_s, partitions_s = used[pid][1], sum(cpu for parent, cpu in used.values() if parent == pid)
        line = f"{pe:<10}{resident_mib(pid):>6.1f}{used_s / seconds:>7.1%}{partitions_s / seconds:>12.1%}"
        if pid in clients:
            client = clients[pid]
            frames = client.sent + client.received - frames_before[pid]
            line += f"{frames / seconds:>10.0f}{used_s / max(frames, 1) * 1e6:>10.0f}{client.overruns:>6}"
        print(line)


def cpu_s(pid: int) -> float:
    """Processor time that a process has used, user and system (proc(5), stat, fields 14 and 15)."""
    fields = _stat(pid)
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def _times(root: int) -> dict[int, tuple[int, float]]:
    """Parent and processor time of a process and of all that it has started."""
    family = {root: (0, cpu_s(root))}
    for folder in sorted(Path("/proc").iterdir(), key=lambda each: each.name.zfill(20)):
        with suppress(OSError, ValueError, IndexError):
            pid = int(folder.name)
            if (parent := int(_stat(pid)[1])) in family:
                family[pid] = parent, cpu_s(pid)
    return family


def _stat(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()


def resident_mib(pid: int) -> float:
    """Memory of a process, with what it shares."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmRSS"))


if __name__ == "__main__":
    sys.exit(exit_code(main, "agent_bench"))
