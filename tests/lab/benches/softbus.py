"""Measure the software bus: `python -m lab.benches.softbus`.

Client processes at 1 Mbit/s send eight-byte frames as fast as the bus takes them, twice: once each of them
receives everything that the others send, the worst that can be asked of the hub; then, as nodes do, each
filters, and receives its own echoes and what one neighbour sends.

Reported are frames per second, bus load (exact frame times over elapsed time), the hub's share of one
processor, the lateness of reception (from the end of a frame on the bus to `recv` returning it, so with the
receiver's own delay) and the frames that receivers lost.
"""

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from pathlib import Path

import can
from can.typechecking import CanFilter

from heronry_tools.console.errors import exit_code
from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.runtime.softbus.starter import HubProcess, start_hub

_NOTHING: list[CanFilter] = [{"can_id": 0x1FFF_FFFF, "can_mask": 0x1FFF_FFFF, "extended": True}]
_SETTLE_S = 1.0
_CLOCK_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Run the benchmark and print its figures."""
    parser = argparse.ArgumentParser(prog="python -m lab.benches.softbus", description="Measure the software bus.")
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=5.0)
    options = parser.parse_args()
    for filtering in (False, True):
        print("each hears itself and its neighbour" if filtering else "everybody hears everything")
        with tempfile.TemporaryDirectory() as folder, start_hub(Path(folder) / "bus") as hub:
            _measure(hub, options.clients, options.seconds, filtering=filtering)


def _measure(hub: HubProcess, clients: int, seconds: float, *, filtering: bool) -> None:
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
        before, cpu_before_s = observer.statistics(), _cpu_s(hub.pid)
        time.sleep(seconds)
        after, cpu_after_s = observer.statistics(), _cpu_s(hub.pid)
        hub.close()
        lateness_s = sorted(late for end in ends for late in end.result())
    elapsed_s = (after.time_ns - before.time_ns) / 1e9
    print(f"  frames per second      {(after.frames - before.frames) / elapsed_s:.0f}")
    print(f"  bus load               {after.load_since(before):.1%}")
    print(f"  hub, share of one CPU  {(cpu_after_s - cpu_before_s) / elapsed_s:.0%}")
    for percent in (50, 99):
        print(f"  lateness p{percent}           {lateness_s[len(lateness_s) * percent // 100] * 1e3:.3f} ms")
    print(f"  frames not received    {sum(client.overruns for client in after.clients)}")


def _pair(number: int, clients: int) -> list[CanFilter]:
    return [{"can_id": 0x100 + each, "can_mask": 0x7FF} for each in (number, (number + 1) % clients)]


def _talk_and_listen(path: str, number: int, filters: list[CanFilter] | None) -> list[float]:
    """Send without pause until the hub ends; return by how much each reception was late (s)."""
    lateness_s: list[float] = []
    frame = can.Message(arbitration_id=0x100 + number, is_extended_id=False, data=[number] * 8)
    with SoftBus(path, filters, receive_own_messages=True) as bus, suppress(can.CanOperationError):
        bus.send(frame)
        while (received := bus.recv()) is not None:
            lateness_s.append(time.time() - received.timestamp)
            if not received.is_rx:
                bus.send(frame)
    return lateness_s


def _cpu_s(pid: int) -> float:
    """Return the processor time that a process has used, user and system (proc(5), stat, fields 14 and 15)."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _CLOCK_TICKS_PER_S


if __name__ == "__main__":
    sys.exit(exit_code(main, "bench"))
