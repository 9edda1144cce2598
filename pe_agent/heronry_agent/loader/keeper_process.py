"""The process of a keeper, as the loader uses it: one operation at a time, and nothing waits for it but `boot`.

at rest    `begin` starts one
at work    `heard` returns its answer. A keeper that is killed, cannot be started, or hangs for KEEPER_NS, gives the
answer LOST: its operation was done, or was not; the next answer has the record as it is
"""

import json
import os
import subprocess
import sys
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from heronry_agent.loader.keeper import DISK, Answer
from heronry_wire.sansio import NEVER_NS

KEEPER_NS = 60_000_000_000
LOST = Answer(DISK, "the process that keeps the code ended or hung: look whether the disk works", None, None)
_BOOT_S = 10.0
_STANDS_BACK = 5  # steps of "niceness", as a partition's
_MOST_ANSWER = 1 << 20
_INHERITED = ("HOME", "LANG", "LD_LIBRARY_PATH", "PATH", "TZ", "VIRTUAL_ENV")


class KeeperProcess:
    """Starts keepers of one folder; `next_ns` is the time in ns at which to call `heard` at the latest."""

    def __init__(self, folder: Path, key: Path | None) -> None:
        """Begin without a process.

        folder: the folder of --code-dir.
        key: file of the public key; None: code need not be signed.
        """
        self._command = [sys.executable, "-m", "heronry_agent.loader.keeper", str(folder)]
        self._key = key
        self._process: subprocess.Popen[bytes] | None = None
        self._said = b""
        self.next_ns = NEVER_NS

    @property
    def readers(self) -> Collection[int]:
        """Return what `select` is to wait for."""
        return () if self._process is None or self._process.stdout is None else (self._process.stdout.fileno(),)

    def boot(self) -> Answer:
        """Return the answer to the operation `boot`; waits for it for a while."""
        try:
            done = subprocess.run(
                [*self._command, "boot"],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=_environment(),
                timeout=_BOOT_S,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired):
            return LOST
        return _read(done.stdout)

    def begin(self, operation: str, content: bytes, now_ns: int) -> None:
        """Start a keeper; where that is not possible, `heard` gives LOST at once."""
        self._said, self.next_ns = b"", now_ns + KEEPER_NS
        arguments = [operation] if self._key is None else [operation, str(self._key)]
        try:
            file = os.memfd_create("bundle", os.MFD_CLOEXEC)
            with os.fdopen(file, "w+b") as stream:
                stream.write(content)
                stream.flush()
                stream.seek(0)
                self._process = subprocess.Popen(
                    [*self._command, *arguments],
                    stdin=stream,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    env=_environment(),
                    process_group=0,
                )
            os.setpriority(os.PRIO_PROCESS, self._process.pid, os.getpriority(os.PRIO_PROCESS, 0) + _STANDS_BACK)
        except OSError:
            self.next_ns = now_ns

    def heard(self, ready: Collection[object], now_ns: int) -> Answer | None:
        """Return the answer of the keeper that is at work; None while there is none."""
        if now_ns < self.next_ns:
            if not any(one in ready for one in self.readers):
                return None
            came = b"".join(os.read(reader, _MOST_ANSWER) for reader in self.readers)
            self._said += came
            if came and not self._said.endswith(b"\n"):
                return None
        self.close()
        return _read(self._said)

    def close(self) -> None:
        """End the keeper that is at work; the store is whole whenever that is."""
        process, self._process, self.next_ns = self._process, None, NEVER_NS
        if process is None:
            return
        with suppress(ProcessLookupError):
            process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def _read(line: bytes) -> Answer:
    try:
        return Answer(**json.loads(line))
    except (ValueError, TypeError):
        return LOST


def _environment() -> dict[str, str]:
    return {k: v for k, v in os.environ.items() if k in _INHERITED or k.startswith(("LC_", "PYTHON"))}
