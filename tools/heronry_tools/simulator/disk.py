"""A manager's journal in the simulator: the bytes that the real one would write, and what a kill leaves of them.

Terms and blocks of numbers are on the disk at once. The rest is, once the manager has had time to see to it; until
then a power cut may leave any part of it (`torn`).
"""

from random import Random

from heronry_dg.model import Spec
from heronry_manager.journal import recovered, whole_journal, written
from heronry_manager.memory import NOTHING, Memory, Record, as_json, is_number


class Disk:
    """The journal of one manager of a spec, over all its restarts."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._data = whole_journal(spec, NOTHING)
        self._synced = len(self._data)
        self._next_number = 1

    def opened(self) -> Memory:
        """Read it, as a manager that starts does, and make it short."""
        memory, _ = recovered(self._data)
        self._data = whole_journal(self._spec, memory)
        self._synced, self._next_number = len(self._data), 1 + len(memory.records())
        return memory

    def write(self, record: Record) -> None:
        """Append a record."""
        self._data += written(self._next_number, as_json(record))
        self._next_number += 1
        if is_number(record):
            self._synced = len(self._data)

    def read(self) -> Memory:
        """What a manager would remember that started now."""
        return recovered(self._data)[0]

    def torn(self, random: Random) -> None:
        """The power goes: what was not synced is there up to some byte."""
        self._data = self._data[: random.randint(self._synced, len(self._data))]
