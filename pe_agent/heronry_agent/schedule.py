"""When each module is due: one grid per module, exact for ever, and never a burst.

The k-th release of a module is k periods after it was started, computed from k and not from the one before: a rate of
30 Hz has no period of whole nanoseconds, and does not drift for that. Of releases that have passed while the PE was
busy or paused, one is made up and the others are skipped and counted (`overruns`).

A module *overruns* when OVERRUNS_IN_A_ROW of its steps, one after the other, have each taken longer than its period,
from when it was released to its answer: it will never keep up, and all others here wait for it. A pause of the whole
process spoils a step or two and is none.

A PE computes one step at a time. What is due at the same instant runs in the order of the spec, each after the one
before has answered, so that a chain of modules on one PE passes a value on within one instant.
"""

from collections import Counter
from collections.abc import KeysView
from dataclasses import dataclass
from heapq import heapify, heappush, heapreplace

from heronry_wire.sansio import NEVER_NS

OVERRUNS_IN_A_ROW = 10

NS_MHZ = 1_000_000_000_000
"""Nanoseconds in a second times thousandths in a hertz: the period in ns is this over the rate in mHz."""


@dataclass(slots=True)
class _Grid:
    rate_mhz: int
    started_ns: int
    due_ns: int  # the next release
    index: int = 0  # its number
    late_steps: int = 0  # in a row

    def release(self, now_ns: int) -> int:
        """Move on to the first release after now; returns how many were passed over."""
        following = self.index + 1
        index = max(following, (now_ns - self.started_ns) * self.rate_mhz // NS_MHZ)
        while self.started_ns + index * NS_MHZ // self.rate_mhz <= now_ns:
            index += 1
        self.index, self.due_ns = index, self.started_ns + index * NS_MHZ // self.rate_mhz
        return index - following


class Schedule:
    """Releases of the modules of one PE."""

    def __init__(self) -> None:
        self._grids: dict[int, _Grid] = {}
        self._queue: list[tuple[int, int]] = []  # a heap: when each module is due, of equals the first of the spec
        self._busy: tuple[int, int] | None = None  # module and release being computed
        self._begun_ns = 0
        self._releases = 0
        self.overruns: Counter[int] = Counter()

    @property
    def next_ns(self) -> int:
        """When a module is due; NEVER_NS while one computes, since nothing can be released before it answers."""
        return self._queue[0][0] if self._queue and self._busy is None else NEVER_NS

    @property
    def modules(self) -> KeysView[int]:
        """Modules that have releases."""
        return self._grids.keys()

    def start(self, module: int, rate_mhz: int, now_ns: int) -> None:
        """Begin a grid; its first release is now."""
        self._grids[module] = _Grid(rate_mhz, now_ns, due_ns=now_ns)
        heappush(self._queue, (now_ns, module))

    def stop(self, module: int) -> None:
        """End a grid; an answer that is still to come will not be recognised."""
        self._grids.pop(module, None)
        if self._busy is not None and self._busy[0] == module:
            self._busy = None
        self._queue = [due for due in self._queue if due[1] != module]
        heapify(self._queue)

    def due(self, now_ns: int) -> int | None:
        """Take the module to be stepped now, if any: the earliest due, of equals the first of the spec."""
        if now_ns < self.next_ns:
            return None
        module = self._queue[0][1]
        grid = self._grids[module]
        missed = grid.release(now_ns)
        if missed:
            self.overruns[module] += missed
        heapreplace(self._queue, (grid.due_ns, module))
        return module

    def begin(self, module: int, now_ns: int) -> int:
        """A module is being stepped; returns the number of this release, which its answer repeats."""
        self._releases += 1
        self._begun_ns = now_ns
        self._busy = (module, self._releases)
        return self._releases

    def end(self, module: int, release: int, now_ns: int) -> bool:
        """A module has answered; False when it was not asked, or has been stopped since."""
        if self._busy != (module, release):
            return False
        self._busy = None
        grid = self._grids[module]
        is_late = (now_ns - self._begun_ns) * grid.rate_mhz > NS_MHZ
        grid.late_steps = grid.late_steps + 1 if is_late else 0
        return True

    def overruns_now(self, module: int) -> bool:
        """Tell whether a module has taken too long too often."""
        return self._grids[module].late_steps >= OVERRUNS_IN_A_ROW
