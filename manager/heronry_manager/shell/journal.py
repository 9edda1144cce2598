"""The manager's journal: its memory on disk, complete for a restart even if the process is killed within a write.

    STATE_DIR/manager-NODE.journal      lines of `checked_lines`. Lines are only appended. The whole file is
                                        written anew when it is opened, and when it has grown long

Each line is `[number, kind, fields...]`. Line 0 is the head (format, name and digest of the spec). The other
lines are records of `heronry_manager.core.memory`, numbered in turn. *Every line is written twice*, with an
empty line between the copies. So if a single bit has changed on the disk, even in a line break, one copy of
every record is left. If both copies of a record are damaged:

    facts     are read only up to the damage: a restart has the facts that were known before this record was
              written
    numbers   (terms, blocks of epochs or counters) are read from every undamaged line, also after the damage,
              since numbers only rise

To reserve a block of numbers that must never be used twice, the core gives `Keep(Reserved(kind, last))` before the
first frame that uses a number of the block. The driver carries actions out in order, so the record is fsynced before
any later frame is sent. After a restart `memory.reserved[kind]` is the last number that may have been used.

The parts of the journal reach the disk at different times:

    terms, blocks of numbers   fsynced before `write` returns, hence before any later frame
    facts                      given to the kernel by `write` (a kill of the manager loses nothing), fsynced by
                               a thread that `sync` starts, so that a slow disk delays no frame
    the whole file             a draft is fsynced and replaces the old file; then the folder is fsynced

A disk that is full or read-only does not stop the manager. `problem` says what is wrong, and the manager goes
on with the memory in this process. The journal tries to write the whole file anew at every later record, and in
`sync` every `RETRY_NS`. Until this succeeds, a restart may use a term or a block of numbers a second time.

A full disk or a power cut may leave an empty file. An empty file must not keep a manager from starting, so the
journal then begins anew, and `warning` says so. `warning` also says how many records a damage has cost. If the
path leads to a pipe or a folder, or to a journal of a later version, the manager does not start.

A journal belongs to one spec. If the spec has changed, the manager starts only with `--changed-spec`. Then the numbers
are kept, and the facts are dropped, since they are about another aircraft. Only one manager at a time may write a
journal. A lock file beside the journal ensures that; the kernel releases the lock when the process ends.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import Self

from heronry_dg.model import Spec
from heronry_manager.checked_lines import DAMAGED, checked_line, line_content
from heronry_manager.core.memory import NOTHING, Memory, Record, as_json, from_json, is_number
from heronry_wire.errors import HeronryError
from heronry_wire.ordinary_file import move_ordinary, open_ordinary, read_ordinary

_FORMAT = 1
_LONGEST_BYTES = 64 * 1024
RETRY_NS = 10_000_000_000  # while the disk fails


class JournalError(HeronryError):
    """The journal of a manager cannot be used; the message is one sentence with the remedy."""


def written(number: int, content: list[str | int]) -> bytes:
    """Encode one line of the journal; it is written twice, as two equal copies.

    number: number of the line, from 0.
    content: the head of the journal, or a record.
    """
    line = checked_line([number, *content])
    return line + b"\n" + line


def whole_journal(spec: Spec, memory: Memory) -> bytes:
    """Return the shortest journal that holds this memory."""
    contents = [_head(spec), *map(as_json, memory.records())]
    return b"".join(written(number, content) for number, content in enumerate(contents))


def recovered(data: bytes) -> tuple[Memory, str | None]:
    """Read a journal, which may be damaged; gives the memory, and the digest of the journal's spec.

    The digest is None if the head of the journal is damaged.
    """
    contents = dict(_whole_lines(data))
    first_missing = next(number for number in range(len(contents) + 1) if number not in contents)
    facts, numbers = NOTHING, NOTHING
    for number, content in sorted(contents.items()):
        record = from_json(content)
        if record is not None and is_number(record):
            numbers = numbers.after(record)
        elif record is not None and number < first_missing:
            facts = facts.after(record)
    memory = replace(facts, term=numbers.term, reserved=numbers.reserved)
    match contents.get(0):
        case ["journal", int(), str(), str(digest)]:
            return memory, digest
        case _:
            return memory, None


def lost_facts(data: bytes) -> int:
    """Count the records that are damaged with records behind them, and the facts behind the first of these.

    `recovered` gives none of them. Numbers behind the damage are not counted, since `recovered` gives them.
    """
    contents = dict(_whole_lines(data))
    missing = [number for number in range(max(contents, default=-1) + 1) if number not in contents]
    records = {
        number: from_json(content) for number, content in contents.items() if number > min(missing, default=number)
    }
    return len(missing) + sum(record is not None and not is_number(record) for record in records.values())


def _head(spec: Spec) -> list[str | int]:
    return ["journal", _FORMAT, spec.name, spec.digest]


def _format_of(data: bytes) -> int:
    """Return the number of the format of a journal; 0: its head cannot be read."""
    for number, content in _whole_lines(data):
        match number, content:
            case 0, ["journal", int(found), *_]:
                return found
            case _:
                pass
    return 0


def _whole_lines(data: bytes) -> Iterator[tuple[int, list[object]]]:
    for line in data.split(b"\n"):
        match line_content(line + b"\n") if line else DAMAGED:
            case [int(number), *content] if number >= 0:
                yield number, content
            case _:
                pass


class Journal:
    """The journal of one manager, open for writing; `memory`: its content, even while the disk fails."""

    def __init__(self, folder: Path, node: int, spec: Spec, *, accept_changed_spec: bool = False) -> None:
        """Open the journal, or begin a new one; raises JournalError if it is locked, unreadable, or of another spec.

        accept_changed_spec: open also a journal of another spec, keep its numbers, and drop its facts; in one of this
            spec drop only that another one flies.
        """
        self.file = folder / f"manager-{node}.journal"
        self.memory = NOTHING
        self.problem: str | None = None
        self.warning: str | None = None  # what was wrong with the file at the start, and does not stop the manager
        self._spec = spec
        self._stream = self._lock = -1
        self._next_number, self._bytes = 0, 0
        self._is_synced = True
        self._syncing: Thread | None = None
        self._sync_error: OSError | None = None
        self._retry_ns = 0
        self._lock_it(folder)
        try:
            self._read(accept_changed_spec=accept_changed_spec)
        except JournalError:
            self.close()
            raise
        self._put_down()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def write(self, record: Record) -> None:
        """Append a record; afterwards `problem` says why the record could not be written, or is None."""
        self.memory = self.memory.after(record)
        if self.problem is not None or self._bytes > _LONGEST_BYTES:
            self._put_down()
            return
        try:
            self._append(written(self._next_number, as_json(record)))
            self._next_number += 1
            self._is_synced = False
            if is_number(record):
                os.fsync(self._stream)
                self._is_synced = True
        except OSError as error:
            self._fail(error)

    def is_of(self, spec: Spec, memory: Memory) -> None:
        """Go on as the journal of another spec, with this memory; the whole file is written anew."""
        self._spec, self.memory = spec, memory
        self._put_down()

    def sync(self, now_ns: int) -> None:
        """Let a thread write the records to the disk (fsync).

        The thread syncs what was written before the thread began. If the thread fails, a later `sync` sets `problem`.
        While `problem` is set, no thread is started. `sync` then tries every `RETRY_NS` to write the whole file anew.
        """
        if self.problem is not None:
            if now_ns >= self._retry_ns:
                self._retry_ns = now_ns + RETRY_NS
                self._put_down()
            return
        if self._syncing is not None and self._syncing.is_alive():
            return
        if self._sync_error is not None:
            self._fail(self._sync_error)
            self._sync_error = None
        elif not self._is_synced:
            self._is_synced = True
            self._syncing = Thread(target=self._sync_in_thread, args=(os.dup(self._stream),), daemon=True)
            self._syncing.start()

    def _sync_in_thread(self, stream: int) -> None:
        try:
            os.fsync(stream)
        except OSError as error:
            self._sync_error = error
        finally:
            os.close(stream)

    def close(self) -> None:
        """Write everything to the disk, close the file, and release its lock."""
        if self._stream >= 0 and self.problem is None:
            with suppress(OSError):
                os.fsync(self._stream)
        for descriptor in (self._stream, self._lock):
            if descriptor >= 0:
                os.close(descriptor)
        self._stream = self._lock = -1

    def _lock_it(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(self.file.with_suffix(".lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except IsADirectoryError as error:
            raise JournalError(f"{error.filename} is a folder; remove it: the manager needs a file there") from error
        except OSError:
            return  # `_put_down` reports what is wrong with the folder
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._lock)
            raise JournalError(
                f"another manager writes {self.file}; stop that one, or name another folder with --state-dir"
            ) from None

    def _read(self, *, accept_changed_spec: bool) -> None:
        try:
            data = read_ordinary(self.file)
        except FileNotFoundError:
            return
        except OSError as error:
            raise JournalError(
                f"{self.file}: {error.strerror}; make it a file that you can read, "
                "or name another folder with --state-dir"
            ) from error
        if not data:
            self.warning = f"{self.file} was empty: earlier terms, orders and latched faults are not known"
            return
        later = _format_of(data)
        if later > _FORMAT:
            raise JournalError(
                f"{self.file} has format {later}, of a later version, and this version reads format {_FORMAT}; "
                "start the later version, or name another folder with --state-dir"
            )
        self.memory, digest = recovered(data)
        if digest is None and self.memory == NOTHING:
            raise JournalError(
                f"{self.file} is no manager's journal; remove the file, and restart the PEs: "
                "manager and PEs then begin at term 1"
            )
        if (lost := lost_facts(data)) > 0:
            self.warning = (
                f"{self.file} is damaged: {lost} of its records cannot be used, so orders and latched faults may be "
                "missing; look at 'heronry status', and give the missing orders again"
            )
        if digest == self._spec.digest:
            if accept_changed_spec:  # although another one is said to fly
                self.memory = replace(self.memory, flies=None)
            return
        if digest is not None and not accept_changed_spec:
            raise JournalError(
                f"spec {self._spec.name} has changed since {self.file} was begun (digest then {digest[:12]}, now "
                f"{self._spec.digest[:12]}); start with the old spec, or accept the new one with --changed-spec"
            )
        self.memory = self.memory.numbers()

    def _put_down(self) -> None:
        """Write the whole journal to a new file, and replace the old file by it."""
        data, draft = whole_journal(self._spec, self.memory), self.file.with_suffix(".new")
        stream = -1
        try:
            stream = open_ordinary(draft)
            _write_all(stream, data)
            os.fsync(stream)
            move_ordinary(draft, self.file)
        except OSError as error:
            if stream >= 0:
                os.close(stream)
            self._fail(error)
            return
        if self._stream >= 0:
            os.close(self._stream)
        self._stream, self._bytes = stream, len(data)
        self._next_number = 1 + len(self.memory.records())
        self.problem, self._is_synced = None, True

    def _append(self, data: bytes) -> None:
        _write_all(self._stream, data)
        self._bytes += len(data)

    def _fail(self, error: OSError) -> None:
        self.problem = f"{self.file}: {error.strerror}; a restart may not know what happens from now on"


def _write_all(stream: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(stream, rest) :]
