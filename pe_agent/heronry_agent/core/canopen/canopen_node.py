"""A PE as tools of other makers see it: a CANopen node (CiA 301) that also answers CANaerospace node services.

Each service has a file of its own: boot-up, heartbeat and NMT (`network_management`), SDO (`sdo_server`, with
`object_dictionary` and `pe_objects` behind it), node services (`node_services`). This file hands the services their
frames and sends their answers. No service is needed in flight: other parts of the agent decide what a PE runs, and a
failure of a service does not affect these parts.

The PE accepts SDO and NMT only on the uplink, as it does all commands. With a key it refuses NMT commands and SDO
writes until it is unlocked (`authenticity`); a transfer that began before the lock closed again may be completed.

SDO has a higher priority than some of the data, so its rate is limited. While this PE runs nothing, an upload by block
may take half of the bus; once the PE is configured, its SDO transfers together may take a tenth. A request that comes
too soon is answered later. Up to four requests are kept, since a client may send several in a row: some SDO requests
get no answer. Further requests are dropped and counted. The segments of a block are taken as they come, since they are
on the bus already, and a client is a process that wakes late and then makes up for up to LATE_NS. It is the answer to
the block that waits until the tenth allows it, and no client goes on without it.
"""

from collections import deque
from collections.abc import Callable, Iterator
from functools import partial

from heronry_agent.core.canopen.network_management import NetworkManagement, NmtOutcome
from heronry_agent.core.canopen.node_services import NodeServices
from heronry_agent.core.canopen.object_dictionary import Locked
from heronry_agent.core.canopen.pe_objects import Parts, PeObjects
from heronry_agent.core.canopen.sdo_server import SdoServer
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identification import REQUEST_ID
from heronry_wire.identifiers import NMT_ID, sdo_request_id, sdo_response_id
from heronry_wire.management import NO_EPOCH
from heronry_wire.nmt import NmtState, code_of
from heronry_wire.sansio import NEVER_NS, Received, Send
from heronry_wire.sdo import LATE_NS, MESSAGE_BYTES
from heronry_wire.timing import worst_bits

_NS_PER_S = 1_000_000_000
_DESK_SHARE, _FLIGHT_SHARE = 2, 10  # SDO may take 1/2 of the bus while the PE runs nothing, 1/10 once it is configured
_MOST_HELD = 4


