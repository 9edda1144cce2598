"""Brings each PE that waits without a table its table, by SDO in parts into object 2026h (protocol rule 5).

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

With a key the *challenge* of the PE is read first (object 2024h), a number that is another one at each start of the PE,
and the table is sealed with the key and the challenge. So a recorded table is of no use after a restart. The PE may not
accept this manager's commands yet when the UNLOCK comes; then it answers that it takes no part, and the transfer goes
on after a pause. A forged challenge makes a seal that the PE refuses.

*Interruptions.* What the PE has of its table is not sent again, also not by another manager of the same version and
spec, since the same table, for the same challenge, has the same bytes (`served_pe`). A PE that restarts begins anew.
While a PE waits, a forged part under another digest makes it forget what has come.

A PE beyond gateways is brought its table, too: they forward SDO between the manager and it.
"""

from typing import Any

from heronry_manager import events
from heronry_manager.core.epochs import Deployment
from heronry_manager.core.mastership import Claim
from heronry_manager.core.membership import Health
from heronry_manager.core.provisioning.served_pe import FOR_ANOTHER_NS, SHORTEST_PAUSE_NS, ServedPe
from heronry_manager.core.sdo_client import OneServed, Outcome
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.situation import KnownSituation
from heronry_manager.core.turn import Turn
from heronry_wire.canopen_objects import CHALLENGE, TABLE_TRANSFER
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id
from heronry_wire.nmt import NmtState, encode_heartbeat
from heronry_wire.sansio import NEVER_NS

