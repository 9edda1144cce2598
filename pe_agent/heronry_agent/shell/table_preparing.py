"""Prepares a node for a table that has come beside the one by which its PE flies.

    read      the text is read and checked (`read_beside`) and, where the node keeps its table in a file, written into a
              draft of its own. This happens in a thread of its own, since both may take longer than a heartbeat period
    prepared  in the loop of the agent: the devices of new modules are opened, and their code is looked for; partitions
              begin to load it. If a device cannot be opened, the node cannot fly by the table. Otherwise the draft
              becomes the second file, that of the table beside, and the partitions of the table that was beside end
    kept      when the PE flies by the other table, the two files change names: the file of the node has the table that
              flies, also after a loss of power at any moment

Where two tables come one after the other, the last one that was read is the one beside. One that is beside already, or
flies, changes nothing.
"""

import os
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from queue import Empty, SimpleQueue

from heronry_agent.core.carried_over import read_beside
from heronry_agent.core.vocabulary import PrepareTable, TablePrepared
from heronry_agent.shell.module_numbers import ModuleNumbers
from heronry_wire.errors import HeronryError
from heronry_wire.ordinary_file import replace_ordinary
from heronry_wire.pe_table import ModuleEntry, PeTable, TableError

Opener = Callable[[PeTable, Collection[ModuleEntry]], frozenset[int]]
"""Opens the devices of added modules and prepares their partitions; gives the numbers of those that rest slowly."""

_Read = tuple[PeTable, Path | None]  # and its draft


class TablePreparing:
    """Reads and prepares tables for one node."""

    def __init__(
        self,
        table: PeTable,
        file: Path | None,
        *,
        open_added: Opener,
        keep_only: Callable[[Collection[int]], None],
        why_not_here: Callable[[str], str | None],
        tell: Callable[[str], None],
    ) -> None:
        """Begin with the table that flies, which `file` holds (None: no file does).

        keep_only: ends what runs for modules with other numbers than these. why_not_here: says why an image cannot be
        loaded on this node. tell: called with a sentence about the disk.
        """
        self.numbers = ModuleNumbers(table)
        self._file, self._open_added, self._keep_only = file, open_added, keep_only
        self._why_not_here, self._tell = why_not_here, tell
        self._read: SimpleQueue[_Read | str] = SimpleQueue()

    def begin(self, action: PrepareTable, flying: PeTable) -> None:
        """Begin to read a table; `take` gives the answer, later."""
        threading.Thread(target=self._read_one, args=(action, flying), daemon=True).start()

    def take(self) -> Iterator[TablePrepared]:
        """Prepare for each table that has been read, and yield the answers for the core."""
        while True:
            try:
                found = self._read.get_nowait()
            except Empty:
                return
            if isinstance(found, str):
                yield TablePrepared(None, problem=found)
                continue
            table, draft = found
            if not self.numbers.has(table):  # else it is there already, and slices of it may be staged
                yield self._prepared(table, draft)
            if draft is not None:
                draft.unlink(missing_ok=True)

    def switched(self, table: PeTable) -> None:
        """Note that the PE flies by the table that was beside, and keep it for the next start."""
        self.numbers.switch(table)
        if self._file is None:
            return
        beside, spare = _near(self._file, "beside"), _near(self._file, "before")
        try:
            spare.unlink(missing_ok=True)
            os.link(self._file, spare)
            beside.replace(self._file)
            spare.replace(beside)
        except OSError as error:
            self._tell(f"{self._file} cannot be changed ({error.strerror}): a restart begins with the table before")

    def _read_one(self, action: PrepareTable, flying: PeTable) -> None:
        try:
            table, draft = read_beside(action.text, flying, action.number), None
            if self._file is not None:
                draft = _near(self._file, f"coming-{action.number}")
                replace_ordinary(draft, action.text)
        except TableError as error:
            self._read.put(str(error))
        except OSError as error:
            self._read.put(f"{self._file} has no room beside it ({error.strerror})")
        else:
            self._read.put((table, draft))

    def _prepared(self, table: PeTable, draft: Path | None) -> TablePrepared:
        reasons: Mapping[str, str | None] = {one.image: self._why_not_here(one.image) for one in table.modules}
        missing = {image: reason for image, reason in reasons.items() if reason is not None}
        numbers, added = self.numbers.of(table)
        try:
            slow = self._open_added(table, added)
            if draft is not None and self._file is not None:
                draft.replace(_near(self._file, "beside"))
        except HeronryError as error:
            return TablePrepared(None, problem=str(error))
        except OSError as error:
            return TablePrepared(None, problem=f"{self._file} cannot have it beside it ({error.strerror})")
        self.numbers.put_beside(table, numbers)
        self._keep_only(self.numbers.in_use)
        return TablePrepared(table, missing, self.numbers.indices(slow, beside=True))


def _near(file: Path, what: str) -> Path:
    return file.with_name(f"{file.name}.{what}")