class CanopenNode:
    """The CANopen services and CANaerospace node services of one PE; `next_ns` is when to call `tick`."""

    def __init__(self, parts: Parts) -> None:
        turn, index = self._turn, self._index = parts.turn, parts.index
        self._followed_manager, self._active_configuration, self._modules = (
            parts.followed_manager,
            parts.active_configuration,
            parts.modules,
        )
        self._authenticity = parts.authenticity
        port = index.table.ports[index.uplink]
        self._network = NetworkManagement(index.node, index.ports, turn.now_ns)
        self._services = NodeServices(index.node, port.heartbeat_ns, self._network)
        objects = PeObjects(parts, self._network, self._services)
        self._frame_ns = worst_bits(MESSAGE_BYTES) * _NS_PER_S // port.bitrate
        self._sdo = SdoServer(Locked(objects.dictionary(), self._locked), _DESK_SHARE * self._frame_ns)
        self._held: deque[bytes] = deque()  # SDO requests that wait for their turn
        self._turn_ns = turn.now_ns  # when the next one may be served
        self._answer: tuple[int, bytes] | None = None  # to a block that came too fast, and when it may be sent
        self.next_ns = turn.now_ns
        self._sdo_answer_id = sdo_response_id(index.node)

    @property
    def booted(self) -> bool:
        """Tell whether the boot-up frame has been sent."""
        return self._network.booted

    def handlers(self) -> Iterator[tuple[int, Callable[[Received], None]]]:
        """Return the CAN identifiers that these services take, each with its handler."""
        yield NMT_ID, partial(self._take, self._nmt)
        yield sdo_request_id(self._index.node), partial(self._take, self._request)
        yield REQUEST_ID, partial(self._take, self._node_service)

    def tick(self) -> None:
        """Send the heartbeat, answers and SDO segments that are due."""
        turn = self._turn
        turn.do(*self._network.tick(turn.now_ns, configured=self._configured(), managed=self._is_managed()))
        answers, says_state = self._services.tick(turn.now_ns)
        turn.do(*answers)
        turn.wants_page_0 |= says_state
        turn.wants_page_1 |= says_state
        if self._answer is not None and turn.now_ns >= self._answer[0]:
            (_, answer), self._answer = self._answer, None
            self._say(answer)
        elif self._held and turn.now_ns >= self._turn_ns:
            self._serve(self._held.popleft())
        else:
            self._say(self._sdo.tick(turn.now_ns))
        self._find_next()

    def _take(self, handle: Callable[[Received], None], event: Received) -> None:
        handle(event)
        self._find_next()

    def _find_next(self) -> None:
        held_ns = self._turn_ns if self._held else NEVER_NS
        answer_ns = NEVER_NS if self._answer is None else self._answer[0]
        self.next_ns = min(self._network.next_ns, self._services.next_ns, self._sdo.next_ns, held_ns, answer_ns)

    def _configured(self) -> bool:
        return self._active_configuration.running.epoch != NO_EPOCH

    def _is_managed(self) -> bool:
        """Tell whether NMT commands are to be refused: a manager is heard, and has not unlocked this PE."""
        is_unlocked = self._authenticity is not None and self._authenticity.is_open
        return self._followed_manager.hears_lease(self._turn.now_ns) and not is_unlocked

    def _locked(self) -> bool:
        return self._authenticity is not None and not self._authenticity.is_open

    def _nmt(self, event: Received) -> None:
        if self._is_from_beyond(event):
            return
        if self._locked():
            self._turn.count("NMT command without an UNLOCK", NMT_ID)
            return
        outcome = self._network.command(
            event.frame.data, self._turn.now_ns, configured=self._configured(), managed=self._is_managed()
        )
        if outcome is NmtOutcome.MALFORMED:
            self._turn.count("malformed NMT command", NMT_ID)
        elif outcome is NmtOutcome.REFUSED:
            self._turn.count("NMT command while this PE is configured or hears a manager", NMT_ID)
        elif outcome is not NmtOutcome.NOT_MINE:
            self._turn.note("nmt", f"NMT command {code_of(event.frame.data)} is executed: this PE runs nothing")
            if outcome is NmtOutcome.RESET:
                self._sdo.reset()
                self._held.clear()
                self._answer = None
                self._modules.faults.history.clear()

    def _request(self, event: Received) -> None:
        if self._is_from_beyond(event):
            return
        if self._network.state(configured=self._configured(), managed=self._is_managed()) is NmtState.STOPPED:
            self._sdo.reset()
        elif len(event.frame.data) != MESSAGE_BYTES:
            self._turn.count("malformed SDO request", event.frame.can_id)
        elif len(self._held) >= _MOST_HELD:
            self._turn.count("SDO request before the answer to the last", event.frame.can_id)
        elif self._held or self._answer is not None or self._comes_too_soon():
            self._held.append(event.frame.data)
        else:
            self._serve(event.frame.data)

    def _comes_too_soon(self) -> bool:
        return self._configured() and self._turn.now_ns < self._turn_ns and not self._sdo.receives_segments

    def _serve(self, request: bytes) -> None:
        """Answer an SDO request, and set the time at which the next SDO request may be answered at the earliest."""
        now_ns, pause_ns = self._turn.now_ns, self._frame_ns * (_FLIGHT_SHARE if self._configured() else _DESK_SHARE)
        self._sdo.segment_ns = pause_ns
        is_segment = self._sdo.receives_segments
        answer = self._sdo.request(request, now_ns)
        if not is_segment:
            self._turn_ns = now_ns + 2 * pause_ns
        else:
            due_ns = max(self._turn_ns, now_ns - LATE_NS)
            self._turn_ns = due_ns + pause_ns  # one frame: half of what others take with their answers
            if answer is not None and self._configured() and now_ns < due_ns:
                self._answer, answer = (due_ns, answer), None
        self._say(answer)

    def _node_service(self, event: Received) -> None:
        said = self._services.take(event.port, event.frame, self._turn.now_ns)
        if isinstance(said, Malformed):
            self._turn.count("malformed node service", event.frame.can_id)
        else:
            self._turn.do(*said)

    def _is_from_beyond(self, event: Received) -> bool:
        if event.port == self._index.uplink:
            return False
        self._turn.count("command from beyond", event.frame.can_id)
        return True

    def _say(self, answer: bytes | None) -> None:
        if answer is not None:
            self._turn.do(Send(self._index.uplink, Frame(self._sdo_answer_id, answer)))
