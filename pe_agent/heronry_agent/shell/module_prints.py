"""The output that modules print, line by line, each line with the time of day and the name of the module.

The modules of a partition share its standard output, and all partitions of a PE share one log. Without a name a reader
of the log could not tell which module has printed a line. A line is written when the module ends it, or when it is
longer than 4096 characters. Output of C libraries does not pass through Python, and is not changed.

Each module has an allowance (`log_allowance`), so that one that prints much leaves room in the log for the others of
its partition. Lines beyond it are dropped; the log says so once.
"""

import time
from collections.abc import Callable
from io import TextIOBase
from typing import TextIO

from heronry_agent.shell.log_allowance import LogAllowance
from heronry_wire.clock_of_day import time_of_day

_LONGEST_LINE = 4096  # characters


class ModulePrints(TextIOBase):
    """Stands in for `sys.stdout` and `sys.stderr`, and writes each line with time and module name."""

    def __init__(self, under: TextIO, clock: Callable[[], str] = time_of_day) -> None:
        """Write to the stream `under`; `clock` returns the time of day as the text that begins a line."""
        self._under, self._clock = under, clock
        self._allowances: dict[str, LogAllowance] = {}  # by module
        self._begun = ""  # a line whose end has not come
        self._name = ""

    def of(self, name: str) -> None:
        """Set the name of the module that prints from now on; an unfinished line of another module is ended first."""
        if name != self._name:
            self._end_line()
            self._name = name

    def write(self, text: str, /) -> int:
        """Write the lines that are complete, and keep the unfinished one; returns the number of characters taken."""
        *lines, self._begun = (self._begun + text).split("\n")
        for line in lines:
            self._put(line)
        if len(self._begun) > _LONGEST_LINE:
            self._end_line()
        return len(text)

    def flush(self) -> None:
        """Flush the stream to which lines are written; an unfinished line is still kept."""
        self._under.flush()

    def writable(self) -> bool:
        """Return True, as a stream for output must."""
        return True

    def fileno(self) -> int:
        """Return the file descriptor of the stream `under`, to which the lines are written."""
        return self._under.fileno()

    def _put(self, line: str) -> None:
        now_ns = time.monotonic_ns()
        allowance = self._allowances.setdefault(self._name, LogAllowance(1, now_ns))
        whole = f"{self._clock()} module {self._name}: {line}\n"
        if allowance.take(len(whole), now_ns) == len(whole):
            self._under.write(whole)
        elif not allowance.is_told:
            allowance.is_told = True
            self._under.write(f"{self._clock()} module {self._name}: {allowance.sentence}\n")

    def _end_line(self) -> None:
        if self._begun:
            self.write("\n")
