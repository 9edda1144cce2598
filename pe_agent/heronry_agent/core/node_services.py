"""What a PE answers when CANaerospace tools ask: IDS, NSS, TIS and STS on channel 0 (V1.7, p. 10-16).

    IDS  who are you       answered: at once, or after (n - 92) ms if everybody was asked
    NSS  this is the time  no answer; the time stamp is kept to be read (object 2022h) and sets no clock here: what a
                           PE does goes by its own clock, and an unverified time may not move it
    TIS  send so often     answered. The one interval that a PE lets be set is that of its CANopen heartbeat, within
                           the limits of object 1017h; rates of data are the plan's, and anything else is OUT_OF_RANGE
    STS  say your state    no answer but that: both pages of the state on every port, at most once in a heartbeat
                           period, and after (n - 92) ms if everybody was asked. Data go out in their own time

Other services and other channels are not answered, malformed requests are counted. A lost answer is asked for again by
whoever wants it; a doubled request is answered twice at most. A forged request does what a true one does: that costs a
few frames, and never an output.
"""

from collections.abc import Callable

from heronry_agent.core.network_management import NetworkManagement
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
    """Answers of one PE."""

    def __init__(self, node: int, period_ns: int, network: NetworkManagement) -> None:
        """`period_ns` is the heartbeat period of the uplink."""
        self._node, self._period_ns = node, period_ns
        self._network = network
        self._identification = IdentificationService(node)
        self._stated_ns = -period_ns  # when STS was last followed
        self._state_due_ns = NEVER_NS
        self._time: tuple[int, int] | None = None  # time stamp, and when it came
        self._answers: dict[int, Callable[[int, ServiceMessage, int], list[Send]]] = {
            Service.NSS: self._synchronise,
            Service.TIS: self._set_interval,
            Service.STS: self._transmit_state,
        }

    @property
    def next_ns(self) -> int:
        """When something is due."""
        return min(self._identification.next_ns, self._state_due_ns)

    def asked(self, port: int, frame: Frame, now_ns: int) -> list[Send] | Malformed:
        """A request came; gives what is to be said at once."""
        asked = decode_service(frame)
        if isinstance(asked, Malformed):
            return asked
        if asked.datum.service_code == Service.IDS:
            self._identification.asked(port, frame, now_ns)
            return self._identification.tick(now_ns)
        heed = self._answers.get(asked.datum.service_code)
        if heed is None or asked.datum.node_id not in (BROADCAST, self._node):
            return []
        return heed(port, asked, now_ns)

    def tick(self, now_ns: int) -> tuple[list[Send], bool]:
        """Give the answers that are due, and whether to say the whole state now."""
        is_state_due = now_ns >= self._state_due_ns
        if is_state_due:
            self._state_due_ns, self._stated_ns = NEVER_NS, now_ns
        return self._identification.tick(now_ns), is_state_due

    @property
    def time_stamp(self) -> int:
        """Time stamp last given; 0 before the first."""
        return 0 if self._time is None else self._time[0]

    def time_age_ms(self, now_ns: int) -> int:
        """How long ago that was; NO_TIME where there was none."""
        return NO_TIME if self._time is None else min((now_ns - self._time[1]) // _NS_PER_MS, NO_TIME - 1)

    def _synchronise(self, _port: int, asked: ServiceMessage, now_ns: int) -> list[Send]:
        if asked.datum.data_type == DataType.ULONG and isinstance(asked.datum.value, int):
            self._time = (asked.datum.value, now_ns)
        return []

    def _set_interval(self, port: int, asked: ServiceMessage, now_ns: int) -> list[Send]:
        if asked.datum.node_id == BROADCAST:  # an identifier is one node's
            return []
        wanted, result = asked.datum.value, Result.OUT_OF_RANGE
        if asked.datum.data_type == DataType.SHORT2 and isinstance(wanted, tuple):
            identifier, time_ms = wanted
            if identifier == heartbeat_id(self._node) and self._network.admits_heartbeat(time_ms):
                self._network.set_heartbeat(time_ms, now_ns)
                result = Result.OK
        return [Send(port, encode_service(answer(asked, self._node, message_code=result.message_code)))]

    def _transmit_state(self, _port: int, asked: ServiceMessage, now_ns: int) -> list[Send]:
        due_ns = max(now_ns + answer_delay_ns(asked, self._node), self._stated_ns + self._period_ns)
        self._state_due_ns = min(self._state_due_ns, due_ns)
        return []
