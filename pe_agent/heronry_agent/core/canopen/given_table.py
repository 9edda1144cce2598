"""A table that comes over the bus (object 2020h): whether this node can use it, and the last one that it can.

    none     no table was given, or none that can be used. A refused table changes nothing, and the log says why
    given    a whole, checked table for this node-ID has come. Nobody uses it in this core: its driver, which looks at
             `table`, ends the core and starts another one with that table

`PeObjects` hands over only what came complete, and with a key what was sealed for this start of the node.
"""

from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_wire.pe_table import PeTable, TableError
from heronry_wire.sdo import Abort


class GivenTable:
    """Checks each table that is given to one node; `table` is None until one has come that can be used."""

    def __init__(self, turn: Turn, node: int) -> None:
        self._turn, self._node = turn, node
        self.table: PeTable | None = None

    def take(self, text: bytes) -> Abort | None:
        """Keep a table; returns None, or the reason why it is refused."""
        try:
            table = PeTable.from_json(text.decode())
            TableIndex(table)
        except (TableError, UnicodeDecodeError) as error:
            self._turn.note("table", f"a table is refused: {error}")
            return Abort.VALUE
        if table.node_id != self._node:
            self._turn.note("table", f"a table is refused: it is for node {table.node_id}, not for this one")
            return Abort.VALUE
        self._turn.note("table", f"PE {table.name} of {table.spec}")
        self.table = table
        return None
