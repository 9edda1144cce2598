"""Keeps the SDO clients of one manager apart: one node is served at a time, and what is read from it waits.

    free     nothing is brought to any node
    served   a client that brings something has a node from its first request to its last answer (`begin`, `end`)

A node has one SDO server, in which a new request replaces or spoils the transfer before; and the analysis of the bus
(rule 10) holds for one transfer. So a second transfer does not begin, and none begins to a node from which something is
being read. What is read from a served node for people waits until a client of that node would have been dropped.

*Who may change it.* The clients that bring tables and code; each ends what it began, also when its manager ceases to be
active. No frame changes it. A restart frees it.
"""

from heronry_manager.core.sdo_client.object_reader import ObjectReader


class OneServed:
    """Knows which node is being brought something; `reader` reads what is for people."""

    def __init__(self, reader: ObjectReader) -> None:
        """Begin with no node served."""
        self._reader = reader
        self._node: int | None = None

    def serves(self, node: int) -> bool:
        """Tell whether this node is served."""
        return self._node == node

    def begin(self, node: int, now_ns: int) -> bool:
        """Serve a node from now on; False: another one is served, or this one is being read, so nothing may begin."""
        if self._node is not None or self._reader.is_reading(node):
            return False
        self._node = node
        self._reader.leave(node, now_ns)
        return True

    def end(self, now_ns: int) -> None:
        """Serve the node no more."""
        node, self._node = self._node, None
        if node is not None:
            self._reader.heard_other(node, now_ns)
