"""Whether a node may use its node-ID: it listens before it sends.

It listens for two heartbeat periods. If it hears nothing under its own identifiers, the node-ID is free. Otherwise the
node-ID is taken, and a node without a key does not start. With a key such frames may be forged. Then the node listens
on until the active manager has told whether it knows that other node (`core.twin`), or until the frames end.
"""

import select
import time
from collections.abc import Sequence
from enum import Enum, auto

from heronry_agent.core.authority import Twin, TwinProof
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id, state_id
from heronry_wire.pe_table import PeTable
from heronry_wire.protocol_times import silent_ns, t_lease_ns
from heronry_wire.replicated_link import AnyLink

_NS_PER_S = 1_000_000_000
_LISTEN_PERIODS = 2  # heartbeat periods of a node that runs


class NodeId(Enum):
    """Whether this node may use its node-ID."""

    FREE = auto()
    FORGED = auto()  # it is heard, and no node of the fleet sends it
    UNPROVEN = auto()  # it is heard, and nobody has told yet who sends it
    TAKEN = auto()


class OwnNodeId:
    """Listens for frames with this node's own node-ID; to be used before this node sends."""

    def __init__(
        self, links: Sequence[AnyLink], node: int, key: Key | None, *, listen_ns: int, lost_after_ns: int
    ) -> None:
        """`listen_ns`: how long a node that runs is silent at most; `lost_after_ns`: as of `TwinProof`."""
        self.node = node
        self._links, self._listen_ns = links, listen_ns
        self._own = (state_id(node), heartbeat_id(node))
        self._proof: TwinProof | None = None
        if key is not None:
            self._proof = TwinProof(node, key, lost_after_ns=lost_after_ns, now_ns=time.monotonic_ns())

    @classmethod
    def of(cls, links: Sequence[AnyLink], table: PeTable, key: Key | None) -> "OwnNodeId":
        """Return the check for the node of this table; it counts from now."""
        uplink = table.ports[table.uplink]
        listen_ns = _LISTEN_PERIODS * uplink.heartbeat_ns
        lost_after_ns = max(t_lease_ns(uplink.heartbeat_ns), silent_ns(uplink.heartbeat_ns, uplink.misses) + listen_ns)
        return cls(links, table.node_id, key, listen_ns=listen_ns, lost_after_ns=lost_after_ns)

    def look(self) -> NodeId:
        """Listen for `listen_ns` at most, and tell what is known; without a key nothing is UNPROVEN or FORGED."""
        is_heard, end_ns = False, time.monotonic_ns() + self._listen_ns
        while (left_ns := end_ns - time.monotonic_ns()) > 0:
            select.select([reader for link in self._links for reader in link.readers], [], [], left_ns / _NS_PER_S)
            for frame in self._frames():
                is_heard = is_heard or frame.can_id in self._own
                if is_heard and self._proof is None:
                    return NodeId.TAKEN
                told = Twin.UNKNOWN if self._proof is None else self._proof.take(frame, time.monotonic_ns())
                if is_heard and told is not Twin.UNKNOWN:
                    return NodeId.FORGED if told is Twin.NONE else NodeId.TAKEN
        return NodeId.UNPROVEN if is_heard else NodeId.FREE

    def _frames(self) -> list[Frame]:
        now_ns = time.monotonic_ns()
        found = [frame for link in self._links for _, frame in link.receive(now_ns)]
        return [frame for frame in found if not (frame.extended or frame.remote or frame.error)]
