"""What a node without modules costs, how steady its heartbeats are, and whether it keeps up with a full bus.

    python -m lab.benches.node [--agents 8] [--seconds 60] [--busy 2]

Real `pe-agent` processes on a software bus of 1 Mbit/s, without a manager: no module disturbs the figures (those of a
whole aircraft are `lab.benches.agent`'s). Four things are measured, each for `--seconds`:

    lateness   by how much the interval between two state frames is longer than their period of 20 ms, over all agents,
               on an idle computer and beside processes that compute
    sent       processor time per frame that an agent sends: the difference between periods of 5 and of 20 ms
    received   processor time per frame that an agent receives: the difference that the traffic below makes
    full bus   the bus is filled, as far as this computer lets it, with state frames of other PEs, which every PE
               reads: frames received, frames lost; none may be
"""

import os
import subprocess
import sys
import time
from argparse import Namespace
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory

import can

from heronry_dg.loader import loads
from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.runtime.softbus.protocol import BusStatistics, ClientStatistics
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_tools.runtime.table_files import write_tables
from heronry_wire.identifiers import PE_NODES, state_id
from heronry_wire.state_frames import PeFlags, PeState, StatePage0
from lab.benches.harness import Benchmark, Report, option, seconds_option
from lab.benches.processes import busy, cpu_s, resident_mib
from lab.benches.state_frames import forget_waiting, lateness_ms

_BITRATE = 1_000_000
_SETTLE_S = 2.0
_PERIOD_MS, _SHORT_PERIOD_MS = 20, 5
_SENDERS = 4


@dataclass(frozen=True, slots=True)
class Cost:
    """The frames and the processor time of one agent in one measurement."""

    cpu_s: float
    sent: int
    received: int
    lost: int
    bus_load: float


def measure(arguments: Namespace, report: Report) -> None:
    """Measure lateness, then what one agent costs."""
    for others in (0, arguments.busy):
        with busy(others) as said, _agents(arguments.agents, _PERIOD_MS) as (bus, pids):
            report.begin(f"{arguments.agents} agents, heartbeats of {_PERIOD_MS} ms, {said}")
            report.times("state frames, later than due", lateness_ms(bus, _PERIOD_MS, arguments.seconds))
            report.figures(
                "  memory of an agent: {memory_mib:.1f} MiB", memory_mib=max(resident_mib(pid) for pid in pids)
            )
    _costs(arguments.seconds, report)


def _costs(seconds: float, report: Report) -> None:
    """Measure one agent: idle, with short heartbeats, on a full bus."""
    idle, quick = (_measured(period_ms, seconds) for period_ms in (_PERIOD_MS, _SHORT_PERIOD_MS))
    full = _measured(_PERIOD_MS, seconds, is_full=True)
    report.begin("one agent")
    report.figures(
        "  idle: {idle_cpu:.2%} of a core; CPU per frame sent {sent_us:.0f} us, received {received_us:.0f} us",
        idle_cpu=idle.cpu_s / seconds,
        sent_us=(quick.cpu_s - idle.cpu_s) / max(1, quick.sent - idle.sent) * 1e6,
        received_us=(full.cpu_s - idle.cpu_s) / max(1, full.received - idle.received) * 1e6,
    )
    report.figures(
        "  a bus at {load:.0%}: {frames_per_s:.0f} frames/s received with {cpu:.0%} of a core, {lost} lost",
        load=full.bus_load,
        frames_per_s=full.received / seconds,
        cpu=full.cpu_s / seconds,
        lost=full.lost,
    )
    report.require(not full.lost)


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
    """Send state frames of all other PEs; a single sender leaves gaps, in which it waits for its next turn.

    Each state names another epoch, so that the agent needs all of them.
    """
    states = cycle([StatePage0(PeState.UNCONFIGURED, PeFlags(0), 0, epoch, 0, 0).encode() for epoch in range(1 << 16)])
    end_s = time.monotonic() + seconds
    with ExitStack() as stack:
        senders = [stack.enter_context(SoftBus(path, [])) for _ in range(_SENDERS)]
        pairs = list(zip(cycle(senders), PE_NODES[len(PE_NODES) // 2 :]))
        while time.monotonic() < end_s:
            for sender, node in pairs:
                data = next(states)
                sender.send(can.Message(arbitration_id=state_id(node), data=data, is_extended_id=False))


def _client(statistics: BusStatistics, pid: int) -> ClientStatistics:
    return next(client for client in statistics.clients if client.pid == pid)


@contextmanager
def _agents(count: int, period_ms: int) -> Iterator[tuple[SoftBus, list[int]]]:
    """Start agents without modules, and a client on their bus that receives their state frames."""
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
        forget_waiting(bus)
        yield bus, [process.pid for process in processes]


def _start(table: Path, channel: Path | str) -> "subprocess.Popen[bytes]":
    words = ["--simulated", "--table", str(table), "-i", "softbus", "-c", str(channel), "--quiet", "--until-eof"]
    return subprocess.Popen([sys.executable, "-m", "heronry_agent", *words], stdin=subprocess.PIPE)


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.communicate()


def _spec(count: int, period_ms: int) -> str:
    """Return a spec with PEs and one module that never runs, since a spec must have one."""
    pes = "\n".join(
        f"  pe_{n}: {{node_id: {PE_NODES[0] + n}, buses: [can0], cpu: 1, ram: 1MiB, flash: 1MiB}}" for n in range(count)
    )
    return f"""\
dg: 1
name: idle_nodes
buses: {{can0: {{bitrate: {_BITRATE}, heartbeat_ms: {period_ms}}}}}
pes:
{pes}
modules: {{nothing: {{cpu: 0.1, ram: 1KiB, rate_hz: 1, image: telemetry}}}}
functions: {{nothing: {{output: nothing}}}}
"""


main = Benchmark(
    "node",
    __doc__,
    measure,
    option("--agents", 8, "without modules"),
    seconds_option(60.0, "of each measurement"),
    option("--busy", os.cpu_count(), "processes that compute"),
)
if __name__ == "__main__":
    sys.exit(main())
