"""Measure the software bus: `python -m heronry_tools.softbus.bench`.

Eight client processes at 1 Mbit/s send eight-byte frames as fast as the bus takes them and receive all that
the others send: the worst that a demonstration can ask of the hub. Reported are frames per second, bus load
(exact frame times over elapsed time), the hub's share of one processor, the lateness of reception (from the
end of a frame on the bus to `recv` returning it) and the frames that receivers lost.
"""

import argparse
import multiprocessing
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import can
from can.typechecking import CanFilter

from heronry_tools.softbus.client import SoftBus
from heronry_tools.softbus.starter import HubProcess, start_hub

_NOTHING: list[CanFilter] = [{"can_id": 0x1FFF_FFFF, "can_mask": 0x1FFF_FFFF, "extended": True}]
_SETTLE_S = 1.0
_CLOCK_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Run the benchmark and print one figure a line."""
    parser = argparse.ArgumentParser(prog="python -m heronry_tools.softbus.bench", description=__doc__.split("\n")[0])
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("-b", "--bitrate", type=int, default=1_000_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bus"
        with start_hub(path, options.bitrate) as hub:
            _measure(hub, options.clients, options.seconds)


def _measure(hub: HubProcess, clients: int, seconds: float) -> None:
    spawn = multiprocessing.get_context("spawn")
    with (
        SoftBus(str(hub.path), can_filters=_NOTHING) as observer,
        ProcessPoolExecutor(clients, mp_context=spawn) as pool,
    ):
        ends = [pool.submit(_talk_and_listen, str(hub.path), number) for number in range(clients)]
        while len(observer.statistics().clients) <= clients:
            time.sleep(0.01)
        time.sleep(_SETTLE_S)
        before, cpu_before_s = observer.statistics(), _cpu_s(hub.pid)
        time.sleep(seconds)
        after, cpu_after_s = observer.statistics(), _cpu_s(hub.pid)
        elapsed_s = (after.time_ns - before.time_ns) / 1e9
        hub.close()
        lateness_s = sorted(late for end in ends for late in end.result())
    print(f"frames per second      {(after.frames - before.frames) / elapsed_s:.0f}")
    print(f"bus load               {after.load_since(before):.1%}")
    print(f"hub, share of one CPU  {(cpu_after_s - cpu_before_s) / elapsed_s:.0%}")
    for percent in (50, 99):
        print(f"lateness p{percent}           {lateness_s[len(lateness_s) * percent // 100] * 1e3:.3f} ms")
    print(f"frames not received    {sum(client.overruns for client in after.clients)}")


def _talk_and_listen(path: str, number: int) -> list[float]:
    """Send without pause until the hub ends; return by how much each reception was late (s)."""
    lateness_s = []
    frame = can.Message(arbitration_id=0x100 + number, is_extended_id=False, data=[number] * 8)
    with SoftBus(path, receive_own_messages=True) as bus:
        bus.send(frame)
        try:
            while (received := bus.recv()) is not None:
                lateness_s.append(time.time() - received.timestamp)
                if not received.is_rx:
                    bus.send(frame)
        except can.CanOperationError:
            return lateness_s
    return lateness_s


def _cpu_s(pid: int) -> float:
    """Return the processor time that a process has used, user and system (proc(5), stat, fields 14 and 15)."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _CLOCK_TICKS_PER_S


if __name__ == "__main__":
    main()
