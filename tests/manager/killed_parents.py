"""What stays of a helper process when the program that has started it is killed."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

_PR_SET_CHILD_SUBREAPER = 36  # linux/prctl.h


def state_of(pid: int) -> str | None:
    """Return the letter of a process's state; None where it has ended."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return None
    return None if state in "ZX" else state


def until(holds: Callable[[], bool]) -> None:
    """Wait until something holds, for a minute at most."""
    end_s = time.monotonic() + 60
    while not holds():
        assert time.monotonic() < end_s
        time.sleep(0.005)


def expect_end_of_helper(script: str, *words: str, environment: Mapping[str, str] | None = None) -> None:
    """Run a program that starts a helper, prints its number and kills itself; expect that the helper ends, too."""
    with (
        _adopting_orphans(),
        subprocess.Popen(
            [sys.executable, "-c", script, *words], stdout=subprocess.PIPE, text=True, env=environment
        ) as program,
    ):
        said, _ = program.communicate(timeout=120)
        assert program.returncode == -signal.SIGKILL
        pid = int(said)
        try:
            until(lambda: state_of(pid) is None)
        finally:
            if state_of(pid) is not None:
                os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)


@contextmanager
def _adopting_orphans() -> Iterator[None]:
    """Be the new parent of orphans: one of their session, so that the kernel sends a stopped one no SIGHUP."""
    prctl = ctypes.CDLL(None).prctl
    prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    try:
        yield
    finally:
        prctl(_PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)
