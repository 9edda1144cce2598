"""The journal of a sweep: the plans that it has found so far, on disk.

A *sweep* searches for the best plan for each phase and fault set of its *scope* (`planner.sweep`). A run that is killed
loses only the plans that it was searching for. (The journal of a manager is another file.)

This journal is a text file beside the contingency file that is being made; each line has a checksum (`checked_lines`).
The first line names the spec's digest and the scope. Every other line is an answer: phase, elements that are down,
configuration as a row, value, proven or not. Lines are only ever appended. If the run is killed, the last line may be
cut short: the next run drops everything from the first bad line on. A journal of another spec or scope is written anew.

Only one run at a time may write a journal; a lock ensures that, and the kernel releases the lock when the process ends.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from heronry_dg.model import Spec
from heronry_manager.checked_lines import DAMAGED, checked_line, line_content
from heronry_manager.contingency.configuration_code import ConfigurationCode, objective_of, worth_of
from heronry_manager.planner.sweep import FaultSet, Outcome, Phase, Scope
from heronry_wire.errors import HeronryError
from heronry_wire.packing import PackingError

_FORMAT = 1


class JournalError(HeronryError):
    """The journal of a sweep cannot be used; the message says why and what to do."""


class Journal:
    """The journal of one sweep, open for appending; `known`: the answers that earlier runs have found."""

    def __init__(self, file: Path, spec: Spec, scope: Scope) -> None:
        """Open the journal, or begin a new one; raises JournalError while another run writes it."""
        self.file = file
        self.known: dict[tuple[Phase, FaultSet], Outcome] = {}
        self._code = ConfigurationCode(spec)
        head = {"journal": _FORMAT, "spec": spec.digest, "faults": scope.faults}
        self._head = checked_line({**head, "elements": scope.elements, "phases": scope.phases})
        self._stream = os.fdopen(os.open(file, os.O_RDWR | os.O_CREAT, 0o644), "r+b")
        try:
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._stream.close()
            raise JournalError(
                f"{file} is being written by another run; wait for it, or write to another file"
            ) from None
        self._take_up()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):  # `add` has reported it already
            self._stream.close()

    def add(self, phase: Phase, down: FaultSet, outcome: Outcome) -> None:
        """Append an answer: the plan for these faults.

        If the process is killed after this call, the answer is not lost.
        Raises JournalError if the disk is full; the next run can still use the earlier lines.
        """
        row = self._code.encode(outcome.configuration)
        content = [phase, sorted(down), row.hex(), worth_of(outcome.objective), outcome.optimal]
        self._append(checked_line(content))

    def remove(self) -> None:
        """Delete the journal, once its answers are in the contingency file."""
        self.file.unlink()

    def _take_up(self) -> None:
        good = 0
        for number, (line, content) in enumerate(_whole_lines(self._stream.read())):
            if number == 0 and line != self._head:
                break
            if number > 0 and not self._learn(content):
                break
            good += len(line)
        self._stream.seek(good)
        self._stream.truncate()
        if good == 0:
            self._append(self._head)

    def _append(self, line: bytes) -> None:
        try:
            self._stream.write(line)
            self._stream.flush()
        except OSError as error:
            why = f"{self.file} cannot be written: {error.strerror}"
            raise JournalError(f"{why}; make room: the same command then continues from this file") from error

    def _learn(self, content: object) -> bool:
        match content:
            case [str() | None as phase, list(down), str(row), list(worth), bool(optimal)]:
                try:
                    found = Outcome(self._code.decode(bytes.fromhex(row)), objective_of(worth), optimal)
                except (PackingError, ValueError):
                    return False
                self.known[phase, frozenset(down)] = found
                return True
        return False


def _whole_lines(data: bytes) -> Iterator[tuple[bytes, object]]:
    """Yield each line with its content, and stop at the first damaged line."""
    for line in data.splitlines(keepends=True):
        content = line_content(line)
        if content is DAMAGED:
            return
        yield line, content
