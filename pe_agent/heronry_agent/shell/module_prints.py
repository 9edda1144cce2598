"""The output that modules print, line by line, each line with the time of day and the name of the module.

The modules of a partition share its standard output, and all partitions of a PE share one log. Without a name a reader
of the log could not tell which module has printed a line. A line is written when its end comes, or when it has become
long. Output that does not pass through Python (of a library in C) is not changed.
"""

from collections.abc import Callable
from io import TextIOBase
from typing import TextIO

from heronry_wire.clock_of_day import time_of_day

_LONGEST_LINE = 4096  # characters


class ModulePrints(TextIOBase):
    """Replaces `sys.stdout` and `sys.stderr`."""

    def __init__(self, under: TextIO, clock: Callable[[], str] = time_of_day) -> None:
        """under: the stream that gets the lines. clock: gives the time of day as a text, for the head of a line."""
        self._under, self._clock = under, clock
        self._begun = ""  # a line whose end has not come
        self._name = ""

    def of(self, name: str) -> None:
        """Set the module that computes from now on; a line that another module has begun ends here."""
        if name != self._name:
            self._end_line()
            self._name = name

    def write(self, text: str, /) -> int:
        """Write the lines that are complete."""
        *lines, self._begun = (self._begun + text).split("\n")
        for line in lines:
            self._under.write(f"{self._clock()} module {self._name}: {line}\n")
        if len(self._begun) > _LONGEST_LINE:
            self._end_line()
        return len(text)

    def flush(self) -> None:
        """Flush the lines that are complete."""
        self._under.flush()

    def writable(self) -> bool:
        """Tell that this stream can be written to."""
        return True

    def fileno(self) -> int:
        """Give the descriptor of the stream below."""
        return self._under.fileno()

    def _end_line(self) -> None:
        if self._begun:
            self.write("\n")
