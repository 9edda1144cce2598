"""What processes use, and what else this computer has to do: proc(5), and processes that compute without end."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def cpu_s(pid: int) -> float:
    """Processor time that a process has used, user and system (stat, fields 14 and 15)."""
    fields = _stat(pid)
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def family_cpu_s(root: int) -> dict[int, tuple[int, float]]:
    """Parent and processor time of a process and of all that it has started, by process number."""
    family = {root: (0, cpu_s(root))}
    for folder in sorted(Path("/proc").iterdir(), key=lambda each: each.name.zfill(20)):
        with suppress(OSError, ValueError, IndexError):
            pid = int(folder.name)
            if (parent := int(_stat(pid)[1])) in family:
                family[pid] = parent, cpu_s(pid)
    return family


def resident_mib(pid: int) -> float:
    """Memory of a process, with what it shares."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmRSS"))


def _stat(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()


@contextmanager
def busy(count: int) -> Iterator[str]:
    """Keep this computer busy with so many processes that compute without end; gives words for that."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield f"beside {count} busy processes" if count else "nothing else to do"
    finally:
        for process in processes:
            process.kill()
            process.wait()
