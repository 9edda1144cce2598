"""The CANopen face of a PE: boot-up, heartbeat, and what it does with NMT commands (CiA 301, 7.2.8).

    INITIALISING      at the start, and after a reset by NMT: one boot-up frame, and on
    PRE_OPERATIONAL   it runs nothing
    OPERATIONAL       a manager has configured it, or NMT said start
    STOPPED           NMT said stop: its SDO server is silent, everything else goes on

Who commands. An aircraft must not lose its elevator to two bytes that any node can send. What a PE runs is the
manager's to say, by its own protocol; NMT never starts, stops or holds a module, and while a PE is configured, or
hears a LEASE, it refuses every NMT command (they are counted). NMT works as in the book on a PE that runs nothing and
hears no manager: on a desk. There a stop costs no more than SDO, and ends as soon as a manager speaks.

Reset node and reset communication are one here, since nothing runs that could be reset: the heartbeat time goes back to
its value at power-on, the error history and any SDO transfer are forgotten, and boot-up is said again, at most once in
SHORTEST_HEARTBEAT_MS. The incarnation stays: nothing was lost that a manager counts on.

Lost commands are the master's to repeat; it sees in the heartbeat what came of them. Doubled ones change nothing but a
second boot-up. Forged ones do what true ones do.

The heartbeat goes out on every port in the time of object 1017h. It is for CANopen tools: what the manager goes by are
the state frames (`reporting`), which nothing here delays or stops.
"""

from collections.abc import Iterable
from enum import Enum, auto

from heronry_wire.canopen_objects import HEARTBEAT_MS, SHORTEST_HEARTBEAT_MS
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id
from heronry_wire.nmt import (
    ENTER_PRE_OPERATIONAL,
    EVERYBODY,
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


class Heeded(Enum):
    """What became of an NMT command."""

    MALFORMED = auto()
    NOT_MINE = auto()
    REFUSED = auto()
    ACCEPTED = auto()
    RESET = auto()  # obeyed, and what CANopen has set here is to be forgotten


_COMMANDED = {
    START: NmtState.OPERATIONAL,
    STOP: NmtState.STOPPED,
    ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
}


class NetworkManagement:
    """NMT slave and heartbeat producer of one PE; `next_ns` is when to call `tick`."""

    def __init__(self, node: int, ports: Iterable[int], now_ns: int) -> None:
        """Boot-up is due now."""
        self._node, self._ports = node, tuple(ports)
        self._heartbeat_id = heartbeat_id(node)
        self._commanded = NmtState.PRE_OPERATIONAL
        self._booted_ns = now_ns
        self.booted = False
        self.heartbeat_ms = HEARTBEAT_MS
        self.next_ns = now_ns

    def state(self, *, configured: bool, led: bool) -> NmtState:
        """State now, where a manager may have spoken: what NMT said before that counts no more."""
        if configured or led:
            self._commanded = NmtState.PRE_OPERATIONAL
        return NmtState.OPERATIONAL if configured else self._commanded

    def command(self, data: bytes, now_ns: int, *, configured: bool, led: bool) -> Heeded:
        """Take an NMT command."""
        command = decode_command(data)
        if command is None or command.code not in (*_COMMANDED, *_RESETS):
            return Heeded.MALFORMED
        if command.node not in (EVERYBODY, self._node):
            return Heeded.NOT_MINE
        if configured or led:
            return Heeded.REFUSED
        if command.code in _COMMANDED:
            self._commanded = _COMMANDED[command.code]
            return Heeded.ACCEPTED
        self._commanded, self.heartbeat_ms = NmtState.PRE_OPERATIONAL, HEARTBEAT_MS
        if self.booted:
            self.booted = False
            self.next_ns = max(now_ns, self._booted_ns + SHORTEST_HEARTBEAT_MS * _NS_PER_MS)
        return Heeded.RESET

    def admits_heartbeat(self, time_ms: int) -> bool:
        """Tell whether a heartbeat may be sent so often; 0 is never."""
        return time_ms == 0 or SHORTEST_HEARTBEAT_MS <= time_ms <= 0xFFFF

    def set_heartbeat(self, time_ms: int, now_ns: int) -> None:
        """Send a heartbeat so often from now on, the first one a whole period from now."""
        self.heartbeat_ms = time_ms
        if self.booted:
            self.next_ns = now_ns + time_ms * _NS_PER_MS if time_ms else NEVER_NS

    def tick(self, now_ns: int, *, configured: bool, led: bool) -> list[Send]:
        """Send the heartbeat if it is due; the first one is the boot-up."""
        if now_ns < self.next_ns:
            return []
        state = self.state(configured=configured, led=led) if self.booted else NmtState.INITIALISING
        if not self.booted:
            self.booted, self._booted_ns = True, now_ns
        period_ns = self.heartbeat_ms * _NS_PER_MS
        self.next_ns = now_ns - (now_ns - self.next_ns) % period_ns + period_ns if period_ns else NEVER_NS
        return [Send(port, Frame(self._heartbeat_id, encode_heartbeat(state))) for port in self._ports]
