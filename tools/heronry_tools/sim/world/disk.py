"""A manager's journal in the simulator: the bytes that the real one would write, and what a power cut leaves of them.

Terms and blocks of numbers are on the disk immediately. The rest is `SYNCED_AFTER_NS` later, when the manager's frames
are out; until then a power cut may leave any part of it (`torn`). If only the manager is killed, nothing is lost.

A disk that is full or read-only (`refuses`) writes a piece of the line that it refuses first, as a full disk may, and
then nothing. Every later record tries to write all that should be there, and so does a manager that starts.
"""

from collections import deque
from random import Random

from heronry_dg.model import Spec
from heronry_manager.core.memory import NOTHING, Memory, Record, as_json, is_number
from heronry_manager.shell.journal import recovered, whole_journal, written

SYNCED_AFTER_NS = 10_000_000
_PROBLEM = "the disk takes nothing; a restart may not know what happens from now on"


class Disk:
    """The journal of one manager of a spec, over all its restarts."""

    def __init__(self, spec: Spec, data: bytes | None = None) -> None:
        """Begin with a journal that is empty, or with these bytes."""
        self.refuses = False
        self.problem: str | None = None  # what the disk reports to the manager; None: nothing
        self.data = whole_journal(spec, NOTHING) if data is None else data
        self._spec = spec
        self._memory = NOTHING  # what should be in the journal
        self._next_number = 1
        self._synced = len(self.data)
        self._unsynced: deque[tuple[int, int]] = deque()  # when records were written, and where they end

    def opened(self) -> Memory:
        """Read the journal, as a manager that starts does, and shorten it."""
        self._memory, _ = recovered(self.data)
        self._put_down()
        return self._memory

    def write(self, record: Record, now_ns: int) -> None:
        """Append a record; `problem` tells afterwards whether it is on the disk."""
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

    def torn(self, random: Random, now_ns: int) -> None:
        """The power fails: what was not synced is there up to some byte, and a part of that is noise."""
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
        """Write the whole journal anew, in the place of what is there."""
        if self.refuses:
            self.problem = _PROBLEM
            return
        self.problem, self.data = None, whole_journal(self._spec, self._memory)
        self._next_number, self._synced = 1 + len(self._memory.records()), len(self.data)
        self._unsynced.clear()
