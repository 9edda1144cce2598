"""The active manager's regular frames: LEASE and ALIVE in every heartbeat period, PINGs, a CANopen heartbeat.

LEASE repeats the epoch and its step, so that a PE that missed ACTIVATE catches up. ALIVE names the available PEs, and a
PE that ALIVE does not name drives nothing exclusive (protocol rules 4 and 6). When a PE is no longer available, the
manager immediately sends an ALIVE that does not name this PE, and counts T_lease for this PE from that ALIVE on.

A *beat* is all frames of one heartbeat period. The manager does not make up for a late beat: two beats in a row would
carry nothing new.
"""

from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, heartbeat_id, management_id
from heronry_wire.management import Alive, Lease, Ping
from heronry_wire.nmt import NmtState, encode_heartbeat
from heronry_wire.protocol_times import CANOPEN_HEARTBEAT_NS
from heronry_wire.sansio import Send


class Beacon:
    """Builds the manager's regular frames, and numbers the ALIVEs."""

    def __init__(self, node: int, period_ns: int, first_ns: int) -> None:
        """Set the first beat to be due at `first_ns`, and then one beat in each `period_ns` (nanoseconds)."""
        self.next_ns = first_ns
        self._node, self._period_ns = node, period_ns
        self._canopen_ns = first_ns
        self._sequence = 0

    def beat(self, now_ns: int, lease: Lease, alive: frozenset[int], suspects: frozenset[int]) -> list[Send]:
        """Return the frames of one beat, and set the time at which the next beat is due (`next_ns`).

        The frames are `lease`, an ALIVE that names the nodes `alive`, and a PING to each of the nodes `suspects`.
        The manager's CANopen heartbeat follows if it is due.
        """
        pings = [self.ping(lease.term, node) for node in sorted(suspects)]  # with the number of this ALIVE
        frames = [self._send(Command.LEASE, lease.encode()), self.alive(lease.term, alive), *pings]
        if now_ns >= self._canopen_ns:
            frames.append(Send(0, Frame(heartbeat_id(self._node), encode_heartbeat(NmtState.OPERATIONAL))))
            self._canopen_ns = now_ns + CANOPEN_HEARTBEAT_NS
        self.next_ns += ((now_ns - self.next_ns) // self._period_ns + 1) * self._period_ns
        return frames

    def alive(self, term: int, nodes: frozenset[int]) -> Send:
        """Return an ALIVE frame that names these nodes, and no others, as available."""
        sequence, self._sequence = self._sequence, (self._sequence + 1) % 256
        return self._send(Command.ALIVE, Alive(term, sequence, nodes).encode())

    def ping(self, term: int, node: int) -> Send:
        """Return a PING frame, which asks the PE with this node-ID for its state."""
        return self._send(Command.PING, Ping(term, node, self._sequence).encode())

    def _send(self, command: Command, data: bytes) -> Send:
        return Send(0, Frame(management_id(self._node, command), data))
