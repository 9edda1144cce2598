"""Received frames: each is decoded, authenticated where there is a key, and handed to the file that deals with it.

    state of a PE          to `pe_reports`; with a key only if it is believed
    EMCY of a PE           to `pe_reports`; with a key once a page 0 has proven it. A report on a channel of a
                           replicated bus needs no proof, since it changes no plan
    command of a manager   to `succession`; with a key once its TAG has come. PREPARE and SLICE do not wait for their
                           TAG, since a proven ACTIVATE or LEASE names their digest
    report of a gateway    to `known_situation`; nothing proves it (`authenticity`)
    SDO answer of a PE     to `pe_details`, if the manager reads objects; nothing proves it, and no decision depends on
                           it
    heartbeat, SDO answer  of a PE without a table: to `provisioning`, which brings the table; nothing proves either
    SDO request to a PE    (from another SDO client) to `pe_details`, which then reads nothing from that PE for a while
    node not in the spec   its heartbeats and states: to `unknown_nodes`
    request of any node    to identify the manager (CANaerospace): to `identification`, which answers it

Dropped are extended and remote frames, error frames, frames with any other identifier, and frames that cannot be
decoded.

The file that processes a frame says what follows if the frame is late, doubled or forged.
"""

from heronry_manager.core.intake.pe_reports import PeReports
from heronry_manager.core.intake.reactions import Reactions
from heronry_manager.core.intake.succession import Succession
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.mastership import Claim, Mastership
from heronry_manager.core.reloading import Reloading
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.turn import Turn
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identification import REQUEST_ID, IdentificationService
from heronry_wire.identifiers import (
    MANAGER_NODES,
    Command,
    emcy_id,
    management_id,
    sdo_request_id,
    sdo_response_id,
    state_id,
)
from heronry_wire.management import ElementKind, Emergency, decode_command, decode_emergency
from heronry_wire.sansio import Received
from heronry_wire.state_frames import StatePage0, decode_state

_NEEDS_NO_TAG = (Command.PREPARE, Command.SLICE)


class Inbound:
    """Decodes each received frame, and hands it to the part of the manager that deals with it."""

    def __init__(
        self,
        settings: ManagerSettings,
        turn: Turn,
        claim: Claim,
        known: Knowledge,
        *,
        reports: PeReports,
        reactions: Reactions,
        succession: Succession,
        reloading: Reloading,
    ) -> None:
        self._is_advising, self._turn, self._claim = settings.advise, turn, claim
        self._situation, self._authenticity, self._details = known.situation, known.authenticity, known.details
        self._bringing, self._code, self._unknown = known.bringing, known.code, known.unknown_nodes
        self._reports, self._reactions, self._succession = reports, reactions, succession
        self._reloading = reloading
        self._identification = IdentificationService(settings.node)
        pes = settings.spec.pes.values()
        self._pe_of_state_id = {state_id(pe.node_id): pe.name for pe in pes}
        self._pe_of_emcy_id = {emcy_id(pe.node_id): pe.name for pe in pes}
        self._node_of_sdo_id = {sdo_response_id(pe.node_id): pe.node_id for pe in pes if settings.reads_objects}
        self._node_of_sdo_request = {sdo_request_id(node): node for node in self._node_of_sdo_id.values()}
        followed = {*Command} if settings.standby or settings.advise else {Command.LEASE}
        if settings.key is not None:
            followed |= {Command.CONTROL, Command.TAG}
        self._manager_ids = {
            management_id(one, command): (one, command) for one in MANAGER_NODES for command in followed
        }

    def hears(self, identifier: int) -> bool:
        """Tell whether the manager uses frames with this identifier; a driver may drop all others."""
        return (
            identifier in self._pe_of_state_id
            or identifier in self._pe_of_emcy_id
            or identifier in self._manager_ids
            or self._situation.is_of_a_radio(identifier)
            or identifier == REQUEST_ID
            or identifier in self._node_of_sdo_id
            or identifier in self._node_of_sdo_request
            or self._bringing.hears(identifier)
            or self._code.hears(identifier)
            or self._unknown.hears(identifier)
            or self._reloading.hears(identifier)
        )

    def take(self, frame: Frame) -> None:
        """Decode a received frame, check it with the key if there is one, and hand it to the part that needs it."""
        if frame.extended or frame.remote or frame.error:
            return
        pe = self._pe_of_state_id.get(frame.can_id)
        if pe is not None:
            self._state(pe, frame.data)
        elif frame.can_id in self._pe_of_emcy_id:
            self._emergency(self._pe_of_emcy_id[frame.can_id], frame.data)
        elif self._situation.is_of_a_radio(frame.can_id):
            self._reactions.take(self._situation.link_reported(frame))
        elif frame.can_id == REQUEST_ID:
            self._identification.asked(0, frame, self._turn.now_ns)
        elif frame.can_id in self._manager_ids:
            self._command(*self._manager_ids[frame.can_id], frame)
        else:
            self._bringing.take(frame)
            self._code.take(frame)
            self._unknown.take(frame)
            self._reloading.take(frame)
            self._sdo(frame)

    def _sdo(self, frame: Frame) -> None:
        if frame.can_id in self._node_of_sdo_id:
            self._details.heard(self._node_of_sdo_id[frame.can_id], frame.data)
        elif frame.can_id in self._node_of_sdo_request:
            self._details.heard_other(self._node_of_sdo_request[frame.can_id])

    @property
    def next_ns(self) -> int:
        """Time (ns) at which to call `tick`; NEVER_NS: no answer is due."""
        return self._identification.next_ns

    def tick(self) -> None:
        """Send the answer to a request for identification, if an answer is due."""
        self._turn.do(*self._identification.tick(self._turn.now_ns))

    def _state(self, pe: str, data: bytes) -> None:
        page = decode_state(data)
        if isinstance(page, Malformed):
            return
        authenticity = self._authenticity
        if authenticity is None:
            self._reports.page(pe, page)
            return
        believed = authenticity.believed(pe, page, data)
        self._reports.page(pe, believed)
        if not isinstance(page, StatePage0):
            return
        if believed is None:
            self._reports.unproven(pe, page)
            return
        proven = authenticity.take_emergency(pe)
        if proven is not None:
            self._reports.emergency(pe, decode_emergency(proven))

    def _emergency(self, pe: str, data: bytes) -> None:
        emergency = decode_emergency(data)
        authenticity = self._authenticity
        if isinstance(emergency, Emergency) and emergency.kind is ElementKind.CHANNEL:
            self._reports.lost_channel(pe, emergency)
        elif authenticity is None:
            self._reports.emergency(pe, emergency)
        else:
            authenticity.hold_emergency(pe, data)

    def _command(self, node: int, command: Command, frame: Frame) -> None:
        authenticity = self._authenticity
        if authenticity is None or command in _NEEDS_NO_TAG:
            self._succession.heard(node, decode_command(command, frame.data))
        if authenticity is None:
            return
        if command is Command.TAG:
            found = authenticity.proven(node, frame.data)
            if found is not None and found.command not in _NEEDS_NO_TAG:
                self._succession.heard(node, decode_command(found.command, found.event.frame.data))
        else:
            if command is Command.CONTROL and (self._is_advising or self._claim.state is Mastership.STANDBY):
                authenticity.overhear(node, frame.data)
            authenticity.hold(node, command, Received(0, frame))
