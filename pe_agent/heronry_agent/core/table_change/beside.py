"""The table beside the one that flies: it comes over the bus while the PE flies, and waits for an epoch of its own.

    none      there is no table beside, or what came cannot be flown: that changes nothing, and the log says why
    coming    a whole table has come (`take`). The driver reads it, without a pause of this PE, and prepares for it
              (PrepareTable): it opens new devices, and looks for the code of new modules
    ready     the driver has answered (TablePrepared). Slices of this table can be staged: the digest of a slice names
              its table, so a slice of the one is never taken for a slice of the other. Until the switch the PE flies on
              as before, except that an identifier which passes to another module is exclusive from now on (`share`)
    switched  a step of an epoch of this table has been taken: the two tables have changed places (`switching`)

A table that comes while another one is beside takes its place; what was staged of that one is forgotten. After a
restart there is no table beside; the driver keeps the one that flies.
"""

from collections.abc import Callable, Mapping

from heronry_agent.core.configuration import ActiveConfiguration, SliceReader, Staging
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import PrepareTable, TablePrepared


class TableBeside:
    """Takes tables for one PE that flies, and keeps the last one that it can fly by."""

    def __init__(
        self,
        turn: Turn,
        index: TableIndex,
        staging: Staging,
        active_configuration: ActiveConfiguration,
    ) -> None:
        """Begin without a table beside."""
        self._turn, self._index, self._staging, self._active = turn, index, staging, active_configuration
        self.changed: Callable[[], None] = _nothing  # called when other sources than before are exclusive
        self._came = 0
        self.slow: frozenset[int] = frozenset()  # modules of the table beside whose devices come to rest slowly

    def take(self, text: bytes) -> None:
        """Have a table read and prepared; whether it can be used is known later."""
        self._came += 1
        self._turn.do(PrepareTable(text, self._came))

    def prepared(self, event: TablePrepared) -> None:
        """Begin to stage slices of a table for which the driver is prepared."""
        if event.table is None or event.problem is not None:
            self._turn.note("table", f"a table is refused: {event.problem}")
            return
        self.put(TableIndex(event.table), event.missing, event.slow_to_rest)
        self._turn.note("table", f"a table of {event.table.spec} is beside the one that flies")

    def put(self, index: TableIndex, missing: Mapping[str, str], slow: frozenset[int]) -> None:
        """Stage slices of this table from now on, too; `missing` and `slow`: as in TablePrepared."""
        self.slow = slow
        self._staging.put_beside(SliceReader(index, missing), self._active.running)
        self._index.share(index)
        self.changed()


def _nothing() -> None:
    """Nothing depends on the exclusive sources yet."""
