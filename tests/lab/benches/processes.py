"""Processor time, memory and descriptors of processes, from proc(5), and processes that load this computer."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def cpu_s(pid: int) -> float:
    """Return the processor time of a process in seconds, user and system (stat, fields 14 and 15)."""
    fields = _stat(pid)
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def family_cpu_s(root: int) -> dict[int, tuple[int, float]]:
    """Return parent and processor time (s) of a process and of all its descendants, by process number."""
    family = {root: (0, cpu_s(root))}
    for folder in sorted(Path("/proc").iterdir(), key=lambda each: each.name.zfill(20)):
        with suppress(OSError, ValueError, IndexError):
            pid = int(folder.name)
            if (parent := int(_stat(pid)[1])) in family:
                family[pid] = parent, cpu_s(pid)
    return family


def resident_mib(pid: int) -> float:
    """Return the memory of a process in MiB, shared memory included."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmRSS"))


def busy_s() -> tuple[float, float]:
    """Return how long this computer's processors have been busy, and idle, since it started, in s (stat, line 1)."""
    user, nice, system, idle, waiting, *rest = map(int, Path("/proc/stat").read_text(encoding="ascii").split()[1:9])
    return (user + nice + system + sum(rest)) / _TICKS_PER_S, (idle + waiting) / _TICKS_PER_S


def busy_share(before_s: tuple[float, float]) -> float:
    """Return the share of all processors that has been busy since `busy_s` gave `before_s`, 0 to 1."""
    busy, idle = (now - then for now, then in zip(busy_s(), before_s, strict=True))
    return busy / max(busy + idle, 1 / _TICKS_PER_S)


def open_descriptors(pid: int) -> int:
    """Return the number of open descriptors of a process."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def children(pid: int) -> list[int]:
    """Return the children that the first thread of a process has started, by process number."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()]


def _stat(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()


@contextmanager
def busy(count: int) -> Iterator[str]:
    """Run `count` processes that compute without end; gives a phrase about them for the report."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield f"beside {count} busy processes" if count else "nothing else to do"
    finally:
        for process in processes:
            process.kill()
            process.wait()
