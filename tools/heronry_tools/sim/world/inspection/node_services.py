"""The topic CANaerospace node services (V1.7, 3.9): identification, time stamp, intervals, state on request."""

from heronry_tools.sim.world.inspection.topic import MS, SHORT_MS, SLOW_MS, Topic, demand
from heronry_tools.sim.world.sdo_talk import Talk
from heronry_wire.canaerospace import DataType
from heronry_wire.canopen_objects import HEARTBEAT_MS, HEARTBEAT_TIME, TIME
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identification import IDENTIFICATION
from heronry_wire.identifiers import heartbeat_id, state_id
from heronry_wire.node_services import (
    BROADCAST,
    Result,
    Service,
    ServiceMessage,
    decode_service,
    encode_service,
    read_identification,
    request,
    service_id,
)

_REQUESTS, ANSWERS = service_id(0, is_answer=False), service_id(0, is_answer=True)
_STAMP = 0x12345678


class NodeServices(Topic):
    """Requests node services, and verifies the answers."""

    def node_services(self) -> Talk[None]:
        """Verify every node service of a PE, with right and wrong requests."""
        yield from self._identification()
        stamp = request(Service.NSS, BROADCAST, data_type=DataType.ULONG, value=_STAMP)
        yield encode_service(stamp), ANSWERS, 20 * MS
        yield from self.read(TIME, 1, _STAMP)
        found = yield from self._sdo.upload(TIME, 2)
        age_ms = int.from_bytes(found, "little") if isinstance(found, bytes) else -1
        demand(20 <= age_ms < 500, f"the time stamp is {age_ms} ms old")
        yield from self._interval(heartbeat_id(self._node), SHORT_MS, Result.OK)
        yield from self.beats_every(SHORT_MS)
        yield from self._interval(heartbeat_id(self._node), SHORT_MS - 1, Result.OUT_OF_RANGE)
        yield from self._interval(state_id(self._node), SLOW_MS, Result.OUT_OF_RANGE)
        yield from self._interval(heartbeat_id(self._node), HEARTBEAT_MS, Result.OK)
        yield from self._state_transmission()
        for service, node in ((Service.SCS, self._node), (Service.TIS, self._node + 1), (Service.TIS, BROADCAST)):
            value = (heartbeat_id(self._node), SHORT_MS)
            unheeded = request(service, node, data_type=DataType.SHORT2, value=value)
            answer = yield from self._service(unheeded, 20)
            is_its = answer is not None and answer.datum.node_id == self._node
            demand(not is_its, f"{service.name} to {node} is answered with {answer}")
        yield Frame(_REQUESTS, b"\0\0"), ANSWERS, 20 * MS
        yield from self.read(HEARTBEAT_TIME, 0, HEARTBEAT_MS)

    def _identification(self) -> Talk[None]:
        answer = yield from self._service(request(Service.IDS, self._node, message_code=7), 10)
        is_right = answer is not None and read_identification(answer) == IDENTIFICATION
        demand(is_right and answer is not None and answer.datum.message_code == 7, f"IDS is answered with {answer}")
        begun_ns = self._clock.now_ns
        answer = yield from self._service(request(Service.IDS, BROADCAST), 60)
        while answer is not None and answer.datum.node_id != self._node:
            answer = _read_service((yield None, ANSWERS, 60 * MS))
        late_ns = self._clock.now_ns - begun_ns - (self._node - 92) * MS
        demand(answer is not None and 0 <= late_ns < 5 * MS, f"IDS to all is answered {late_ns} ns late: {answer}")
        yield from self.wait(60)  # for the answers of the other nodes

    def _interval(self, identifier: int, time_ms: int, result: Result) -> Talk[None]:
        wanted = request(Service.TIS, self._node, data_type=DataType.SHORT2, value=(identifier, time_ms))
        answer = yield from self._service(wanted, 20)
        code = None if answer is None else answer.datum.message_code
        demand(code == result.message_code, f"an interval of {time_ms} ms for {identifier} is answered with {code}")

    def _state_transmission(self) -> Talk[None]:
        """Verify service STS: on request the PE sends pages 0 and 1 of its state immediately.

        Further requests within one heartbeat period must have no effect.
        """
        period_ns = self._table.ports[self._table.uplink].heartbeat_ns
        yield from self.wait(2 * period_ns // MS)
        seen, begun_ns = len(self._heard.pages_0), self._clock.now_ns
        yield encode_service(request(Service.STS, self._node)), -1, 3 * MS
        pages = [page for t, page in (*self._heard.pages_0[-2:], *self._heard.pages_1[-2:]) if t > begun_ns]
        demand(len(self._heard.pages_0) > seen and len(pages) >= 2, "STS is not followed by the whole state")
        seen = len(self._heard.pages_0)
        for _ in range(3):
            yield encode_service(request(Service.STS, self._node)), -1, 1 * MS
        demand(len(self._heard.pages_0) - seen <= 1, "STS is followed more often than once in a period")
        yield from self.wait(2 * period_ns // MS)

    def _service(self, wanted: ServiceMessage, ms: int) -> Talk[ServiceMessage | None]:
        return _read_service((yield encode_service(wanted), ANSWERS, ms * MS))


def _read_service(data: bytes | None) -> ServiceMessage | None:
    message = None if data is None else decode_service(Frame(ANSWERS, data))
    return None if isinstance(message, Malformed) else message
