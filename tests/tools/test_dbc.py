"""The DBC agrees with the codecs: cantools reads every kind of frame on the bus, field by field."""

from pathlib import Path

import cantools
import pytest
from cantools.database import Database

from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.traffic import identifiers
from heronry_tools.reports.dbc import dbc_text
from heronry_wire import management, state_frames
from heronry_wire.canaerospace import (
    DataType,
    Datum,
    ErrorReport,
    Status,
    Validity,
    encode_data,
    encode_emergency_event,
    pack_status,
)
from heronry_wire.identifiers import Command, actuator_echo_id, emcy_id, heartbeat_id, management_id, state_id
from heronry_wire.layout import Layout
from heronry_wire.management import (
    Activate,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    Ping,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
)
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1

SHIPPED = ["elevator_and_chute", "big_blue"]


def database_of(name: str) -> tuple[Spec, Database]:
    spec = load(Path(f"dg_specs/{name}.dg.yaml"))
    return spec, cantools.database.load_string(dbc_text(spec), "dbc")


@pytest.fixture(scope="module")
def database() -> Database:
    return database_of("elevator_and_chute")[1]


@pytest.mark.parametrize(
    ("command", "message", "expected"),
    [
        (Command.LEASE, Lease(3, 7, Step.GO, 0xABCDEF), {"term": 3, "epoch": 7, "step": "GO", "digest": 0xABCDEF}),
        (Command.ALIVE, Alive(3, 9, frozenset({92, 125})), {"term": 3, "sequence": 9, "alive": 1 << 33 | 1}),
        (Command.PREPARE, Prepare(3, 7, 0xABCDEF, 9), {"term": 3, "contingency": 9, "epoch": 7, "digest": 0xABCDEF}),
        (Command.SLICE, SliceHead(93, 7, 40, 5), {"node": 93, "epoch_low": 7, "index": 0, "length": 40, "digest": 5}),
        (Command.SLICE, SliceBody(93, 7, 255, b"\0\0\0\0\5"), {"node": 93, "epoch_low": 7, "index": 255, "body": 5}),
        (Command.ACTIVATE, Activate(1, 2, Step.BREAK, 3), {"term": 1, "epoch": 2, "step": "BREAK", "digest": 3}),
        (Command.PING, Ping(1, 93, 4), {"term": 1, "node": 93, "sequence": 4}),
        (
            Command.CONTROL,
            Control(1, 93, Operation.ACKNOWLEDGE, 2, 5),
            {"term": 1, "node": 93, "operation": "ACKNOWLEDGE", "a": 2, "b": 5},
        ),
    ],
)
def test_management_is_read_by_field(
    database: Database,
    command: Command,
    message: Lease | Alive | Prepare | SliceHead | SliceBody | Activate | Ping | Control,
    expected: dict[str, object],
) -> None:
    for manager in (126, 127):
        read = database.decode_message(management_id(manager, command), message.encode())
        assert {key: read[key] for key in expected} == expected
        assert read.keys() - expected.keys() <= {"spare"}


def test_both_pages_of_a_state_are_read_by_field(database: Database) -> None:
    page_0 = StatePage0(PeState.ACTIVE, PeFlags.HEARS_LEASE, 4, 5, 6, 7).encode()
    page_1 = StatePage1(PeState.BROKEN, PeFlags(0), 8, 9, Reason.IMAGE, 50).encode()
    assert database.decode_message(state_id(92), page_0) == {
        "page": 0, "state": "ACTIVE", "flags": 1, "incarnation": 4, "epoch": 5, "sequence": 6, "digest": 7,
    }  # fmt: skip
    assert database.decode_message(state_id(92), page_1) == {
        "page": 1, "state": "BROKEN", "flags": 0, "staged_epoch": 8, "staged_digest": 9, "reason": "IMAGE", "load": 50,
    }  # fmt: skip


