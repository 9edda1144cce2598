"""How a PE answers tools: node services of CANaerospace, names in its objects, a table with a seal."""

from heronry_wire.canaerospace import DataType, Value
from heronry_wire.canopen_objects import COUNTERS, HEARTBEAT_TIME, MODULE_MODES, TIME
from heronry_wire.frame import Frame
from heronry_wire.identification import IDENTIFICATION
from heronry_wire.identifiers import heartbeat_id
from heronry_wire.management import Control, Operation
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
from lab.conformance import puppets
from lab.conformance.pe_keyed import KEY, OTHER_KEY, Keyed
from lab.conformance.pe_serving import Client
from lab.conformance.pe_under_test import (
    CONTROL,
    EVERYTHING,
    NEIGHBOUR,
    NODE,
    SERVO,
    PeUnderTest,
    gaps,
    moments,
)
from lab.conformance.player import MS, demand, equal

_REQUEST_ID, _ANSWER_ID = service_id(0, is_answer=False), service_id(0, is_answer=True)
_PLACE_MS = NODE - 92  # the delay of its answer to a request to all nodes
_NO_TIME = 0xFFFF_FFFF
_REFUSED = "30 00 09 06"


def _asks(pe: PeUnderTest, service: Service | int, node: int, kind: DataType, value: Value = None) -> int:
    """Send a request in the quiet part of a period; gives the time of the request."""
    pe.run_into_next_period(5)
    pe.main.say(encode_service(request(service, node, data_type=kind, value=value, message_code=9)))
    return pe.now_ns


def _answers(pe: PeUnderTest, since_ns: int) -> list[tuple[int, ServiceMessage]]:
    found = []
    for t_ns, frame in pe.main.since(since_ns, [_ANSWER_ID]):
        message = decode_service(frame)
        assert isinstance(message, ServiceMessage)
        equal(message.datum.node_id, NODE, "nodes that answer")
        found.append((t_ns, message))
    return found


def it_answers_an_identification_request() -> None:
    """It answers a request to itself immediately, one to all nodes at its place, and one to another node not at all."""
    pe = PeUnderTest().attended()
    for node, after_ms in ((NODE, 0), (BROADCAST, _PLACE_MS), (NEIGHBOUR, None)):
        began_ns = _asks(pe, Service.IDS, node, DataType.NODATA)
        pe.run(45)
        answers = _answers(pe, began_ns)
        equal(len(answers), 0 if after_ms is None else 1, f"answers to a request to {node}")
        for t_ns, message in answers:
            late_ns = t_ns - began_ns - (after_ms or 0) * MS
            demand(0 < late_ns < MS, f"IDS of {node} is answered {late_ns} ns late")
            equal((message.datum.message_code, read_identification(message)), (9, IDENTIFICATION), "its answer")


def it_keeps_the_time_that_it_is_given() -> None:
    """The PE gives the time, with its age, and accepts only a ULONG as a time. Setting the time has no answer."""
    pe = PeUnderTest().attended()
    equal((pe.object(TIME, 1), pe.object(TIME, 2)), (0, _NO_TIME), "time, before any")
    for kind, value, kept in ((DataType.FLOAT, 1.0, 0), (DataType.ULONG, 123_456, 123_456)):
        began_ns = _asks(pe, Service.NSS, BROADCAST, kind, value)
        pe.run(250)
        equal(_answers(pe, began_ns), [], "answers to NSS")
        equal(pe.object(TIME, 1), kept, f"time after {value}")
    demand(250 <= pe.object(TIME, 2) <= 265, "the age of its time, in ms")


def only_the_interval_of_its_heartbeat_can_be_set() -> None:
    """The interval is in whole ms from 100 on, or 0 for no heartbeat; the PE answers every request to its node."""
    pe = PeUnderTest().attended()
    own, ok, refused = heartbeat_id(NODE), Result.OK.message_code, Result.OUT_OF_RANGE.message_code
    interval = 1000
    for node, kind, value, answered in (
        (NODE, DataType.SHORT2, (own, 250), ok),
        (NODE, DataType.SHORT2, (own, 99), refused),
        (NODE, DataType.SHORT2, (own, -1), refused),
        (NODE, DataType.SHORT2, (heartbeat_id(NEIGHBOUR), 300), refused),
        (NODE, DataType.ULONG, 300, refused),
        (BROADCAST, DataType.SHORT2, (own, 300), None),
        (NEIGHBOUR, DataType.SHORT2, (own, 300), None),
    ):
        began_ns = _asks(pe, Service.TIS, node, kind, value)
        pe.run(5)
        codes = [message.datum.message_code for _, message in _answers(pe, began_ns)]
        equal(codes, [] if answered is None else [answered], f"answers to TIS {node} {value}")
        interval = 250 if answered == ok else interval
        equal(pe.object(HEARTBEAT_TIME), interval, f"interval after TIS {node} {value}")
    began_ns = pe.run(2000)
    apart = gaps(moments(pe.main.since(began_ns, [own])))
    demand(all(abs(gap - 250 * MS) < 2 * MS for gap in apart) and len(apart) >= 6, f"heartbeats are {apart} ns apart")
    _asks(pe, Service.TIS, NODE, DataType.SHORT2, (own, 0))
    pe.run(5)
    began_ns = pe.run(2000)
    equal(pe.main.since(began_ns, [own]), [], "heartbeats after an interval of 0")


