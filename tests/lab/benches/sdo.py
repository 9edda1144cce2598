"""SDO block transfers into and out of a PE.

An unmodified `canopen` client and an agent that runs nothing, as processes on an idle software bus of 1 Mbit/s. The
client writes the PE's own table by block, and reads it, again and again. The report also has the rate at which the same
client process sends frames on that bus without a protocol: seven bytes of every eight are data there, too, so no block
download can be faster. The PE limits an upload to half of the bus.

On a busy machine the figures contain delays of other processes: `chrt -f 10` in front of the command keeps them out.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import canopen

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_tools.runtime.table_files import write_tables
from heronry_wire.canopen_objects import TABLE
from heronry_wire.eds import FILE_NAME, eds_text
from heronry_wire.identifiers import sdo_request_id
from heronry_wire.sdo import SEGMENT_BYTES
from lab.benches.harness import Benchmark, Report, option
from lab.benches.processes import cpu_s

_SPEC, _PE = "elevator_and_chute", "tail_pe"
_PATIENCE_S = 10.0


def measure(arguments: Namespace, report: Report) -> None:
    """Measure sending without a protocol, then with SDO."""
    with tempfile.TemporaryDirectory() as folder, start_hub(Path(folder) / "bus", 1_000_000) as hub:
        report.begin("a single sender, no protocol")
        _tell_rates(_bare(str(hub.path), arguments.runs), report)
        spec = load(shipped_spec_path(_SPEC))
        table = write_tables(spec, (_PE,), Path(folder))[_PE]
        words = [sys.executable, "-m", "heronry_agent", "--simulated", "--table", str(table), "--until-eof", "--quiet"]
        with subprocess.Popen([*words, "-i", "softbus", "-c", str(hub.path)], stdin=subprocess.PIPE) as agent:
            _transfer(str(hub.path), spec.pes[_PE].node_id, arguments.runs, agent.pid, report)
            agent.terminate()


def _bare(path: str, runs: int) -> list[float]:
    """Return bytes per second of one sender that sends as fast as the bus accepts its frames, one figure per run."""
    message = can.Message(arbitration_id=sdo_request_id(92), data=bytes(range(1, 9)), is_extended_id=False)
    with can.Bus(interface="softbus", channel=path) as bus:

        def send() -> int:
            for _ in range(1000):
                bus.send(message)
            return 1000 * SEGMENT_BYTES

        return [_rate(send) for _ in range(runs)]


def _transfer(path: str, node: int, runs: int, agent: int, report: Report) -> None:
    eds = Path(path).with_name(FILE_NAME)
    eds.write_text(eds_text(), encoding="ascii")
    network = canopen.Network()
    network.connect(interface="softbus", channel=path)
    remote: Any = network.add_node(node, str(eds))
    remote.nmt.wait_for_bootup(_PATIENCE_S)
    remote.sdo.RESPONSE_TIMEOUT = _PATIENCE_S
    table = remote.sdo[TABLE]

    def read() -> bytes:
        with table.open("rb", block_transfer=True) as stream:
            content: bytes = stream.read()
            return content

    content = read()

    def write() -> int:
        with table.open("wb", size=len(content), block_transfer=True, buffering=SEGMENT_BYTES * 1000) as stream:
            stream.write(content)
        return len(content)

    for name, fault in (("download", write), ("upload", lambda: len(read()))):
        report.begin(f"{name}, by block, of a table of {len(content)} bytes")
        before_s = cpu_s(agent)
        _tell_rates([_rate(fault) for _ in range(runs)], report)
        used_us = (cpu_s(agent) - before_s) * 1e6 / (runs * -(-len(content) // SEGMENT_BYTES))
        report.figures("  the agent's CPU: {us_per_segment:.0f} us for each segment", us_per_segment=used_us)
    network.disconnect()


def _rate(fault: Callable[[], int]) -> float:
    """Return bytes per second of a transfer, which returns the number of its bytes."""
    began_s = time.monotonic()
    return fault() / (time.monotonic() - began_s)


def _tell_rates(rates: list[float], report: Report) -> None:
    report.figures(
        "  median {median_kb_per_s:.1f} kB/s, slowest of a hundred {slowest_kb_per_s:.1f} kB/s",
        median_kb_per_s=statistics.median(rates) / 1e3,
        slowest_kb_per_s=sorted(rates)[len(rates) // 100] / 1e3,
    )


main = Benchmark("sdo", __doc__, measure, option("--runs", 20, "transfers of each kind"))
if __name__ == "__main__":
    sys.exit(main())
