"""Throughput and lateness of the software bus.

Client processes at 1 Mbit/s send eight-byte frames as fast as the bus accepts them, twice: first each client
receives all frames of the others, the largest load of the hub; then, as nodes do, each client filters, and
receives its own echoes and the frames of one neighbour.

Reported are frames per second, bus load (exact frame times over elapsed time), the hub's share of one
processor, the lateness of reception (from the end of a frame on the bus to `recv` returning it, so with the
receiver's own delay) and the frames that receivers lost.
"""

import multiprocessing
import sys
import tempfile
import time
from argparse import Namespace
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from pathlib import Path

import can
from can.typechecking import CanFilter

from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.runtime.softbus.starter import HubProcess, start_hub
from lab.benches.harness import Benchmark, Report, option, seconds_option
from lab.benches.processes import cpu_s

_NOTHING: list[CanFilter] = [{"can_id": 0x1FFF_FFFF, "can_mask": 0x1FFF_FFFF, "extended": True}]
_SETTLE_S = 1.0


def measure(arguments: Namespace, report: Report) -> None:
    """Measure without and with filters."""
    for filtering in (False, True):
        report.begin("each client hears itself and its neighbour" if filtering else "each client hears all clients")
        with tempfile.TemporaryDirectory() as folder, start_hub(Path(folder) / "bus") as hub:
            _measure(hub, arguments.clients, arguments.seconds, report, filtering=filtering)


def _measure(hub: HubProcess, clients: int, seconds: float, report: Report, *, filtering: bool) -> None:
    spawn = multiprocessing.get_context("spawn")
    with (
        SoftBus(str(hub.path), can_filters=_NOTHING) as observer,
        ProcessPoolExecutor(clients, mp_context=spawn) as pool,
    ):
        ends = [
            pool.submit(_talk_and_listen, str(hub.path), number, _pair(number, clients) if filtering else None)
            for number in range(clients)
        ]
        while len(observer.statistics().clients) <= clients:
            time.sleep(0.01)
        time.sleep(_SETTLE_S)
        before, cpu_before_s = observer.statistics(), cpu_s(hub.pid)
        time.sleep(seconds)
        after, cpu_after_s = observer.statistics(), cpu_s(hub.pid)
        hub.close()
        late_ms = [late for end in ends for late in end.result()]
    elapsed_s = (after.time_ns - before.time_ns) / 1e9
    report.figures(
        "  {frames_per_s:.0f} frames/s, bus load {load:.1%}, hub {hub_cpu:.0%} of one CPU, {lost} frames not received",
        frames_per_s=(after.frames - before.frames) / elapsed_s,
        load=after.load_since(before),
        hub_cpu=(cpu_after_s - cpu_before_s) / elapsed_s,
        lost=sum(client.overruns for client in after.clients),
    )
    report.times("lateness", late_ms)


def _pair(number: int, clients: int) -> list[CanFilter]:
    return [{"can_id": 0x100 + each, "can_mask": 0x7FF} for each in (number, (number + 1) % clients)]


def _talk_and_listen(path: str, number: int, filters: list[CanFilter] | None) -> list[float]:
    """Send without pause until the hub ends; gives the lateness of each reception (ms)."""
    late_ms: list[float] = []
    frame = can.Message(arbitration_id=0x100 + number, is_extended_id=False, data=[number] * 8)
    with SoftBus(path, filters, receive_own_messages=True) as bus, suppress(can.CanOperationError):
        bus.send(frame)
        while (received := bus.recv()) is not None:
            late_ms.append((time.time() - received.timestamp) * 1e3)
            if not received.is_rx:
                bus.send(frame)
    return late_ms


main = Benchmark(
    "softbus",
    __doc__,
    measure,
    option("--clients", 8, "that send and receive"),
    seconds_option(5.0, "of each measurement"),
)
if __name__ == "__main__":
    sys.exit(main())