def test_faults_heartbeats_and_echoes_are_read(database: Database) -> None:
    fault = Emergency(FaultCode.REPORTED, 1, ElementKind.DEVICE, 3, 44).encode()
    read = database.decode_message(emcy_id(94), fault)
    assert (read["code_high"] << 8 | read["code_low"], read["kind"], read["index"]) == (0xFF03, "DEVICE", 3)
    event = encode_emergency_event(94, ErrorReport(FaultCode.REPORTED - 0x10000, ElementKind.DEVICE, 3))
    read = database.decode_message(event.can_id, event.data)
    assert (read["node_id"], read["error_code"], read["operation_id"], read["location_id"]) == (94, -253, "DEVICE", 3)
    for node in (94, 126, 127):
        assert database.decode_message(heartbeat_id(node), b"\x05") == {"canopen_state": "OPERATIONAL"}
    echo = encode_data(actuator_echo_id(94), Datum(94, DataType.FLOAT, 3, 1, -2.5))
    read = database.decode_message(echo.can_id, echo.data)
    assert (read["device"], read["value"]) == ("elevator_servo_1", -2.5)
    echo = encode_data(actuator_echo_id(93), Datum(93, DataType.ULONG, 0, 1, 10))
    read = database.decode_message(echo.can_id, echo.data)
    assert (read["module"], read["mode"]) == ("servo_monitor", 0)


@pytest.mark.parametrize("name", SHIPPED)
def test_every_datum_of_a_spec_is_read_by_name_and_unit(name: str) -> None:
    spec, database = database_of(name)
    for (producer, variable), identifier in identifiers(spec).items():
        message = database.get_message_by_frame_id(identifier)
        assert message.name == f"{variable}__{producer}"
        kind = DataType[spec.variables[variable].type]
        assert message.length == 4 + kind.payload_bytes
        if kind is DataType.FLOAT:
            assert message.get_signal_by_name(variable).unit == spec.variables[variable].unit
            datum = Datum(93, kind, pack_status(Status(2, Validity.VALID)), 200, 1.5)
            read = message.decode(encode_data(identifier, datum).data)
            assert read == {
                "node_id": 93, "data_type": "FLOAT", "validity": "VALID", "version": 2, "message_code": 200,
                variable: 1.5,
            }  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "value", "signals"),
    [
        (DataType.SHORT2, (-2, 3), {"v_0": -2, "v_1": 3}),
        (DataType.UCHAR4, (1, 2, 3, 255), {"v_0": 1, "v_1": 2, "v_2": 3, "v_3": 255}),
        (DataType.LONG, -5, {"v": -5}),
        (DataType.USHORT, 65535, {"v": 65535}),
        (DataType.CHAR, -128, {"v": -128}),
        (DataType.NODATA, None, {}),
    ],
)
def test_values_of_every_shape_are_read(kind: DataType, value: object, signals: dict[str, int]) -> None:
    text = Path("dg_specs/elevator_and_chute.dg.yaml").read_text()
    file = text.replace("servo_failure: {type: UCHAR}", f"v: {{type: {kind.name}}}").replace("servo_failure", "v")
    spec = loads(file, "one_value.dg.yaml")
    database = cantools.database.load_string(dbc_text(spec), "dbc")
    frame = encode_data(identifiers(spec)["servo_monitor", "v"], Datum(94, kind, 17, 0, value))  # type: ignore[arg-type]
    read = database.decode_message(frame.can_id, frame.data)
    assert {key: read[key] for key in read if key.startswith("v_") or key == "v"} == signals


def test_every_layout_of_the_protocol_is_in_the_dbc(database: Database) -> None:
    named = {**vars(management), **vars(state_frames)}
    layouts = [value for name, value in named.items() if isinstance(value, Layout) and not name.startswith("_")]
    assert len(layouts) == 14
    names = {signal.name for message in database.messages for signal in message.signals}
    assert {field.name for layout in layouts for field in layout.fields} <= names


def test_the_shipped_dbc_is_the_one_the_tables_give() -> None:
    assert Path("dbc/management.dbc").read_text() == dbc_text(None), "write it anew: heronry dbc -o dbc/management.dbc"
