"""How a PE answers CANaerospace node services: IDS, NSS, TIS and STS on channel 0 (V1.7, p. 10-16).

    IDS  identification    answered: immediately, or after (node-ID - 92) ms if the request was for all nodes
    NSS  time stamp        no answer. The time stamp can be read (object 2022h), but sets no clock: a PE uses
                           its own clock, which an unverified time must not change
    TIS  set an interval   answered. Only the interval of the CANopen heartbeat can be set, within the limits of
                           object 1017h; anything else is OUT_OF_RANGE, since the plan sets the rates of data. A
                           request to all nodes is ignored: it names one CAN identifier, and only one node sends
                           under this identifier
    STS  transmit status   the answer is the state itself: pages 0 and 1 on every port, at most once in a
                           heartbeat period, and after (node-ID - 92) ms if the request was for all nodes. Data
                           frames keep their schedule

Other services and other channels are not answered; malformed requests are counted. If a request or an answer is
lost, the client sends the request again. A doubled request gets two answers at most. A forged request has the
effect of a true one: the node sends a few frames more, and no output is affected.
"""

from collections.abc import Callable

from heronry_agent.core.canopen.network_management import NetworkManagement
from heronry_wire.canaerospace import DataType
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identification import IdentificationService
from heronry_wire.identifiers import heartbeat_id
from heronry_wire.node_services import (
    BROADCAST,
    Result,
    Service,
    ServiceMessage,
    answer,
    answer_delay_ns,
    decode_service,
    encode_service,
)
from heronry_wire.sansio import NEVER_NS, Send

NO_TIME = 0xFFFF_FFFF
_NS_PER_MS = 1_000_000


class NodeServices:
    """Answers the node services of one PE."""

    def __init__(self, node: int, period_ns: int, network: NetworkManagement) -> None:
        """Begin before the first time stamp (NSS) has come; `period_ns` is the heartbeat period of the uplink."""
        self._node, self._period_ns = node, period_ns
        self._network = network
        self._identification = IdentificationService(node)
        self._stated_ns = -period_ns  # when STS was last executed
        self._state_due_ns = NEVER_NS
        self._time: tuple[int, int] | None = None  # time stamp of the last NSS, and when it came
        self._answers: dict[int, Callable[[int, ServiceMessage, int], list[Send]]] = {
            Service.NSS: self._synchronise,
            Service.TIS: self._set_interval,
            Service.STS: self._transmit_state,
        }

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`."""
        return min(self._identification.next_ns, self._state_due_ns)

    def take(self, port: int, frame: Frame, now_ns: int) -> list[Send] | Malformed:
        """Process a request; returns the frames to send now, or the reason why the request is malformed."""
        request = decode_service(frame)
        if isinstance(request, Malformed):
            return request
        if request.datum.service_code == Service.IDS:
            self._identification.asked(port, frame, now_ns)
            return self._identification.tick(now_ns)
        answer_to = self._answers.get(request.datum.service_code)
        if answer_to is None or request.datum.node_id not in (BROADCAST, self._node):
            return []
        return answer_to(port, request, now_ns)

    def tick(self, now_ns: int) -> tuple[list[Send], bool]:
        """Return the answers that are due, and whether pages 0 and 1 of the state are due because of an STS request."""
        is_state_due = now_ns >= self._state_due_ns
        if is_state_due:
            self._state_due_ns, self._stated_ns = NEVER_NS, now_ns
        return self._identification.tick(now_ns), is_state_due

    @property
    def time_stamp(self) -> int:
        """Time stamp in the last NSS; 0 if none has come."""
        return 0 if self._time is None else self._time[0]

    def time_age_ms(self, now_ns: int) -> int:
        """Time in ms since the last NSS came; NO_TIME if none has come."""
        return NO_TIME if self._time is None else min((now_ns - self._time[1]) // _NS_PER_MS, NO_TIME - 1)

    def _synchronise(self, _port: int, request: ServiceMessage, now_ns: int) -> list[Send]:
        if request.datum.data_type == DataType.ULONG and isinstance(request.datum.value, int):
            self._time = (request.datum.value, now_ns)
        return []

    def _set_interval(self, port: int, request: ServiceMessage, now_ns: int) -> list[Send]:
        if request.datum.node_id == BROADCAST:  # an identifier belongs to one node
            return []
        wanted, result = request.datum.value, Result.OUT_OF_RANGE
        if request.datum.data_type == DataType.SHORT2 and isinstance(wanted, tuple):
            identifier, time_ms = wanted
            if identifier == heartbeat_id(self._node) and self._network.admits_heartbeat(time_ms):
                self._network.set_heartbeat(time_ms, now_ns)
                result = Result.OK
        return [Send(port, encode_service(answer(request, self._node, message_code=result.message_code)))]

    def _transmit_state(self, _port: int, request: ServiceMessage, now_ns: int) -> list[Send]:
        due_ns = max(now_ns + answer_delay_ns(request, self._node), self._stated_ns + self._period_ns)
        self._state_due_ns = min(self._state_due_ns, due_ns)
        return []
