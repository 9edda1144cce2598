"""Brings each PE that waits without a table its table, by SDO block transfer into object 2020h (protocol rule 5).

    flies     the PE sends state frames: it has a table, and is left alone
    differs   the PE sends state frames, runs nothing, and refuses a slice for its digest: it has another table. It is
              brought its own, from READ_NS later on, if its agent was started so that it takes one
    waits     the PE sends CANopen heartbeats that say INITIALISING or PRE-OPERATIONAL, is not available, and has sent
              no state frame for QUIET_NS, nor for two of its heartbeat periods, in which this manager was active. So a
              PE that has failed and restarts has certainly lost what it ran
    brought   its table is on its way; one PE at a time. A PE that flies meanwhile ends this
    waits on  code is on its way to a PE, or something is being read from this one (`one_served`)
    paused    the last transfer is over, or another SDO client has made a request to the PE. After each transfer the
              pause doubles, from SHORTEST_PAUSE_NS to LONGEST_PAUSE_NS, whether the PE has taken the table or not. Only
              a PE that is available ends this count: so a PE that takes its table and cannot fly with it is told of,
              and is brought it less and less often
    forgotten no heartbeat has come for FORGOTTEN_NS, or this manager is not active any more: nothing is told of it

With a key a transfer has three steps. UNLOCK goes to the PE; its *challenge* is read (object 2024h), a number that is
another one at each start of the PE; the table is sealed with the key and the challenge, and written. So a recorded
table is of no use after a restart. The PE may not accept this manager's commands yet when the UNLOCK comes; then it
answers that it takes no table, and the transfer begins anew after a pause. A forged challenge makes a seal that the PE
refuses.

*Pace.* The segments use a tenth of the bus, or so much less that nothing that runs misses its deadline (`pace`). If no
pace is slow enough, the PE waits, and this is told. While another configuration is on its way, no segment is sent. A PE
drops its client after a second without a segment; then the transfer fails, and begins anew.

A PE beyond gateways is brought its table, too: they forward SDO between the manager and it.
"""

from collections.abc import Callable

from heronry_manager import events
from heronry_manager.core.epochs import Deployment
from heronry_manager.core.mastership import Claim
from heronry_manager.core.membership import Health
from heronry_manager.core.provisioning.pace import Pace
from heronry_manager.core.sdo_client import BlockDownload, ObjectReader, OneServed, Outcome
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.situation import KnownSituation
from heronry_manager.core.turn import Turn
from heronry_wire.canopen_objects import CHALLENGE, TABLE
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, heartbeat_id, sdo_request_id, sdo_response_id
from heronry_wire.management import Control, Operation
from heronry_wire.nmt import NmtState, encode_heartbeat
from heronry_wire.sansio import NEVER_NS, Send
from heronry_wire.sdo import read_number

QUIET_NS = 1_000_000_000
SHORTEST_PAUSE_NS, LONGEST_PAUSE_NS = 1_000_000_000, 64_000_000_000
FOR_ANOTHER_NS = 2_000_000_000  # the PE drops the transfer of a silent client after one second
FORGOTTEN_NS = 3_000_000_000
READ_NS = 2_000_000_000  # `pe_details` has read meanwhile which table it is: a PE has one SDO server
_UNLOCK_S = 5  # a transfer that has begun may end after that time
_AFTER_UNLOCK_NS = 20_000_000  # the TAG of the UNLOCK is on the bus, and the PE has checked it
WAITING = (encode_heartbeat(NmtState.INITIALISING), encode_heartbeat(NmtState.PRE_OPERATIONAL))
_UNTOLD_LOCKS = 3  # with a key: how often a PE may not accept the UNLOCK before this is told
_KEEPS_IT = "it keeps another table: start its agent with --node as well, or write its table anew"
_NO_ROOM = "beside what runs the bus has no room for it"
_IN_VAIN = "it took its table, and waits for one again: its log says why"


