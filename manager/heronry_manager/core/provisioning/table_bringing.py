"""Brings each PE that waits without a table its table, by SDO block transfer into object 2020h (protocol rule 5).

    flies     the PE sends state frames: it has a table, and is left alone, whatever table it is
    waits     the PE sends CANopen heartbeats that say INITIALISING or PRE-OPERATIONAL, is not available, and has sent
              no state frame for QUIET_NS. So a PE that has failed and restarts has certainly lost what it ran
    brought   its table is on its way; one PE at a time
    paused    the PE did not take the table, or another SDO client made a request to it during its transfer. After a
              failure the pause doubles from SHORTEST_PAUSE_NS to LONGEST_PAUSE_NS; after a success it is forgotten
    forgotten no heartbeat has come for FORGOTTEN_NS

With a key each transfer begins with an UNLOCK for the PE, and the table is sealed. The PE may not accept this manager's
commands yet when the UNLOCK comes; then it answers that it takes no table, and the transfer begins anew after a pause.

*Pace.* The segments of a transfer use a tenth of the bus, as the answers of a PE that flies do (`canopen_node`). The
worst case of a data frame counts one frame of lower priority, and SDO has a higher priority than some of the data: a
spec whose wired buses are planned up to their last tenth should declare that traffic (`foreign`).

Only PEs on the manager's own bus are brought a table, since no gateway forwards SDO.
"""

from collections.abc import Callable

from heronry_manager import events
from heronry_manager.core.mastership import Claim
from heronry_manager.core.membership import Health
from heronry_manager.core.provisioning.block_download import BlockDownload, Outcome
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.turn import Turn
from heronry_wire.canopen_objects import TABLE
from heronry_wire.compressed_table import compressed
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, heartbeat_id, sdo_request_id, sdo_response_id
from heronry_wire.management import Control, Operation
from heronry_wire.nmt import NmtState, encode_heartbeat
from heronry_wire.sansio import NEVER_NS, Send
from heronry_wire.sdo import MESSAGE_BYTES
from heronry_wire.timing import worst_bits

QUIET_NS = 1_000_000_000
SHORTEST_PAUSE_NS, LONGEST_PAUSE_NS = 1_000_000_000, 64_000_000_000
_FOR_ANOTHER_NS = 2_000_000_000  # the PE drops the transfer of a silent client after one second
FORGOTTEN_NS = 3_000_000_000
_SHARE = 10  # of the bus: a tenth
_UNLOCK_S = 5  # a transfer that has begun may end after that time
_AFTER_UNLOCK_NS = 20_000_000  # the TAG of the UNLOCK is on the bus, and the PE has checked it
_NS_PER_S = 1_000_000_000
_WAITING = (encode_heartbeat(NmtState.INITIALISING), encode_heartbeat(NmtState.PRE_OPERATIONAL))
_UNTOLD_LOCKS = 3  # with a key: how often a PE may not accept the UNLOCK before this is told


