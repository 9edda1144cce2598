"""What a node costs that runs nothing, how steady its heartbeats are, and whether it keeps up with a full bus.

    python -m lab.benches.node [--agents 8] [--seconds 60] [--busy 2]

Real `pe-agent` processes on a software bus of 1 Mbit/s, without a manager: no module disturbs the figures (those of a
whole aircraft are `lab.benches.agent`'s). Four things are measured, each over so many seconds:

    lateness   by how much state frames come later after one another than the 20 ms that they should, of all agents
               together, idle and beside processes that compute
    sent       processor time per frame that an agent sends: the difference between periods of 5 and of 20 ms
    received   the same per frame that it takes in: the difference that the traffic below makes
    full bus   the bus is filled, as far as this computer lets it, with state frames of other PEs, which every PE
               reads: frames taken in, frames lost
"""

import argparse
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory

import can

from heronry_dg.loader import loads
from heronry_tools.console.errors import exit_code
from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.runtime.softbus.protocol import BusStatistics, ClientStatistics
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_tools.runtime.table_files import write_tables
from heronry_wire.identifiers import PE_NODES, state_id
from heronry_wire.state_frames import PeFlags, PeState, StatePage0
from lab.benches.agent import busy, cpu_s, lateness_ms, quantiles, resident_mib

_BITRATE = 1_000_000
_SETTLE_S = 2.0
_PERIOD_MS, _SHORT_PERIOD_MS = 20, 5
_SENDERS = 4


@dataclass(frozen=True, slots=True)
class Cost:
    """What one agent used in a while."""

    cpu_s: float
    sent: int
    received: int
    lost: int
    bus_load: float


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; gives the exit code: 1 where a frame was lost."""
    parser = argparse.ArgumentParser(description="Measure nodes that run nothing.")
    parser.add_argument("--agents", type=int, default=8, metavar="N", help="default 8")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each measurement (default 60)")
    parser.add_argument("--busy", type=int, default=os.cpu_count(), metavar="N", help="default one for each core")
    arguments = parser.parse_args(argv)
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    for others in (0, arguments.busy):
        with busy(others), _agents(arguments.agents, _PERIOD_MS) as (bus, pids):
            late_ms = sorted(lateness_ms(bus, _PERIOD_MS, arguments.seconds))
            print(f"{arguments.agents} agents beside {others} busy processes, heartbeats of {_PERIOD_MS} ms")
            print("  later than their period, ms: " + ", ".join(quantiles(late_ms)))
            print(f"  memory of an agent: {max(resident_mib(pid) for pid in pids):.1f} MiB")
    return _costs(arguments.seconds)


def _costs(seconds: float) -> int:
    """Measure one agent: idle, with short heartbeats, on a full bus."""
    idle, quick = (_measured(period_ms, seconds) for period_ms in (_PERIOD_MS, _SHORT_PERIOD_MS))
    full = _measured(_PERIOD_MS, seconds, is_full=True)
    sent_us = (quick.cpu_s - idle.cpu_s) / max(1, quick.sent - idle.sent) * 1e6
    received_us = (full.cpu_s - idle.cpu_s) / max(1, full.received - idle.received) * 1e6
    print(f"an agent, idle: {idle.cpu_s / seconds:.2%} of a core")
    print(f"  CPU per frame sent {sent_us:.0f} us, received {received_us:.0f} us")
    share = f"{full.cpu_s / seconds:.0%} of a core"
    print(
        f"a bus at {full.bus_load:.0%}: {full.received / seconds:.0f} frames/s taken in with {share}, {full.lost} lost"
    )
    return 1 if full.lost else 0


def _measured(period_ms: int, seconds: float, *, is_full: bool = False) -> Cost:
    with _agents(1, period_ms) as (bus, (pid,)):
        start, cpu_before_s = bus.statistics(), cpu_s(pid)
        if is_full:
            _fill(bus.channel_info.partition(" ")[2], seconds)
        else:
            time.sleep(seconds)
        end, cpu_after_s = bus.statistics(), cpu_s(pid)
    before, after = (_client(statistics, pid) for statistics in (start, end))
    return Cost(
        cpu_after_s - cpu_before_s,
        after.sent - before.sent,
        after.received - before.received,
        after.overruns - before.overruns,
        end.load_since(start),
    )


def _fill(path: str, seconds: float) -> None:
    """Send state frames of all other PEs; one sender by itself leaves gaps, in which it learns that it may go on."""
    data = StatePage0(PeState.UNCONFIGURED, PeFlags(0), 0, 0, 0, 0).encode()
    end_s = time.monotonic() + seconds
    with ExitStack() as stack:
        senders = [stack.enter_context(SoftBus(path, [])) for _ in range(_SENDERS)]
        messages = [
            (sender, can.Message(arbitration_id=state_id(node), data=data, is_extended_id=False))
            for sender, node in zip(cycle(senders), PE_NODES[len(PE_NODES) // 2 :])
        ]
        while time.monotonic() < end_s:
            for sender, message in messages:
                sender.send(message)


def _client(statistics: BusStatistics, pid: int) -> ClientStatistics:
    return next(client for client in statistics.clients if client.pid == pid)


@contextmanager
def _agents(count: int, period_ms: int) -> Iterator[tuple[SoftBus, list[int]]]:
    """Agents that run nothing, and a place on their bus that hears their state frames."""
    spec = loads(_spec(count, period_ms), "bench.dg.yaml")
    with TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        hub = start_hub(folder / "can0.sock", _BITRATE)
        stack.callback(hub.close)
        tables = write_tables(spec, tuple(spec.pes), folder)
        processes = [_start(table, hub.path) for table in tables.values()]
        for process in processes:
            stack.callback(_end, process)
        states = [{"can_id": state_id(pe.node_id), "can_mask": 0x7FF} for pe in spec.pes.values()]
        bus = stack.enter_context(SoftBus(str(hub.path), states))  # type: ignore[arg-type]
        waited_for = set(range(state_id(PE_NODES[0]), state_id(PE_NODES[0]) + count))
        while waited_for:
            message = bus.recv()
            waited_for -= {message.arbitration_id} if message is not None else set()
        time.sleep(_SETTLE_S)
        while bus.recv(0) is not None:
            pass
        yield bus, [process.pid for process in processes]


def _start(table: Path, channel: Path | str) -> "subprocess.Popen[bytes]":
    words = ["--table", str(table), "-i", "softbus", "-c", str(channel), "--quiet", "--until-eof"]
    return subprocess.Popen([sys.executable, "-m", "heronry_agent", *words], stdin=subprocess.PIPE)


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.communicate()


def _spec(count: int, period_ms: int) -> str:
    """PEs, and one module that never runs, since a spec wants one."""
    pes = "\n".join(
        f"  pe_{n}: {{node_id: {PE_NODES[0] + n}, buses: [can0], cpu: 1, ram: 1MiB, flash: 1MiB}}" for n in range(count)
    )
    return f"""\
dg: 1
name: bench
buses: {{can0: {{bitrate: {_BITRATE}, heartbeat_ms: {period_ms}}}}}
pes:
{pes}
modules: {{nothing: {{cpu: 0.1, ram: 1KiB, rate_hz: 1, image: telemetry}}}}
functions: {{nothing: {{output: nothing}}}}
"""


if __name__ == "__main__":
    sys.exit(exit_code(main, "node_bench"))