class TableBringing:
    """Knows which PEs wait for a table, and brings it; `next_ns` is the time in ns at which to call `tick`."""

    def __init__(
        self,
        settings: ManagerSettings,
        turn: Turn,
        claim: Claim,
        health: Health,
        *,
        deployment: Deployment,
        situation: KnownSituation,
        served: OneServed,
    ) -> None:
        """Begin without a transfer; without `settings.tables` no table is ever brought."""
        self._turn, self._claim, self._health, self._key = turn, claim, health, settings.key
        self._served, self._tables = served, settings.tables or {}
        spec, bus = settings.spec, settings.bus
        self._pace, self._beat_ns = Pace(spec, deployment, situation), bus.heartbeat_ns
        here = [pe for pe in spec.pes.values() if pe.name in self._tables and self._pace.way(pe.name)]
        self._node = {pe.name: pe.node_id for pe in here}
        self._pe_of_heartbeat = {heartbeat_id(pe.node_id): pe.name for pe in here}
        self._pe_of_answer = {sdo_response_id(pe.node_id): pe.name for pe in here}
        self._pe_of_request = {sdo_request_id(pe.node_id): pe.name for pe in here}
        self._active_since_ns = turn.now_ns  # what a PE sent before, this manager may not know
        self._pe: str | None = None  # to which a table is being brought
        self._transfer: BlockDownload | None = None  # None: it has not begun
        self._began_ns = 0  # when the table of `_pe` was first dealt with
        self._unlocked_ns = NEVER_NS  # with a key: when the UNLOCK has certainly come
        self._reader = ObjectReader(turn.do)  # of challenges
        self._heard_ns: dict[str, int] = {}  # by PE that waits: its last heartbeat
        self._spoke_ns: dict[str, int] = {}  # by PE: its last heartbeat, whether it waits or is served
        self._not_before_ns: dict[str, int] = {}
        self._tries: dict[str, int] = {}  # since the PE was last available
        self._taken: set[str] = set()  # PEs that have taken a table, and were not available since
        self._told: dict[str, str] = {}
        self._differs: set[str] = set()

    def hears(self, identifier: int) -> bool:
        """Tell whether frames with this identifier are used here."""
        return (
            identifier in self._pe_of_heartbeat or identifier in self._pe_of_answer or identifier in self._pe_of_request
        )

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`; NEVER_NS: nothing waits."""
        if self._transfer is not None:
            return self._transfer.next_ns
        if self._pe is not None:
            return min(self._unlocked_ns, self._reader.next_ns)
        return min((self._not_before_ns.get(pe, 0) for pe in self._heard_ns), default=NEVER_NS)

    def take(self, frame: Frame) -> None:
        """Process a heartbeat or an SDO answer of a PE, or the request of another SDO client to it."""
        if frame.can_id in self._pe_of_heartbeat:
            self._heartbeat(self._pe_of_heartbeat[frame.can_id], frame.data)
        elif frame.can_id in self._pe_of_request:
            self._leave(self._pe_of_request[frame.can_id], FOR_ANOTHER_NS)
        elif self._pe is not None and self._pe_of_answer.get(frame.can_id) == self._pe:
            self._answered(self._pe, frame.data)

    def tick(self) -> None:
        """Send what is due, and begin the next transfer."""
        now_ns, pe, transfer = self._turn.now_ns, self._pe, self._transfer
        if pe is None:
            self._begin_next()
        elif self._flies(pe):
            if transfer is not None:
                transfer.stop()
            self._leave(pe, SHORTEST_PAUSE_NS)
        elif transfer is not None:
            self._send_segment(pe, transfer)
        elif now_ns >= self._unlocked_ns:
            self._unlocked_ns = NEVER_NS
            self._reader.read(self._node[pe], CHALLENGE, 0, self._challenged, now_ns)
        else:
            self._reader.tick(now_ns)

    def end_of_step(self) -> None:
        """Forget silent PEs, and all if this manager is not active any more; to be called after each event."""
        now_ns = self._turn.now_ns
        if self._claim.is_active:
            for pe in [pe for pe in self._told if now_ns - self._spoke_ns.get(pe, now_ns) >= FORGOTTEN_NS]:
                del self._told[pe]
            return
        self._active_since_ns = now_ns
        if self._pe is not None or self._heard_ns or self._told or self._differs:
            self._end()
            self._heard_ns.clear()
            self._told.clear()
            self._differs.clear()

    def status(self) -> dict[str, str]:
        """Return the PEs that wait for a table, each with whether it is on its way, or why it was not taken."""
        gone_ns = self._turn.now_ns - FORGOTTEN_NS
        paused = [pe for pe in self._told if self._not_before_ns.get(pe, 0) > gone_ns]
        waiting = {pe: self._told.get(pe, "its turn comes") for pe in (*paused, *self._heard_ns)}
        return waiting if self._pe is None else waiting | {self._pe: "its table is on its way"}

    def has_another_table(self, pe: str) -> None:
        """Note that a PE that runs nothing has another table, so that it is brought its own."""
        self._differs.add(pe)
        self._not_before_ns[pe] = max(self._not_before_ns.get(pe, 0), self._turn.now_ns + READ_NS)

    def table_is_right(self, pe: str) -> None:
        """Forget that a PE had another table, since it has restarted, or is not heard any more."""
        self._differs.discard(pe)

    def _heartbeat(self, pe: str, data: bytes) -> None:
        self._spoke_ns[pe] = self._turn.now_ns
        if self._health.is_available(pe):
            self._tries.pop(pe, None)
            self._told.pop(pe, None)
            self._taken.discard(pe)
        if (data not in WAITING and pe not in self._differs) or self._flies(pe):
            self._heard_ns.pop(pe, None)
        elif self._claim.is_active and not self._turn.silent and self._pe != pe:
            self._heard_ns[pe] = self._turn.now_ns
            self._begin_next()

    def _flies(self, pe: str) -> bool:
        quiet_ns = max(QUIET_NS, 2 * self._health.period_ns(pe))
        is_heard = self._turn.now_ns - max(self._health.spoke_last_ns(pe), self._active_since_ns) < quiet_ns
        return self._health.is_available(pe) or (is_heard and pe not in self._differs)

    def _begin_next(self) -> None:
        """Begin the transfer to the PE that has waited longest, if none is under way and its pause is over."""
        now_ns = self._turn.now_ns
        for pe, heard_ns in list(self._heard_ns.items()):
            if now_ns - heard_ns >= FORGOTTEN_NS or self._flies(pe):
                del self._heard_ns[pe]
        ready = [pe for pe in self._heard_ns if self._not_before_ns.get(pe, 0) <= now_ns]
        if self._pe is None and ready:
            if self._served.begin(self._node[ready[0]], now_ns):
                self._begin(ready[0])
            else:
                self._not_before_ns[ready[0]] = now_ns + SHORTEST_PAUSE_NS

    def _begin(self, pe: str) -> None:
        del self._heard_ns[pe]
        self._pe, self._began_ns = pe, self._turn.now_ns
        if pe in self._taken:
            self._tell(pe, _IN_VAIN)
        if self._key is None:
            self._write(pe, self._tables[pe])
        else:
            unlock = Control(self._turn.term, self._node[pe], Operation.UNLOCK, _UNLOCK_S)
            self._turn.send(Command.CONTROL, unlock)
            self._unlocked_ns = self._turn.now_ns + _AFTER_UNLOCK_NS

    def _challenged(self, value: bytes | None) -> None:
        """Seal the table for the challenge that was read, and write it; None: the PE has given none."""
        pe, key = self._pe, self._key
        if pe is None or key is None:  # the transfer was ended, and its reader with it
            return
        challenge = None if value is None else read_number(value)
        if challenge is None:
            self._not_taken(pe, Outcome.FAILED, "it did not answer")
        else:
            self._write(pe, key.sealed(self._tables[pe], challenge))

    def _write(self, pe: str, content: bytes) -> None:
        period_ns = self._pace.period_ns(pe)
        if period_ns is None:
            self._not_taken(pe, Outcome.FAILED, _NO_ROOM)
            return
        self._transfer = BlockDownload(TABLE, content, period_ns, self._sayer(self._node[pe]))
        self._transfer.begin(self._turn.now_ns)

    def _send_segment(self, pe: str, transfer: BlockDownload) -> None:
        """Send the segment that is due, at the pace that what runs now allows."""
        now_ns, period_ns = self._turn.now_ns, self._pace.period_ns(pe)
        if period_ns is None:
            transfer.stop()
            self._not_taken(pe, Outcome.FAILED, _NO_ROOM)
            return
        transfer.segment_ns = period_ns
        if self._pace.is_held():
            transfer.put_off(now_ns + self._beat_ns)
        transfer.tick(now_ns)
        self._look(pe, transfer)

    def _sayer(self, node: int) -> Callable[[bytes], None]:
        return lambda message: self._turn.do(Send(0, Frame(sdo_request_id(node), message)))

    def _answered(self, pe: str, message: bytes) -> None:
        if self._transfer is None:
            self._reader.heard(self._node[pe], message, self._turn.now_ns)
        else:
            self._transfer.heard(message, self._turn.now_ns)
            self._look(pe, self._transfer)

    def _look(self, pe: str, transfer: BlockDownload) -> None:
        """Draw the consequences if a transfer is over."""
        if transfer.outcome is Outcome.UNDER_WAY:
            return
        if transfer.outcome is not Outcome.TAKEN:
            self._not_taken(pe, transfer.outcome, transfer.why)
            return
        self._taken.add(pe)
        took_ns = self._turn.now_ns - self._began_ns
        self._turn.emit(events.TableBrought, pe=pe, bytes=len(transfer.content), took_ns=took_ns)
        self._pause(pe)

    def _not_taken(self, pe: str, outcome: Outcome, why: str) -> None:
        is_locked = outcome is Outcome.LOCKED
        if not (is_locked and self._key is not None and self._tries.get(pe, 0) < _UNTOLD_LOCKS):
            self._tell(pe, _KEEPS_IT if is_locked and pe in self._differs else why)
        self._pause(pe)

    def _tell(self, pe: str, why: str) -> None:
        if self._told.get(pe) != why:
            self._told[pe] = why
            self._turn.emit(events.TableNotTaken, pe=pe, why=why)

    def _pause(self, pe: str) -> None:
        """End the transfer to a PE, with a pause that is twice as long as the one before."""
        before = self._tries.get(pe, 0)
        self._tries[pe] = before + 1
        self._leave(pe, min(SHORTEST_PAUSE_NS << min(before, 16), LONGEST_PAUSE_NS))

    def _leave(self, pe: str, pause_ns: int) -> None:
        """End the transfer to a PE if there is one; none to it begins for `pause_ns`, and the next PE is served."""
        self._not_before_ns[pe] = max(self._not_before_ns.get(pe, 0), self._turn.now_ns + pause_ns)
        if self._pe == pe:
            self._end()
        self._begin_next()

    def _end(self) -> None:
        if self._pe is not None:
            self._served.end(self._turn.now_ns)
        self._pe, self._transfer, self._unlocked_ns = None, None, NEVER_NS
        self._reader.give_up()