PART_BYTES = 1024  # a second of a radio's tenth
QUIET_NS = 1_000_000_000
FORGOTTEN_NS = 3_000_000_000
READ_NS = 2_000_000_000  # `pe_details` has read meanwhile which table it is: a PE has one SDO server
WAITING = (encode_heartbeat(NmtState.INITIALISING), encode_heartbeat(NmtState.PRE_OPERATIONAL))
_UNTOLD_LOCKS = 3  # with a key: how often a PE may not accept the UNLOCK before this is told
_KEEPS_IT = "it keeps another table: start its agent with --node as well, or write its table anew"
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
        self._tables = settings.tables or {}
        self._client = ServedPe(
            settings, turn, deployment=deployment, situation=situation, served=served, failed=self._not_taken
        )
        here = self._client.may_serve(pe for pe in settings.spec.pes.values() if pe.name in self._tables)
        self._pe_of_heartbeat = {heartbeat_id(pe.node_id): pe.name for pe in here}
        self._active_since_ns = turn.now_ns  # what a PE sent before, this manager may not know
        self._heard_ns: dict[str, int] = {}  # by PE that waits: its last heartbeat
        self._spoke_ns: dict[str, int] = {}  # by PE: its last heartbeat, whether it waits or is served
        self._taken: set[str] = set()  # PEs that have taken a table, and were not available since
        self._told: dict[str, str] = {}
        self._differs: set[str] = set()

    def hears(self, identifier: int) -> bool:
        """Tell whether frames with this identifier are used here."""
        return identifier in self._pe_of_heartbeat or self._client.hears(identifier)

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`; NEVER_NS: nothing waits."""
        if self._client.pe is not None:
            return self._client.next_ns
        return min((self._client.not_before_ns(pe) for pe in self._heard_ns), default=NEVER_NS)

    def take(self, frame: Frame) -> None:
        """Process a heartbeat or an SDO answer of a PE, or the request of another SDO client to it."""
        another = self._client.asked_by_another(frame)
        if frame.can_id in self._pe_of_heartbeat:
            self._heartbeat(self._pe_of_heartbeat[frame.can_id], frame.data)
        elif another is not None:
            self._leave(another, FOR_ANOTHER_NS)
        else:
            self._client.heard(frame)

    def tick(self) -> None:
        """Send what is due, and begin the next transfer."""
        pe = self._client.pe
        if pe is None:
            self._begin_next()
        elif self._flies(pe):
            self._leave(pe, SHORTEST_PAUSE_NS, abort=True)
        else:
            self._client.tick()

    def end_of_step(self) -> None:
        """Forget silent PEs, and all if this manager is not active any more; to be called after each event."""
        now_ns = self._turn.now_ns
        if self._claim.is_active:
            for pe in [pe for pe in self._told if now_ns - self._spoke_ns.get(pe, now_ns) >= FORGOTTEN_NS]:
                del self._told[pe]
            return
        self._active_since_ns = now_ns
        if self._client.pe is not None or self._heard_ns or self._told or self._differs:
            self._client.end()
            self._heard_ns.clear()
            self._told.clear()
            self._differs.clear()

    def status(self) -> dict[str, str]:
        """Return the PEs that wait for a table, each with whether it is on its way, or why it was not taken."""
        gone_ns = self._turn.now_ns - FORGOTTEN_NS
        paused = [pe for pe in self._told if self._client.not_before_ns(pe) > gone_ns]
        waiting = {pe: self._told.get(pe, "its turn comes") for pe in (*paused, *self._heard_ns)}
        pe = self._client.pe
        return waiting if pe is None else waiting | {pe: f"its table: {self._client.at} of {self._client.of} bytes"}

    def progress(self) -> dict[str, Any] | None:
        """Return the table that is on its way (`ServedPe.progress`)."""
        return self._client.progress()

    def has_another_table(self, pe: str) -> None:
        """Note that a PE that runs nothing has another table, so that it is brought its own."""
        self._differs.add(pe)
        self._client.put_off(pe, READ_NS)

    def table_is_right(self, pe: str) -> None:
        """Forget that a PE had another table, since it has restarted, or is not heard any more."""
        self._differs.discard(pe)

    def _heartbeat(self, pe: str, data: bytes) -> None:
        self._spoke_ns[pe] = self._turn.now_ns
        if self._health.is_available(pe):
            self._client.is_well(pe)
            self._told.pop(pe, None)
            self._taken.discard(pe)
        if (data not in WAITING and pe not in self._differs) or self._flies(pe):
            self._heard_ns.pop(pe, None)
        elif self._claim.is_active and not self._turn.silent and self._client.pe != pe:
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
        ready = [pe for pe in self._heard_ns if self._client.not_before_ns(pe) <= now_ns]
        if self._client.pe is None and ready:
            if self._client.begin(ready[0]):
                self._begin(ready[0])
            else:
                self._client.put_off(ready[0], SHORTEST_PAUSE_NS)

    def _begin(self, pe: str) -> None:
        del self._heard_ns[pe]
        if pe in self._taken:
            self._tell(pe, _IN_VAIN)
        key, table = self._key, self._tables[pe]
        if key is None:
            self._bring(pe, table)
        else:
            self._client.read_number(CHALLENGE, 0, lambda challenge: self._bring(pe, key.sealed(table, challenge)))

    def _bring(self, pe: str, content: bytes) -> None:
        self._client.bring(TABLE_TRANSFER, content, PART_BYTES, lambda: self._brought(pe))

    def _brought(self, pe: str) -> None:
        self._taken.add(pe)
        took_ns = self._turn.now_ns - self._client.began_ns
        self._turn.emit(events.TableBrought, pe=pe, bytes=self._client.of, took_ns=took_ns)
        self._pause(pe)

    def _not_taken(self, pe: str, outcome: Outcome, why: str) -> None:
        is_locked = outcome is Outcome.LOCKED
        if not (is_locked and self._key is not None and self._client.tries(pe) < _UNTOLD_LOCKS):
            self._tell(pe, _KEEPS_IT if is_locked and pe in self._differs else why)
        self._pause(pe)

    def _tell(self, pe: str, why: str) -> None:
        if self._told.get(pe) != why:
            self._told[pe] = why
            self._turn.emit(events.TableNotTaken, pe=pe, why=why)

    def _pause(self, pe: str) -> None:
        """End the transfer to a PE, with a pause that is twice as long as the one before."""
        self._client.pause(pe)
        self._leave(pe, 0)

    def _leave(self, pe: str, pause_ns: int, *, abort: bool = False) -> None:
        """End the transfer to a PE if there is one; none to it begins for `pause_ns`, and the next PE is served."""
        self._client.put_off(pe, pause_ns)
        if self._client.pe == pe:
            self._client.end(abort=abort)
        self._begin_next()
