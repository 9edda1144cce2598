"""The data frames of this PE that another PE may have to send in its place, and their withdrawal (protocol rule 6).

Such frames carry the data of a module that may move. This PE publishes them itself, or forwards them for a PE beyond
its gateway. When a frame has shown that this PE may not send them any more (`output_authorization`), those that still
wait for the bus are withdrawn: another PE may send under their identifiers from now on.
"""

from collections.abc import Collection

from heronry_agent.core.forwarding import Gateway
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn


class ExclusiveFrames:
    """Keeps which data this PE sends that another PE may send as well."""

    def __init__(self, turn: Turn, index: TableIndex, gateway: Gateway) -> None:
        """Begin with nothing that is sent."""
        self._turn, self._index, self._gateway = turn, index, gateway
        self._sources: frozenset[int] = frozenset()

    def published(self, sources: Collection[int]) -> None:
        """Note the indices of the sources that this PE publishes from now on."""
        self._sources = self._index.movable.intersection(sources)

    def withdraw(self) -> None:
        """Withdraw the exclusive frames that are not sent yet."""
        self._turn.withdraw(self._index.identifiers(self._sources) | self._gateway.contested_ids)
