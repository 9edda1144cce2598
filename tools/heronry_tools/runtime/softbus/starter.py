"""Starts a hub as a process of its own, which never outlives the process that started it.

    starting           until `wait_until_up` has returned
    running            clients can connect
    killed or closed   after `kill` or `close`

The hub holds the read end of a pipe, and this process the write end. When this process ends, in whatever way, the pipe
is closed, and so the hub ends. If this process forks a child without exec, the child inherits the write end and keeps
the hub alive. So use the "spawn" start method of multiprocessing.

Why not PR_SET_PDEATHSIG, by which Linux sends a signal to a process when its parent dies: the signal already comes when
the thread that started the hub ends, and some calls of exec cancel it.
"""

import signal
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self

from heronry_tools.runtime.softbus.address import HubError

_STOP_TIMEOUT_S = 5.0


class HubProcess:
    """The process of one hub; used as a context manager, it is closed when the `with` block ends."""

    def __init__(self, path: Path, bitrate: int) -> None:
        self.path = path
        self.bitrate = bitrate
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "heronry_tools",
                "softbus",
                str(path.absolute()),  # with a slash, else it would be a name
                f"--bitrate={bitrate}",
                "--until-eof",
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            process_group=0,  # a Ctrl-C in the terminal is for the starter, which then closes the hub in order
        )

    def wait_until_up(self) -> None:
        """Return when clients can connect; to be called once.

        Raises HubError with the reason when the hub cannot run.
        """
        assert self._process.stdout is not None
        if not self._process.stdout.readline():
            _, reason = self._process.communicate()
            last = reason.strip().rpartition("\n")[2].removeprefix("heronry: ")
            raise HubError(last or "the bus ended without a message")

    @property
    def pid(self) -> int:
        """Return the process number of the hub."""
        return self._process.pid

    def kill(self) -> None:
        """Kill the hub, as a crash would: its socket stays behind."""
        self._process.kill()
        self._process.communicate()

    def close(self) -> None:
        """Stop the hub, and wait until it has ended and removed its socket.

        Raises HubError if the hub has failed (with the hub's message), or did not stop in time and was killed.
        """
        self._process.send_signal(signal.SIGCONT)
        self._process.terminate()
        try:
            _, complaint = self._process.communicate(timeout=_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.kill()
            raise HubError(f"the bus at {self.path} did not stop in time and was killed; it has ended now") from None
        if self._process.returncode > 0:
            raise HubError(f"the bus at {self.path} failed: {complaint.strip()}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def start_hub(path: str | Path, bitrate: int = 1_000_000) -> HubProcess:
    """Start a hub of `bitrate` (bit/s) at `path` and return when clients can connect.

    Raises HubError with the reason when the hub cannot run, for example when another hub has that path.
    """
    hub = HubProcess(Path(path), bitrate)
    hub.wait_until_up()
    return hub
