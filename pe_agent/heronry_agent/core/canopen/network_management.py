"""A PE as an NMT slave of CANopen: its boot-up, its heartbeat, and how it handles NMT commands (CiA 301, 7.2.8).

    INITIALISING      at the start, and after a reset by NMT: one boot-up frame, then PRE_OPERATIONAL
    PRE_OPERATIONAL   the PE runs nothing
    OPERATIONAL       a manager has configured the PE, or NMT commanded start
    STOPPED           NMT commanded stop: the SDO server is silent, everything else goes on

Any node can send an NMT command of two bytes, so no such command may stop an aircraft's elevator. The manager decides
what a PE runs, by the management protocol; NMT never starts, stops or holds a module. While a PE is configured, or
hears a LEASE, it refuses and counts every NMT command. NMT works as CiA 301 defines it only on a PE that runs nothing
and hears no manager, for example on a desk. The command stop then disables only SDO, and only until the PE hears a
manager.

The commands reset node and reset communication have the same effect, since no module runs that could be reset. The
heartbeat time returns to its value at power-on, the error history and any SDO transfer are dropped, and the boot-up
frame is sent again, at most once in SHORTEST_HEARTBEAT_MS. The incarnation stays the same, since a manager uses nothing
that such a reset drops.

If a command is lost, the NMT master sees no effect in the heartbeat, and repeats the command. A doubled command causes
a second boot-up at most. A forged command has the effect of a true one.

The heartbeat is sent on every port with the period of object 1017h. It serves CANopen tools: the manager relies on the
state frames (`reporting`), which nothing in this file delays or stops.
"""

from collections.abc import Iterable
from enum import Enum, auto

from heronry_wire.canopen_objects import HEARTBEAT_MS, SHORTEST_HEARTBEAT_MS
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id
from heronry_wire.nmt import (
    ALL_NODES,
    ENTER_PRE_OPERATIONAL,
    RESET_COMMUNICATION,
    RESET_NODE,
    START,
    STOP,
    NmtState,
    decode_command,
    encode_heartbeat,
)
from heronry_wire.sansio import NEVER_NS, Send

_NS_PER_MS = 1_000_000
_RESETS = (RESET_NODE, RESET_COMMUNICATION)


class NmtOutcome(Enum):
    """What became of an NMT command."""

    MALFORMED = auto()
    NOT_MINE = auto()
    REFUSED = auto()
    ACCEPTED = auto()
    RESET = auto()  # executed: all that CANopen has set on this PE is to return to its value at power-on


_COMMANDED = {
    START: NmtState.OPERATIONAL,
    STOP: NmtState.STOPPED,
    ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
}


class NetworkManagement:
    """NMT slave and heartbeat producer of one PE; `next_ns` is the time at which to call `tick`."""

    def __init__(self, node: int, ports: Iterable[int], now_ns: int) -> None:
        """Start in INITIALISING; the boot-up frame is due now."""
        self._node, self._ports = node, tuple(ports)
        self._heartbeat_id = heartbeat_id(node)
        self._commanded = NmtState.PRE_OPERATIONAL
        self._booted_ns = now_ns
        self.booted = False
        self.heartbeat_ms = HEARTBEAT_MS
        self.next_ns = now_ns

    def state(self, *, configured: bool, managed: bool) -> NmtState:
        """Return the present NMT state.

        configured: a manager has configured this PE. managed: a manager is heard. Either of them cancels an earlier NMT
        command.
        """
        if configured or managed:
            self._commanded = NmtState.PRE_OPERATIONAL
        return NmtState.OPERATIONAL if configured else self._commanded

    def command(self, data: bytes, now_ns: int, *, configured: bool, managed: bool) -> NmtOutcome:
        """Execute or refuse an NMT command, given as its bytes; returns what became of it.

        configured: a manager has configured this PE. managed: a manager is heard. If either holds, the PE refuses.
        """
        command = decode_command(data)
        if command is None or command.code not in (*_COMMANDED, *_RESETS):
            return NmtOutcome.MALFORMED
        if command.node not in (ALL_NODES, self._node):
            return NmtOutcome.NOT_MINE
        if configured or managed:
            return NmtOutcome.REFUSED
        if command.code in _COMMANDED:
            self._commanded = _COMMANDED[command.code]
            return NmtOutcome.ACCEPTED
        self._commanded, self.heartbeat_ms = NmtState.PRE_OPERATIONAL, HEARTBEAT_MS
        if self.booted:
            self.booted = False
            self.next_ns = max(now_ns, self._booted_ns + SHORTEST_HEARTBEAT_MS * _NS_PER_MS)
        return NmtOutcome.RESET

    def admits_heartbeat(self, time_ms: int) -> bool:
        """Tell whether the heartbeat period may be set to `time_ms`; 0 is allowed, and switches the heartbeat off."""
        return time_ms == 0 or SHORTEST_HEARTBEAT_MS <= time_ms <= 0xFFFF

    def set_heartbeat(self, time_ms: int, now_ns: int) -> None:
        """Set the heartbeat period to `time_ms`; the next heartbeat is sent one period from now (0: none is sent)."""
        self.heartbeat_ms = time_ms
        if self.booted:
            self.next_ns = now_ns + time_ms * _NS_PER_MS if time_ms else NEVER_NS

    def tick(self, now_ns: int, *, configured: bool, managed: bool) -> list[Send]:
        """Return the frames that are due, one for each port; an empty list if none are due.

        The first frames after the start and after a reset are boot-up frames; all later ones are heartbeats.

        configured, managed: as for `state`, which gives the NMT state that a heartbeat reports.
        """
        if now_ns < self.next_ns:
            return []
        state = self.state(configured=configured, managed=managed) if self.booted else NmtState.INITIALISING
        if not self.booted:
            self.booted, self._booted_ns = True, now_ns
        period_ns = self.heartbeat_ms * _NS_PER_MS
        self.next_ns = now_ns - (now_ns - self.next_ns) % period_ns + period_ns if period_ns else NEVER_NS
        return [Send(port, Frame(self._heartbeat_id, encode_heartbeat(state))) for port in self._ports]
