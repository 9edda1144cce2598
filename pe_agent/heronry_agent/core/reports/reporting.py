"""How a PE reports its state to the manager and to other PEs: pages 0 and 1 of the state frames (protocol rule 1).

A PE sends page 0 on every port once in the heartbeat period of that bus. Each node has its own time slot in the period,
so that up to 34 PEs do not send at the same moment. Page 1 follows every tenth page 0. A change is reported immediately
on every port: by page 0 when an activation step is taken, by page 1 when a configuration was staged or refused. Only
the agent's own loop sends these frames, so a PE whose agent hangs falls silent.

Each port numbers its own page 0 frames, so that a gap in the sequence shows a loss on that bus.

Frames that were due during a pause of the process are not sent later.
"""

from collections.abc import Callable
from typing import NamedTuple

from heronry_agent.core.table_index import TableIndex
from heronry_wire.authentication import BEAT_SPAN
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_PE, PE_NODES, state_id
from heronry_wire.protocol_times import STATE_PAGE_1_EVERY
from heronry_wire.sansio import Send
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1, joined_state, split_state

# Gives the tag of a page, from its number (None for a page 1), its content without the digest, and the digest.
Seal = Callable[[int | None, bytes, int], int]


class Facts(NamedTuple):
    """Content of the state frames, except incarnation and sequence; by default, that of a PE that runs nothing."""

    state: PeState = PeState.UNCONFIGURED
    flags: PeFlags = PeFlags(0)
    epoch: int = 0
    digest: int = 0
    staged_epoch: int = 0
    staged_digest: int = 0
    reason: Reason = Reason.NONE
    load: int = 0  # per cent


class Reporting:
    """Makes the state frames of one PE, and decides when they are due."""

    def __init__(self, index: TableIndex, incarnation: int, now_ns: int, seal: Seal | None = None) -> None:
        """Plan the first frames for this node's next time slot.

        seal: returns the tag of a page (protocol rule 11); None without a key.
        """
        self._seal, self._uplink = seal, index.uplink
        self._ports = index.ports
        self._periods_ns = [port.heartbeat_ns for port in index.table.ports]
        self._offsets_ns = [(index.node - FIRST_PE) * period // len(PE_NODES) for period in self._periods_ns]
        self._incarnation = incarnation
        self._state_id = state_id(index.node)
        self._sequences = [0 for _ in self._ports]
        self._beats = [0 for _ in self._ports]
        self._beat_ns = [self._next_beat(port, now_ns) for port in self._ports]
        self.next_ns = min(self._beat_ns)

    def tick(self, now_ns: int, facts: Facts) -> list[Send]:
        """Return the state frames that are due, with the content `facts`."""
        sends = []
        for port in self._ports:
            if now_ns >= self._beat_ns[port]:
                self._beat_ns[port] = self._next_beat(port, now_ns)
                sends.append(self._page_0(port, facts))
                if self._beats[port] % STATE_PAGE_1_EVERY == 0:
                    sends.append(self._page_1(port, facts))
                self._beats[port] += 1
        self.next_ns = min(self._beat_ns)
        return sends

    def immediate(self, facts: Facts, *, page_0: bool, page_1: bool) -> list[Send]:
        """Return state frames with the content `facts` for every port.

        page_0, page_1: whether each port gets this page.
        """
        sends = []
        for port in self._ports:
            if page_0:
                sends.append(self._page_0(port, facts))
            if page_1:
                sends.append(self._page_1(port, facts))
        return sends

    def _next_beat(self, port: int, now_ns: int) -> int:
        """Time in ns of this node's next time slot on a port, after now."""
        period_ns, offset_ns = self._periods_ns[port], self._offsets_ns[port]
        return (now_ns - offset_ns) // period_ns * period_ns + period_ns + offset_ns

    def _page_0(self, port: int, facts: Facts) -> Send:
        beat = self._sequences[port]
        self._sequences[port] = beat + 1
        page = StatePage0(facts.state, facts.flags, self._incarnation, facts.epoch, beat % BEAT_SPAN, facts.digest)
        return self._said(port, beat, page.encode())

    def _page_1(self, port: int, facts: Facts) -> Send:
        page = StatePage1(facts.state, facts.flags, facts.staged_epoch, facts.staged_digest, facts.reason, facts.load)
        return self._said(port, None, page.encode())

    def _said(self, port: int, beat: int | None, data: bytes) -> Send:
        """Make the frame of a page; with a key the digest is replaced by a tag (on the uplink) or by 0 (elsewhere)."""
        if self._seal is not None:
            said, digest = split_state(data)
            data = joined_state(said, self._seal(beat, said, digest) if port == self._uplink else 0)
        return Send(port, Frame(self._state_id, data))
