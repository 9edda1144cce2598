"""The disk with a simulated manager's journal: the bytes that a real manager would write, and effects of power cuts.

Records of terms, and of numbers that are reserved for later use, are on the disk immediately. Other records are safe
on the disk `SYNCED_AFTER_NS` later, when the manager's frames have been sent. If the power is cut earlier (`torn`), any
part of these records may remain, with damaged bytes in it. If only the manager is killed, nothing is lost.

A full or read-only disk (`refuses`) takes only a part of the next line, and nothing after it. From then on, each new
record makes the manager try to write the whole journal anew; so does each start of a manager.
"""

from collections import deque
from random import Random

from heronry_dg.model import Spec
from heronry_manager.core.memory import NOTHING, Memory, Record, as_json, is_number
from heronry_manager.shell.journal import recovered, whole_journal, written

SYNCED_AFTER_NS = 10_000_000
_PROBLEM = "the disk takes nothing; a restart may not know what happens from now on"


class Disk:
    """The disk with the journal of one manager; it stays when the manager restarts."""

    def __init__(self, spec: Spec, data: bytes | None = None) -> None:
        """Begin with an empty journal, or with the bytes `data`."""
        self.refuses = False
        self.problem: str | None = None  # the error reported to the manager; None: no error
        self.data = whole_journal(spec, NOTHING) if data is None else data
        self._spec = spec
        self._memory = NOTHING  # the content that the journal should have
        self._next_number = 1
        self._synced = len(self.data)
        self._unsynced: deque[tuple[int, int]] = deque()  # of each record: time of writing, and end in bytes

    def opened(self) -> Memory:
        """Read and rewrite the journal, as a manager does at its start, and return its content."""
        self._memory, _ = recovered(self.data)
        self._put_down()
        return self._memory

    def write(self, record: Record, now_ns: int) -> None:
        """Append a record to the journal.

        Afterwards `problem` is None, or says why the record is not on the disk.
        """
        self._memory = self._memory.after(record)
        if self.problem is not None:
            self._put_down()
            return
        line = written(self._next_number, as_json(record))
        if self.refuses:
            self.problem = _PROBLEM
            self.data += line[: len(line) // 3]
            return
        self.data += line
        self._next_number += 1
        self._unsynced.append((now_ns, len(self.data)))
        if is_number(record):
            self._sync(now_ns)

    def is_of(self, spec: Spec, memory: Memory) -> None:
        """Go on as the journal of another spec, with this memory; the whole journal is written anew."""
        self._spec, self._memory = spec, memory
        self._put_down()

    def torn(self, random: Random, now_ns: int) -> None:
        """Cut the power: only a random number of the bytes that are not synced remains, the first ones.

        A random piece of these remaining bytes is replaced by random bytes.
        """
        while self._unsynced and self._unsynced[0][0] <= now_ns - SYNCED_AFTER_NS:
            self._sync(self._unsynced[0][0])
        begin, end = self._synced, random.randint(self._synced, len(self.data))
        spoilt = sorted(random.randint(begin, end) for _ in range(2))
        noise = random.randbytes(spoilt[1] - spoilt[0])
        self.data = self.data[: spoilt[0]] + noise + self.data[spoilt[1] : end]
        self._synced = len(self.data)
        self._unsynced.clear()

    def _sync(self, up_to_ns: int) -> None:
        while self._unsynced and self._unsynced[0][0] <= up_to_ns:
            _, self._synced = self._unsynced.popleft()

    def _put_down(self) -> None:
        """Write the whole journal anew, in place of the old one."""
        if self.refuses:
            self.problem = _PROBLEM
            return
        self.problem, self.data = None, whole_journal(self._spec, self._memory)
        self._next_number, self._synced = 1 + len(self._memory.records()), len(self.data)
        self._unsynced.clear()
