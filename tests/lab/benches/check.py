"""How long `heronry check --fast` takes, and how much memory: specs of growing size, and malicious files.

Each file is checked by a process of its own. The first line is a spec of two modules, which takes nearly only the
start-up. On a busy machine the CPU time is the figure to read.
"""

import os
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from pathlib import Path

from heronry_dg.check.examples import SOUND
from lab.benches.harness import Benchmark, Report, option

_MILLION = 1_000_000


def chain(modules: int) -> str:
    """Return a valid spec: chains of ten modules, from a sensor to an output, with optional inputs on the way."""
    starts = range(0, modules, 10)
    body = "cpu: 0.001, ram: 1KiB, rate_hz: 10"
    lines = ["dg: 1", "buses: {can0: {bitrate: 1000000}}"]
    lines += ["pes: {p0: {node_id: 92, buses: [can0], cpu: 1000, ram: 64MiB, flash: 64MiB}}", "devices:"]
    lines += [f"  d{i}: {{kind: sensor, pe: p0}}" for i in starts]
    lines += ["variables:", *(f"  v{i}: {{type: FLOAT, unit: m/s, versions: 2}}" for i in range(modules))]
    lines += ["modules:"]
    for i in range(modules):
        needs = f"needs: {{and: [v{i - 1}, {{or: {{k: 0, of: ['v{i - i % 10}@1']}}}}]}}"
        if i % 10 < 2:
            needs = f"needs: v{i - 1}" if i % 10 else f"device: d{i}"
        lines.append(f"  m{i}: {{{needs}, gives: {{v{i}: 1}}, {body}}}")
    lines += ["functions:", *(f"  f{i + 9}: {{output: m{i + 9}}}" for i in starts)]
    return "\n".join([*lines, ""])


def files() -> dict[str, bytes]:
    """Return the files to check, by name."""
    laughs = "".join(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]\n" for i in range(1, 10))
    return {
        "two modules": SOUND.encode(),
        **{f"{modules} modules": chain(modules).encode() for modules in (100, 1_000, 10_000)},
        "a billion laughs": f"dg: 1\nl0: &l0 [ha]\n{laughs}".encode(),
        "nested 5 000 deep": b"dg: 1\nname: " + b"[" * 5_000 + b"]" * 5_000,
        "100 MB": b"dg: 1\n" + b"# " * (50 * _MILLION),
        "no UTF-8": b"dg: 1\nname: " + b"x" * 3 * _MILLION + b"\xff",
        "a million duplicate keys": b"k:\n" * _MILLION,
        "a million explicit duplicate keys": b"? k\n" * _MILLION,
    }


_CHILD = """
import sys
from heronry_tools.cli import main
main(["check", "--fast", "--ignore", "DG24,DG5", sys.argv[1]])
print(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1])
"""


def measure(arguments: Namespace, report: Report) -> None:
    """Check each file `--runs` times."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "x.dg.yaml")
        for name, data in files().items():
            path.write_bytes(data)
            runs = [_checked(path) for _ in range(arguments.runs)]
            report.begin(name)
            report.figures(
                "  {wall_s:6.2f} s wall, {cpu_s:6.2f} s CPU, {memory_mib:5.0f} MiB; {said}",
                wall_s=min(run[0] for run in runs),
                cpu_s=min(run[1] for run in runs),
                memory_mib=int(runs[-1][2][-1]) / 1024,
                said=runs[-1][2][-2],
            )


def _checked(path: Path) -> tuple[float, float, list[str]]:
    """Check a file in a process of its own; gives wall time and CPU time in seconds, and the lines of its output."""
    begin, before = time.perf_counter(), os.times()
    command = [sys.executable, "-c", _CHILD, str(path)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    after = os.times()
    used_s = after.children_user - before.children_user + after.children_system - before.children_system
    return time.perf_counter() - begin, used_s, said


main = Benchmark("check", __doc__, measure, option("--runs", 3, "of each file; the best times count"))
if __name__ == "__main__":
    sys.exit(main())
