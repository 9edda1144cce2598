"""How a PE reports its state to the manager and to other PEs: state frames, both pages (protocol rule 1).

Page 0 goes out on every port once in the heartbeat period of that bus, at this node's own place in the period, so that
34 PEs do not all start at once; page 1 follows every tenth. A change is reported immediately, out of turn, on every
port: page 0 when a step is taken, page 1 when a configuration was staged or refused. Only the agent itself sends these
frames: an agent that hangs falls silent.

Each port counts its own page 0 frames, so that a gap in the sequence is a loss on that bus.

After a pause of the process the beats that were missed are not made up.
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

# Number of a page 0 (None for a page 1), its content without the digest, and the digest: gives the tag.
Seal = Callable[[int | None, bytes, int], int]


class Facts(NamedTuple):
    """Content of the state frames without incarnation and sequence; the defaults are of a PE that runs nothing."""

    state: PeState = PeState.UNCONFIGURED
    flags: PeFlags = PeFlags(0)
    epoch: int = 0
    digest: int = 0
    staged_epoch: int = 0
    staged_digest: int = 0
    reason: Reason = Reason.NONE
    load: int = 0  # per cent


class Reporting:
    """Makes the state frames of one PE."""

    def __init__(self, index: TableIndex, incarnation: int, now_ns: int, seal: Seal | None = None) -> None:
        """The first state frames are due at this node's place in a period; `seal` tags pages (protocol rule 11)."""
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
        """Give the state frames that are due."""
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
        """Give these pages now, on every port: after a change, or on request."""
        sends = []
        for port in self._ports:
            if page_0:
                sends.append(self._page_0(port, facts))
            if page_1:
                sends.append(self._page_1(port, facts))
        return sends

    def _next_beat(self, port: int, now_ns: int) -> int:
        """First instant after now at this node's place in a period."""
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
        """Make the frame of a page; with a key it carries a tag on the uplink, and 0 in its place on other ports."""
        if self._seal is not None:
            said, digest = split_state(data)
            data = joined_state(said, self._seal(beat, said, digest) if port == self._uplink else 0)
        return Send(port, Frame(self._state_id, data))
