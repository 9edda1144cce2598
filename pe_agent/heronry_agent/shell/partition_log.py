"""What a partition prints, on its way to the log of its agent: a pipe that the agent reads.

Whatever the processes of a partition write to their standard output and standard error comes here: what Python code
prints, what C libraries and child processes print, and what code writes to the descriptors. The agent gives its own
descriptor to none of them. So the log keeps within its allowance (`log_allowance`), and no line of it controls a
terminal: control characters are written as escapes.

The agent reads the pipe at most once in GATHER_NS, and discards what is beyond the allowance. Code that prints more
than the pipe holds waits for that, and nobody else does. Lines are lost if the reader of the agent's log does not read.
"""

import fcntl
import os
import select
import time
from contextlib import suppress

from heronry_agent.shell.log_allowance import LogAllowance
from heronry_wire.clock_of_day import time_of_day

GATHER_NS = 10_000_000
_PIPE_BYTES = 1024 * 1024  # the most that an unprivileged process may ask for
_LONGEST_LINE = 4096  # bytes; a pipe that is writable takes as many at once
_STANDARD_ERROR = 2
_MODULES = 4  # a partition may print as much as so many modules


class PartitionLog:
    """The agent's end of the pipe to which the processes of one partition print."""

    def __init__(self, name: str) -> None:
        """Make the pipe; raises OSError."""
        self._name = name
        self._reader, self.writer = os.pipe()  # `writer` is for the partition
        os.set_blocking(self._reader, False)
        with suppress(OSError):
            fcntl.fcntl(self._reader, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        self._begun = b""  # a line whose end has not come
        self._allowance = LogAllowance(_MODULES, time.monotonic_ns())
        self.is_open = True
        self.look_ns = 0  # the pipe is not to be read before this time

    def fileno(self) -> int:
        """File descriptor of the pipe, for select."""
        return self._reader

    def handed_over(self) -> None:
        """Close the partition's end in this process."""
        os.close(self.writer)

    def read(self, now_ns: int) -> None:
        """Write to the log what has come, as far as it may go there; without waiting."""
        try:
            came = os.read(self._reader, _PIPE_BYTES)
        except BlockingIOError:
            return
        self.look_ns = now_ns + GATHER_NS
        self.is_open = bool(came)
        given = self._allowance.take(len(came), now_ns)
        self._write(came[:given])
        if given < len(came) and not self._allowance.is_told:
            self._allowance.is_told = True
            self._end_line()
            _log(f"{time_of_day()} partition {self._name}: {self._allowance.sentence}")

    def close(self) -> None:
        """Write what is left to the log, and close the pipe; call this when the partition's process has ended."""
        self.read(time.monotonic_ns())
        self._end_line()
        self.is_open = False
        os.close(self._reader)

    def _write(self, came: bytes) -> None:
        *lines, self._begun = (self._begun + came).split(b"\n")
        for line in lines:
            _log(line.decode(errors="backslashreplace"))
        if len(self._begun) > _LONGEST_LINE:
            self._end_line()

    def _end_line(self) -> None:
        if self._begun:
            self._write(b"\n")


def _log(line: str) -> None:
    """Write a line to the log of the agent; it is lost if that would have to wait."""
    data = _harmless(line).encode(errors="backslashreplace")
    with suppress(OSError):
        for begin in range(0, max(1, len(data)), _LONGEST_LINE - 1):
            if not select.select([], [_STANDARD_ERROR], [], 0)[1]:
                return
            os.write(_STANDARD_ERROR, data[begin : begin + _LONGEST_LINE - 1] + b"\n")


def _harmless(line: str) -> str:
    """Write the control characters of a line as escapes; tabs stay."""
    if line.isprintable():
        return line
    return "".join(c if c.isprintable() or c == "\t" else c.encode("unicode_escape").decode() for c in line)
