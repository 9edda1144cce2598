"""Whether and when a module that has failed is restarted, and when it is given up.

    running    the module has not failed, or was restarted after its last failure
    waiting    the module has failed, and waits for its restart. The first restart is immediate. The second comes
               BACK_OFF_NS after its failure, and each further one after twice as long as the one before. `due` gives
               the modules whose time has come
    given up   the module has failed more than `budget` times (the number of restarts that the table allows), each time
               within FORGIVEN_AFTER_NS of the failure before. Its record is dropped: the manager has the report, and
               decides where the module runs. If the module is started here again, its failures are counted from 0

If a partition ends, these modules count as failed:

- the module that was computing, unless it has been stopped since its step began;
- if no module was computing: all modules of the partition.

The other modules of the partition are restarted immediately. A restart of the agent drops all records.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from heronry_wire.protocol_times import FORGIVEN_AFTER_NS
from heronry_wire.sansio import NEVER_NS

BACK_OFF_NS = 100_000_000


@dataclass(frozen=True, slots=True)
class _Record:
    failures: int
    last_ns: int


class Restarts:
    """Counts the failures of the modules of one PE, and schedules their restarts."""

    def __init__(self) -> None:
        self._records: dict[int, _Record] = {}
        self._begin_ns: dict[int, int] = {}
        self.next_ns = NEVER_NS

    @property
    def waiting(self) -> frozenset[int]:
        """Modules that have failed and will be restarted."""
        return frozenset(self._begin_ns)

    def failed(self, module: int, budget: int, now_ns: int) -> int | None:
        """Record a failure; returns the number of failures, including this one; None: the module is given up.

        If the failure before was more than FORGIVEN_AFTER_NS ago, counting starts again at 1.

        budget: the module is restarted after each of its first `budget` failures, and is given up after the next one.
        """
        record = self._records.get(module)
        known = 0 if record is None or now_ns - record.last_ns > FORGIVEN_AFTER_NS else record.failures
        if known >= budget:
            self.forget(module)
            return None
        self._records[module] = _Record(known + 1, now_ns)
        self.begin_at(module, now_ns + (BACK_OFF_NS << known - 1 if known else 0))
        return known + 1

    def begin_at(self, module: int, at_ns: int) -> None:
        """Schedule the restart of a module for the time `at_ns`, without recording a failure."""
        self._begin_ns[module] = at_ns
        self._find_next()

    def renumber(self, modules: Mapping[int, int]) -> None:
        """Give the modules that go on other indices, and forget all others."""
        self._records = {modules[module]: one for module, one in self._records.items() if module in modules}
        self._begin_ns = {modules[module]: at_ns for module, at_ns in self._begin_ns.items() if module in modules}
        self._find_next()

    def forget(self, module: int) -> None:
        """Forget the failures of a module, and cancel its restart if one is scheduled."""
        self._records.pop(module, None)
        self.cancel(module)

    def cancel(self, module: int) -> None:
        """Do not restart a module that waits for its restart."""
        self._begin_ns.pop(module, None)
        self._find_next()

    def due(self, now_ns: int) -> list[int]:
        """Return the modules whose restart is due, and forget these restarts."""
        if now_ns < self.next_ns:
            return []
        found = sorted(module for module, at_ns in self._begin_ns.items() if at_ns <= now_ns)
        for module in found:
            self.cancel(module)
        return found

    def _find_next(self) -> None:
        self.next_ns = min(self._begin_ns.values(), default=NEVER_NS)
