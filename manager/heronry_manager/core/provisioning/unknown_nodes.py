"""Nodes that use a node-ID of a PE which the spec does not have: they are told with what they offer, nothing follows.

    heard      a heartbeat or state frame has come from such a node-ID within FORGOTTEN_NS
    forgotten  none has come for so long

What the node is shows in its frames: a state that is UNCONFIGURED: it has a table, and runs nothing; any other state:
it runs something, so another system uses this bus. Of a node without states its heartbeat says it: INITIALISING or
PRE-OPERATIONAL: it waits for a table; any other: a device of another system.

A node that waits for a table is asked what it offers (object 2025h), once while it is heard, and anew when it has given
nothing after ASK_AGAIN_NS. The questions take a fortieth of the bus of the manager. Another SDO client goes first.

Nothing proves these frames. A forged heartbeat makes a wrong line in the status and one question in ASK_AGAIN_NS, a
forged answer a wrong offer. An event comes when the node says something else than in the last event or was forgotten,
but only one in FORGOTTEN_NS.
"""

from typing import Any

from heronry_manager import events
from heronry_manager.core.mastership import Claim
from heronry_manager.core.provisioning.table_bringing import WAITING
from heronry_manager.core.sdo_client import ObjectReader
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.turn import Turn
from heronry_wire.canopen_objects import OFFER
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identifiers import PE_NODES, heartbeat_id, sdo_request_id, sdo_response_id, state_id
from heronry_wire.node_offer import read_offer
from heronry_wire.sdo import MESSAGE_BYTES
from heronry_wire.state_frames import PeState, decode_state
from heronry_wire.timing import worst_bits

FORGOTTEN_NS = 10_000_000_000
ASK_AGAIN_NS = 60_000_000_000
_SHARE = 40  # one request in so many frames of full length
_NS_PER_S = 1_000_000_000
WAITS, IDLE, RUNS = "waits for a table", "has a table of another spec, and runs nothing", "runs for another system"


class UnknownNodes:
    """Knows the node-IDs of PEs that are in use and not in the spec."""

    def __init__(self, settings: ManagerSettings, turn: Turn, claim: Claim) -> None:
        """Begin with no such node heard; without `settings.reads_objects` none is asked for its offer."""
        self._turn, self._claim = turn, claim
        known = {pe.node_id for pe in settings.spec.pes.values()}
        nodes = [node for node in PE_NODES if node not in known]
        self._of_heartbeat = {heartbeat_id(node): node for node in nodes}
        self._of_state = {state_id(node): node for node in nodes}
        asked = nodes if settings.reads_objects else []
        self._of_answer = {sdo_response_id(node): node for node in asked}
        self._of_request = {sdo_request_id(node): node for node in asked}
        frame_ns = worst_bits(MESSAGE_BYTES) * _NS_PER_S // settings.bus.bitrate
        self._reader = ObjectReader(turn.do, segment_ns=_SHARE * frame_ns)
        self._asked_ns: dict[int, int] = {}  # by node: when it was asked last
        self._offers: dict[int, dict[str, Any]] = {}
        self._heard: dict[int, tuple[str, int]] = {}  # by node: what it does, and when it was heard last
        self._state_ns: dict[int, int] = {}  # by node: when its last state came
        self._told: dict[int, tuple[str, int]] = {}  # by node: the last event

    def hears(self, identifier: int) -> bool:
        """Tell whether frames with this identifier are used here."""
        is_asked = identifier in self._of_answer or identifier in self._of_request
        return is_asked or identifier in self._of_heartbeat or identifier in self._of_state

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`; NEVER_NS: no node is being asked."""
        return self._reader.next_ns

    def tick(self) -> None:
        """Go on asking a node."""
        self._reader.tick(self._turn.now_ns)

    def end_of_step(self) -> None:
        """Ask nothing any more if this manager is not active; to be called after each event."""
        if not self._claim.is_active and self._asked_ns:
            self._asked_ns.clear()
            self._reader.give_up()

    def take(self, frame: Frame) -> None:
        """Note a heartbeat or a state of a node that is not in the spec; any other frame is ignored."""
        if frame.can_id in self._of_heartbeat:
            node = self._of_heartbeat[frame.can_id]
            now_ns = self._turn.now_ns
            if now_ns - self._state_ns.get(node, -FORGOTTEN_NS) >= FORGOTTEN_NS:
                self._note(node, WAITS if frame.data in WAITING else RUNS)
            else:
                self._note(node, self._heard[node][0])
        elif frame.can_id in self._of_answer:
            self._reader.heard(self._of_answer[frame.can_id], frame.data, self._turn.now_ns)
        elif frame.can_id in self._of_request:
            self._reader.heard_other(self._of_request[frame.can_id], self._turn.now_ns)
        elif frame.can_id in self._of_state:
            page = decode_state(frame.data)
            if not isinstance(page, Malformed):
                node = self._of_state[frame.can_id]
                self._state_ns[node] = self._turn.now_ns
                self._note(node, IDLE if page.state is PeState.UNCONFIGURED else RUNS)

    def status(self) -> list[dict[str, Any]]:
        """Return each such node that was heard within FORGOTTEN_NS.

        Of each: node, says (what it does), for_ns (since it was heard), offer (`node_offer`, or null).
        """
        now_ns = self._turn.now_ns
        return [
            {"node": node, "says": says, "for_ns": now_ns - heard_ns, "offer": self._offers.get(node)}
            for node, (says, heard_ns) in sorted(self._heard.items())
            if now_ns - heard_ns <= FORGOTTEN_NS
        ]

    def _ask(self, node: int) -> None:
        now_ns = self._turn.now_ns
        is_due = node not in self._offers and now_ns - self._asked_ns.get(node, -ASK_AGAIN_NS) >= ASK_AGAIN_NS
        if not (is_due and self._of_answer and self._claim.is_active and not self._turn.silent):
            return
        self._asked_ns[node] = now_ns

        def take(value: bytes | None) -> None:
            offer = None if value is None else read_offer(value.decode("ascii", "replace"))
            if offer is not None:
                self._offers[node] = offer

        self._reader.read(node, OFFER, 0, take, now_ns)

    def _note(self, node: int, says: str) -> None:
        now_ns = self._turn.now_ns
        _, heard_ns = self._heard.get(node, ("", -FORGOTTEN_NS - 1))
        told, told_ns = self._told.get(node, ("", -FORGOTTEN_NS - 1))
        self._heard[node] = says, now_ns
        if says != WAITS or now_ns - heard_ns > FORGOTTEN_NS:
            self._offers.pop(node, None)
        if says == WAITS:
            self._ask(node)
        if now_ns - told_ns > FORGOTTEN_NS and (told != says or now_ns - heard_ns > FORGOTTEN_NS):
            self._told[node] = says, now_ns
            self._turn.emit(events.UnknownNode, node=node, says=says)
