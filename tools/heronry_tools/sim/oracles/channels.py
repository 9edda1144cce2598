"""A replicated bus acts as one bus: each node takes each frame once, and reports only a channel that it has lost.

A frame that a node sends goes out on both channels, as two copies. The frame with its two copies is one *transmission*.
This oracle recognizes the copies of a transmission by the Python object that was sent (`replicated_port`), not by their
bytes. It verifies:

    copies     No node takes more copies of a transmission than the better of the two channels has delivered. Each node
               takes a transmission that both channels have delivered. (A node may take two equal transmissions
               within half a heartbeat period for copies of one transmission.)
    channels   A PE that reports a lost channel has received nothing on this channel, or sent nothing on it, for more
               heartbeat periods than a PE may miss on this bus. This gap still lasts, or has ended so lately that the
               PE may still report it.
"""

from collections import deque
from dataclasses import dataclass, field

from heronry_dg.model import Bus, Spec
from heronry_tools.sim.oracles.limits import CHANNEL_REPORT_NS
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.first_copies import REMEMBERED_NS
from heronry_tools.sim.world.replicated_port import Copy
from heronry_wire.frame import Frame, Malformed, format_frame
from heronry_wire.management import ElementKind, Emergency, FaultCode

_KEEPS_UP_PERIODS = 10  # for which a channel must work again until its PE stops reporting it


def _nothing_yet() -> list[int]:
    return [0, 0]


@dataclass(slots=True)
class _Sending:
    frame: Frame
    node: str
    t_ns: int  # of its first copy
    brought: list[int] = field(default_factory=_nothing_yet)  # by each channel
    taken: int = 0


class ChannelCheck(Oracle):
    """Verifies how nodes treat the two copies of each transmission on a replicated bus."""

    def __init__(self, spec: Spec) -> None:
        """Begin without frames; `spec` gives the nodes and the replicated buses."""
        super().__init__()
        self._spec = spec
        self._sendings: dict[tuple[str, int], _Sending] = {}  # by node and identity
        self._order: deque[tuple[int, tuple[str, int]]] = deque()
        self._signs: dict[tuple[str, str, int, str], int] = {}  # time of the last frame, by node, bus, channel, way
        self._gap_ended: dict[tuple[str, str, int], int] = {}

    def copied(self, copy: Copy) -> None:
        """Record a copy that a channel has delivered to a node, and verify how often the node took the transmission.

        The node must not take it more often than the better channel has delivered it. If both channels have
        delivered it, the node must take it at least once.
        """
        while self._order and self._order[0][0] < copy.t_ns - REMEMBERED_NS:
            del self._sendings[self._order.popleft()[1]]
        key = copy.node, id(copy.frame)
        sending = self._sendings.get(key)
        if sending is None:
            sending = self._sendings[key] = _Sending(copy.frame, copy.node, copy.t_ns)
            self._order.append((copy.t_ns, key))
        sending.brought[copy.channel] += 1
        sending.taken += copy.is_taken
        if sending.taken > max(sending.brought):
            equal = self._equal(sending, self._spec.buses[copy.bus].heartbeat_ns // 2)
            if sum(one.taken for one in equal) > max(map(sum, zip(*(one.brought for one in equal), strict=True))):
                self._note(copy, f"took {format_frame(copy.frame)} {sending.taken} times")
        elif not sending.taken and all(sending.brought):
            self._note(copy, f"did not take {format_frame(copy.frame)}, which both channels brought")
        self._sign(copy.t_ns, copy.node, copy.bus, copy.channel, "in")

    def _equal(self, sending: _Sending, within_ns: int) -> list[_Sending]:
        """Return the transmissions, itself included, that a node may take for copies: the same frame, close in time."""
        known = (one for one in self._sendings.values() if (one.node, one.frame) == (sending.node, sending.frame))
        return [one for one in known if abs(one.t_ns - sending.t_ns) <= within_ns]

    def carried(self, channel: int, sent: Sent) -> None:
        """Record a frame that a channel, 0 or 1, has carried."""
        self._sign(sent.end_ns, sent.sender, sent.bus, channel, "out")

    def emergency(self, sent: Sent, pe: str, emergency: Emergency | Malformed) -> None:
        """Verify the EMCY of a PE that reports a lost channel."""
        if isinstance(emergency, Malformed) or emergency.kind is not ElementKind.CHANNEL:
            return
        if emergency.code is not FaultCode.CHANNEL_LOST:
            return
        bus = self._spec.buses[self._spec.pes[pe].buses[emergency.index]]
        if not self._has_lost(pe, bus, emergency.detail - 1, sent.end_ns):
            story = f"{pe} reports channel {bus.name}.{emergency.detail} lost, but that channel works at {pe}"
            self.violations.append(Violation(sent.end_ns, "channels", story))

    def _has_lost(self, pe: str, bus: Bus, channel: int, t_ns: int) -> bool:
        silent_ns = bus.misses * bus.heartbeat_ns
        lately_ns = _KEEPS_UP_PERIODS * bus.heartbeat_ns + CHANNEL_REPORT_NS + silent_ns
        last_ns = min(self._signs.get((pe, bus.name, channel, way), 0) for way in ("in", "out"))
        ended_ns = self._gap_ended.get((pe, bus.name, channel))
        return t_ns - last_ns > silent_ns or (ended_ns is not None and t_ns - ended_ns <= lately_ns)

    def _sign(self, t_ns: int, node: str, bus: str, channel: int, way: str) -> None:
        entry = self._spec.buses[bus]
        last_ns = self._signs.get((node, bus, channel, way), 0)
        if t_ns - last_ns > entry.misses * entry.heartbeat_ns:
            self._gap_ended[node, bus, channel] = t_ns
        self._signs[node, bus, channel, way] = t_ns

    def _note(self, copy: Copy, what: str) -> None:
        self.violations.append(Violation(copy.t_ns, "copies", f"{copy.node} {what} on {copy.bus}"))
