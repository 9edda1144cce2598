"""Whether the node that sends with this PE's node-ID is another PE: what the active manager tells, with a key.

A PE that starts, and hears frames under its own identifiers, must not start beside the node that sends them: the two
would destroy each other's frames. But with a key such frames may be forged, to keep the PE from starting. The PE cannot
check them, since it does not know the session of another node. The manager can, and names in ALIVE the nodes that have
proven their states to it:

    ALIVE does not name this PE               the frames are forged, or of a node that the manager does not believe
    ALIVE names this PE, for longer than a    another node has proven itself under this node-ID. (ALIVE also names a PE
    lost PE stays available                   that has just died, and starts again here)
    no ALIVE of a holder of the key comes     not known

An ALIVE counts if its TAG was made with the key. It may be a replay: one that does not name this PE lets it start
beside a true twin, if there is one; one that names it is contradicted by the next true ALIVE, within a period. While no
manager is active, nothing is known, and a PE that waits for one loses nothing, since it runs nothing without a manager.
"""

from enum import Enum, auto

from heronry_wire.authentication import Key
from heronry_wire.command_tags import CommandVerifier, Held
from heronry_wire.frame import Frame
from heronry_wire.identifiers import MANAGER_NODES, Command, management_id
from heronry_wire.management import Alive, decode_command
from heronry_wire.sansio import Received

_ALIVES = {management_id(manager, Command.ALIVE): manager for manager in MANAGER_NODES}
_TAGS = {management_id(manager, Command.TAG): manager for manager in MANAGER_NODES}


class Twin(Enum):
    """Whether another node of the fleet has this PE's node-ID."""

    UNKNOWN = auto()
    NONE = auto()
    PROVEN = auto()


class TwinProof:
    """Learns from the commands of managers whether another node of the fleet has the node-ID of this PE."""

    def __init__(self, node: int, key: Key, *, lost_after_ns: int, now_ns: int) -> None:
        """Begin at `now_ns`.

        lost_after_ns: for how long at most ALIVE names a PE that has died; an ALIVE waits as long for its TAG.
        """
        self._node, self._since_ns = node, now_ns + lost_after_ns
        self._verifier = CommandVerifier(key, lost_after_ns, seek=True)

    def take(self, frame: Frame, now_ns: int) -> Twin:
        """Take a frame that arrived at `now_ns`, and tell what it proves."""
        if frame.can_id in _ALIVES:
            self._verifier.hold(_ALIVES[frame.can_id], Command.ALIVE, Received(0, frame), now_ns)
        elif frame.can_id in _TAGS:
            found = self._verifier.tagged(_TAGS[frame.can_id], frame.data, now_ns)
            if isinstance(found, Held):
                return self._learn(found, now_ns)
        return Twin.UNKNOWN

    def _learn(self, found: Held, now_ns: int) -> Twin:
        alive = decode_command(Command.ALIVE, found.event.frame.data)
        if not isinstance(alive, Alive):
            return Twin.UNKNOWN
        if self._node not in alive.nodes:
            return Twin.NONE
        return Twin.PROVEN if now_ns >= self._since_ns else Twin.UNKNOWN