def it_says_its_state_when_asked_but_not_at_any_rate() -> None:
    """The PE sends both pages, immediately or at its place; however many requests come, once in a heartbeat period."""
    pe = PeUnderTest().attended()
    pe.run(100)
    for node, after_ms in ((NODE, 0), (BROADCAST, _PLACE_MS), (NEIGHBOUR, None)):
        began_ns = _asks(pe, Service.STS, node, DataType.NODATA)
        pe.run(8)
        said = moments(pe.pages_0(began_ns)), moments(pe.pages_1(began_ns))
        equal([len(one) for one in said], 2 * [0 if after_ms is None else 1], f"pages after STS {node}")
        late_ns = [t_ns - began_ns - (after_ms or 0) * MS for times in said for t_ns in times]
        demand(all(0 < one < MS for one in late_ns), f"STS of {node} is answered {late_ns} ns late")
        equal(_answers(pe, began_ns), [], "answers to STS")
    pe.run(100)
    began_ns = pe.now_ns
    for _ in range(100):
        pe.main.say(encode_service(request(Service.STS, NODE)))
        pe.run(2)
    demand(9 <= len(pe.pages_1(began_ns)) <= 12, f"{len(pe.pages_1(began_ns))} pages 1 in 200 ms")


def other_services_are_not_answered() -> None:
    """Such services are not counted, either; malformed requests are."""
    pe = PeUnderTest().attended()
    before = pe.object(COUNTERS, 1)
    for service in (Service.FPS, Service.BSS, 77):
        began_ns = _asks(pe, service, NODE, DataType.NODATA)
        pe.run(5)
        equal(_answers(pe, began_ns), [], f"answers to service {service}")
    equal(pe.object(COUNTERS, 1), before, "counted after services that it has not")
    pe.main.say(Frame(_REQUEST_ID, b"\x5d"))
    pe.run(5)
    equal(pe.object(COUNTERS, 1), before + 1, "counted after what is malformed")


def its_objects_name_the_modes() -> None:
    """The objects name the mode in which each module runs; for a module that does not run they are empty."""
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    pe.flies(EVERYTHING)
    for module, mode in ((CONTROL, b"fine"), (SERVO, b"only")):
        equal(pe.object(MODULE_MODES, module + 1), int.from_bytes(mode, "little"), f"mode of module {module}")
    client = Client(PeUnderTest())
    answers = client.asks(f"40 {MODULE_MODES.to_bytes(2, 'little').hex()} {CONTROL + 1:02x}")
    equal([(data[0], data[4:]) for data in answers], [(0x41, bytes(4))], "mode of a module that does not run")


def a_table_needs_its_seal() -> None:
    """With a key the table needs a seal for this start, and must be the present table. Without a key it needs none."""
    plain = PeUnderTest()
    plain.run(30)
    equal(Client(plain).writes_table(plain.table.to_json().encode()), None, "why its own table is refused")
    equal(Client(plain).writes_table(b"{}"), _REFUSED, "why what is no table is refused")
    keyed = Keyed()
    keyed.run(25)
    keyed.attended()
    keyed.lease = keyed.alive = None
    keyed.main.command(Control(5, NODE, Operation.UNLOCK, 30))
    keyed.run(150)
    table = keyed.table.to_json().encode()
    client = Client(keyed)
    ((_, challenge),) = [(data[:4], int.from_bytes(data[4:], "little")) for data in client.asks("40 24 20 00")]
    for wrong in (table, OTHER_KEY.sealed(table, challenge), KEY.sealed(table, challenge ^ 1)):
        equal(client.writes_table(wrong), _REFUSED, "why a table is refused")
    equal(client.writes_table(KEY.sealed(table, challenge)), None, "why the table with its seal is refused")
    equal(len(keyed.notes("table")), 3, "notes of tables that were refused")