class TableBringing:
    """Knows which PEs wait for a table, and brings it; `next_ns` is the time in ns at which to call `tick`."""

    def __init__(self, settings: ManagerSettings, turn: Turn, claim: Claim, health: Health) -> None:
        """Begin without a transfer; without `settings.tables` no table is ever brought."""
        self._turn, self._claim, self._health, self._key = turn, claim, health, settings.key
        self._text_of = settings.tables
        spec, bus = settings.spec, settings.bus
        here = [] if self._text_of is None else [pe for pe in spec.pes.values() if bus.name in pe.buses]
        self._node = {pe.name: pe.node_id for pe in here}
        self._pe_of_heartbeat = {heartbeat_id(pe.node_id): pe.name for pe in here}
        self._pe_of_answer = {sdo_response_id(pe.node_id): pe.name for pe in here}
        self._pe_of_request = {sdo_request_id(pe.node_id): pe.name for pe in here}
        self._segment_ns = _SHARE * worst_bits(MESSAGE_BYTES) * _NS_PER_S // bus.bitrate
        self._now: tuple[str, BlockDownload] | None = None
        self._began_ns = 0  # when the present transfer began
        self._begins_ns = NEVER_NS  # with a key: when the transfer follows its UNLOCK
        self._heard_ns: dict[str, int] = {}  # by PE that waits: its last heartbeat
        self._not_before_ns: dict[str, int] = {}
        self._failures: dict[str, int] = {}
        self._told: dict[str, str] = {}

    def hears(self, identifier: int) -> bool:
        """Tell whether frames with this identifier are used here."""
        return (
            identifier in self._pe_of_heartbeat or identifier in self._pe_of_answer or identifier in self._pe_of_request
        )

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`; NEVER_NS: nothing waits."""
        if self._now is not None:
            return min(self._now[1].next_ns, self._begins_ns)
        return min((self._not_before_ns.get(pe, 0) for pe in self._heard_ns), default=NEVER_NS)

    def take(self, frame: Frame) -> None:
        """Process a heartbeat or an SDO answer of a PE, or the request of another SDO client to it."""
        pe = self._pe_of_heartbeat.get(frame.can_id)
        if pe is not None:
            self._heartbeat(pe, frame.data)
            return
        if self._now is None:
            return
        pe, transfer = self._now
        if self._pe_of_answer.get(frame.can_id) == pe and self._begins_ns == NEVER_NS:
            transfer.heard(frame.data, self._turn.now_ns)
            self._look(pe, transfer)
        elif self._pe_of_request.get(frame.can_id) == pe:
            self._leave(pe, _FOR_ANOTHER_NS)

    def tick(self) -> None:
        """Send what is due, and begin the next transfer."""
        now_ns = self._turn.now_ns
        if self._now is None:
            self._begin_next()
            return
        pe, transfer = self._now
        if now_ns >= self._begins_ns:
            self._begins_ns = NEVER_NS
            transfer.begin(now_ns)
        else:
            transfer.tick(now_ns)
            self._look(pe, transfer)

    def end_of_step(self) -> None:
        """Forget every transfer if this manager is not active any more; to be called after each event."""
        if not self._claim.is_active and (self._now is not None or self._heard_ns):
            self._now, self._begins_ns = None, NEVER_NS
            self._heard_ns.clear()

    def _heartbeat(self, pe: str, data: bytes) -> None:
        if data not in _WAITING or self._flies(pe):
            self._heard_ns.pop(pe, None)
        elif self._claim.is_active and not self._turn.silent and (self._now is None or self._now[0] != pe):
            self._heard_ns[pe] = self._turn.now_ns
            self._begin_next()

    def _flies(self, pe: str) -> bool:
        return self._health.is_available(pe) or self._turn.now_ns - self._health.spoke_last_ns(pe) < QUIET_NS

    def _begin_next(self) -> None:
        """Begin the transfer to the PE that has waited longest, if none is under way and its pause is over."""
        now_ns = self._turn.now_ns
        for pe, heard_ns in list(self._heard_ns.items()):
            if now_ns - heard_ns >= FORGOTTEN_NS or self._flies(pe):
                del self._heard_ns[pe]
        ready = [pe for pe in self._heard_ns if self._not_before_ns.get(pe, 0) <= now_ns]
        if self._now is None and ready:
            self._begin(ready[0])

    def _begin(self, pe: str) -> None:
        assert self._text_of is not None
        now_ns, node, content = self._turn.now_ns, self._node[pe], compressed(self._text_of(pe))
        del self._heard_ns[pe]
        if self._key is not None:
            content = self._key.sealed(content)
        transfer = BlockDownload(TABLE, content, self._segment_ns, self._sayer(node))
        self._now, self._began_ns = (pe, transfer), now_ns
        if self._key is None:
            transfer.begin(now_ns)
        else:
            self._turn.send(Command.CONTROL, Control(self._turn.term, node, Operation.UNLOCK, _UNLOCK_S))
            self._begins_ns = now_ns + _AFTER_UNLOCK_NS

    def _sayer(self, node: int) -> Callable[[bytes], None]:
        return lambda message: self._turn.do(Send(0, Frame(sdo_request_id(node), message)))

    def _look(self, pe: str, transfer: BlockDownload) -> None:
        """Draw the consequences if a transfer is over."""
        if transfer.outcome is Outcome.UNDER_WAY:
            return
        if transfer.outcome is Outcome.TAKEN:
            self._failures.pop(pe, None)
            self._told.pop(pe, None)
            took_ns = self._turn.now_ns - self._began_ns
            self._turn.emit(events.TableBrought, pe=pe, bytes=len(transfer.content), took_ns=took_ns)
            self._leave(pe, SHORTEST_PAUSE_NS)
            return
        failures = self._failures[pe] = self._failures.get(pe, 0) + 1
        is_usual = self._key is not None and transfer.outcome is Outcome.LOCKED and failures <= _UNTOLD_LOCKS
        if self._told.get(pe) != transfer.why and not is_usual:
            self._told[pe] = transfer.why
            self._turn.emit(events.TableNotTaken, pe=pe, why=transfer.why)
        self._leave(pe, min(SHORTEST_PAUSE_NS << min(failures - 1, 16), LONGEST_PAUSE_NS))

    def _leave(self, pe: str, pause_ns: int) -> None:
        """End the transfer to a PE, which is not begun again for `pause_ns`; then serve the next PE that waits."""
        self._now, self._begins_ns = None, NEVER_NS
        self._not_before_ns[pe] = self._turn.now_ns + pause_ns
        self._begin_next()
