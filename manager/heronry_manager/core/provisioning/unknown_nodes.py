"""Nodes that use a node-ID of a PE which the spec does not have: they are told, and nothing follows.

    heard      a heartbeat or state frame has come from such a node-ID within FORGOTTEN_NS
    forgotten  none has come for so long

What the node is shows in its frames: a state that is UNCONFIGURED: it has a table, and runs nothing; any other state:
it runs something, so another system uses this bus. Of a node without states its heartbeat says it: INITIALISING or
PRE-OPERATIONAL: it waits for a table; any other: a device of another system.

Nothing proves these frames. A forged one makes a wrong line in the status. An event comes when the node says something
else than in the last event or was forgotten, but only one in FORGOTTEN_NS.
"""

from typing import Any

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.provisioning.table_bringing import WAITING
from heronry_manager.core.turn import Turn
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identifiers import PE_NODES, heartbeat_id, state_id
from heronry_wire.state_frames import PeState, decode_state

FORGOTTEN_NS = 10_000_000_000
WAITS, IDLE, RUNS = "waits for a table", "has a table of another spec, and runs nothing", "runs for another system"


class UnknownNodes:
    """Knows the node-IDs of PEs that are in use and not in the spec."""

    def __init__(self, spec: Spec, turn: Turn) -> None:
        """Begin with no such node heard."""
        self._turn = turn
        known = {pe.node_id for pe in spec.pes.values()}
        nodes = [node for node in PE_NODES if node not in known]
        self._of_heartbeat = {heartbeat_id(node): node for node in nodes}
        self._of_state = {state_id(node): node for node in nodes}
        self._heard: dict[int, tuple[str, int]] = {}  # by node: what it does, and when it was heard last
        self._state_ns: dict[int, int] = {}  # by node: when its last state came
        self._told: dict[int, tuple[str, int]] = {}  # by node: the last event

    def hears(self, identifier: int) -> bool:
        """Tell whether frames with this identifier are used here."""
        return identifier in self._of_heartbeat or identifier in self._of_state

    def take(self, frame: Frame) -> None:
        """Note a heartbeat or a state of a node that is not in the spec; any other frame is ignored."""
        if frame.can_id in self._of_heartbeat:
            node = self._of_heartbeat[frame.can_id]
            now_ns = self._turn.now_ns
            if now_ns - self._state_ns.get(node, -FORGOTTEN_NS) >= FORGOTTEN_NS:
                self._note(node, WAITS if frame.data in WAITING else RUNS)
            else:
                self._note(node, self._heard[node][0])
        elif frame.can_id in self._of_state:
            page = decode_state(frame.data)
            if not isinstance(page, Malformed):
                node = self._of_state[frame.can_id]
                self._state_ns[node] = self._turn.now_ns
                self._note(node, IDLE if page.state is PeState.UNCONFIGURED else RUNS)

    def status(self) -> list[dict[str, Any]]:
        """Return each such node that was heard within FORGOTTEN_NS: node, says (what it does), for_ns (since then)."""
        now_ns = self._turn.now_ns
        return [
            {"node": node, "says": says, "for_ns": now_ns - heard_ns}
            for node, (says, heard_ns) in sorted(self._heard.items())
            if now_ns - heard_ns <= FORGOTTEN_NS
        ]

    def _note(self, node: int, says: str) -> None:
        now_ns = self._turn.now_ns
        _, heard_ns = self._heard.get(node, ("", -FORGOTTEN_NS - 1))
        told, told_ns = self._told.get(node, ("", -FORGOTTEN_NS - 1))
        self._heard[node] = says, now_ns
        if now_ns - told_ns > FORGOTTEN_NS and (told != says or now_ns - heard_ns > FORGOTTEN_NS):
            self._told[node] = says, now_ns
            self._turn.emit(events.UnknownNode, node=node, says=says)
