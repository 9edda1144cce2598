"""Every decoder of bytes that another program may have written: from a bus, a socket, a file or another process.

Malformed bytes give a value, or an error of the one kind that is caught here. A decoded value that can be encoded again
is encoded, and must decode to the same value. Left out are netlink (`can_interface`), which only the kernel writes, and
orders to a partition, which only its own agent writes.
"""

import hashlib
import math
import os
import zlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from fractions import Fraction
from functools import cache, partial
from itertools import chain
from pathlib import Path
from typing import TypeVar

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.vocabulary import StateEvent, StateLacking, StateRestored, StateSaved, StateUnused
from heronry_agent.shell.module_runner import Result
from heronry_agent.shell.partition_messages import (
    Done,
    Failed,
    Garbled,
    Loaded,
    StartRefused,
    decode_answer,
    encode_answer,
)
from heronry_dg.findings import SpecError
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.plan import PlanError, read_plan
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_manager.contingency.file_format import ContingencyFileError, from_bytes, to_bytes
from heronry_manager.core.memory import Latched, Memory, Quarantined, Runs, as_json
from heronry_manager.core.tables import Compiler
from heronry_manager.core.vocabulary import AskStatus, UnlockPe
from heronry_manager.planner import messages
from heronry_manager.shell import control_protocol
from heronry_manager.shell.journal import recovered, whole_journal, written
from heronry_tools.console.errors import UserError
from heronry_tools.runtime.softbus import protocol as softbus
from heronry_tools.sim.faults.fault import read_fault
from heronry_tools.sim.world.planning import best_plan, plan_ahead
from heronry_wire.canaerospace import DataType, Datum, decode_data, encode_data
from heronry_wire.checkpoint_frames import Assembly, Lack, SentState
from heronry_wire.configuration_slice import ModuleSlice, Slice, SliceError, decode_slice
from heronry_wire.contingency_block import Preloaded, read_block, write_block
from heronry_wire.controller import read_error_frame
from heronry_wire.frame import Frame, LoggedFrame, Malformed, format_frame, format_log_line, parse_frame, parse_log_line
from heronry_wire.gateway_report import LinkReport, LinkState, decode_link
from heronry_wire.identification import REQUEST_ID
from heronry_wire.key_file import KeyFileError, read_key
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
    decode_command,
    decode_emergency,
)
from heronry_wire.node_services import ServiceMessage, decode_service, read_identification
from heronry_wire.packing import PackingError
from heronry_wire.pe_table import PeTable, TableError
from heronry_wire.sansio import Tick
from heronry_wire.state_frames import (
    PeFlags,
    PeState,
    Reason,
    StatePage0,
    StatePage1,
    StatePage2,
    StatePage3,
    decode_state,
)
from lab.fuzz.target import Story, Target

_T = TypeVar("_T")
_START_NS, _BEATS = 1_000_000_000, 20


@cache
def spec() -> Spec:
    """Return the spec of all targets: a small shipped one."""
    return load(shipped_spec_path("elevator_and_chute"))


@cache
def table() -> PeTable:
    """Return the table of the spec's first PE."""
    return Compiler(spec()).table(next(iter(spec().pes)))


def same(read: _T, again: object) -> None:
    """Check that a value which was read, written and read again is the same; raises AssertionError."""
    if read != again:
        raise AssertionError(f"{read!r} was written and read again as {again!r}")


# Frames

_COMMANDS = (
    Lease(3, 7, Step.BREAK, 0xABCDEF),
    Alive(3, 9, frozenset({92, 125})),
    Prepare(3, 7, 0xABCDEF, 4095),
    SliceHead(92, 7, 30, 0xABCDEF),
    SliceBody(92, 7, 1, b"12345"),
    Activate(3, 7, Step.GO_ALL, 0xABCDEF),
    Ping(3, 92, 1),
    Control(3, 92, Operation.WELCOME, 1, 2),
)
_PAGES = (
    StatePage0(PeState.ACTIVE, PeFlags.HEARS_LEASE, 1, 7, 9, 0xABCDEF),
    StatePage1(PeState.BROKEN, PeFlags(0), 7, 0xABCDEF, Reason.INCOMPLETE, 50),
    StatePage2(PeState.UNCONFIGURED, PeFlags(0), 1 << 55),
    StatePage3(PeState.PARTIAL, PeFlags.OUTPUT_HELD, 0xABCDEF, 1, 2),
)


def _command(data: bytes) -> None:
    """Decode a command: one byte for the kind, then the payload."""
    kind = data[0] % 10 if data else 0
    message = decode_command(kind, data[1:])
    if not isinstance(message, Malformed):
        same(message, decode_command(kind, message.encode()))


def _state(data: bytes) -> None:
    page = decode_state(data)
    if not isinstance(page, Malformed):
        same(page, decode_state(page.encode()))


def _emergency(data: bytes) -> None:
    emergency = decode_emergency(data)
    if not isinstance(emergency, Malformed):
        same(emergency, decode_emergency(emergency.encode()))


def _checkpoint(data: bytes) -> None:
    """Frames of 8 bytes, one after the other; what is whole has the bytes that one sender would send."""
    assembly = Assembly(1_000)
    for at in range(0, len(data), 8):
        state = assembly.take(data[at : at + 8], at)
        if state is not None:
            whole = Assembly(1_000)
            same(state, [whole.take(frame.data, 0) for frame in state.frames(92)][-1])


def _link(data: bytes) -> None:
    report = decode_link(data)
    if not isinstance(report, Malformed):
        same(report, decode_link(report.encode()))


def _frame(data: bytes) -> None:
    """Decode data, node services or an error frame: two bytes of identifier, one of its kind, then the payload."""
    story = Story(data)
    frame = Frame(story.number(0x800), b"", extended=bool(story.number(16) == 1))._replace(data=story.bytes(8))
    datum = decode_data(frame)
    if isinstance(datum, Datum):
        _comes_back(frame, datum)
    message = decode_service(frame)
    if isinstance(message, ServiceMessage):
        read_identification(message)
    read_error_frame(frame._replace(error=True))


def _comes_back(frame: Frame, datum: Datum) -> None:
    """Check that a datum of a known type is written as it was read, and that an unknown type is reported as unknown."""
    is_number = not (isinstance(datum.value, float) and math.isnan(datum.value))
    if isinstance(datum.data_type, DataType) and is_number:
        same(frame.data, encode_data(frame.can_id, datum).data)


def _text_of_frames(data: bytes) -> None:
    text = data.decode("ascii", "replace")
    frame, logged = parse_frame(text), parse_log_line(text)
    if isinstance(frame, Frame):
        same(frame, parse_frame(format_frame(frame)))
    if isinstance(logged, LoggedFrame):
        same(logged, parse_log_line(format_log_line(logged)))


# Slices, contingencies, tables and keys, which a PE receives

_SLICE = Slice((ModuleSlice(0, 0, ()),), remote={0: 92}, publish={1: 1}, forward={2: (93, 2)})


def _slice(data: bytes) -> None:
    with suppress(SliceError):
        same(data, decode_slice(data, table().leaf_counts()).encode())


def _block(data: bytes) -> None:
    with suppress(PackingError):
        held = read_block(data)
        same(held, read_block(write_block(held)))


def _table(data: bytes) -> None:
    """Read a table; an accepted table must let a node start, and run for some periods."""
    try:
        read = PeTable.from_json(data.decode())
        TableIndex(read)
    except (TableError, UnicodeDecodeError):
        return
    same(read, PeTable.from_json(read.to_json()))
    core = AgentCore(read, 1, _START_NS)
    for _ in range(_BEATS):
        core.step(core.next_deadline_ns(), Tick())
        core.validate()


def _key(data: bytes) -> None:
    file = os.memfd_create("key")
    try:
        os.fchmod(file, 0o600)
        os.write(file, data)
        with suppress(KeyFileError):
            read_key(Path(f"/proc/self/fd/{file}"))
    finally:
        os.close(file)


# Messages of partitions and planners


def _partition(data: bytes) -> None:
    answer = decode_answer(data)
    if not isinstance(answer, Garbled):
        again = encode_answer(answer)
        same(again, encode_answer(_answered(again)))


def _answered(packet: bytes) -> Loaded | StartRefused | Done | Failed | StateEvent:
    match decode_answer(packet):
        case Garbled(reason):
            raise AssertionError(f"an encoded answer cannot be decoded: {reason}")
        case answer:
            return answer


def _planner(data: bytes) -> None:
    with suppress(messages.MessageError):
        messages.read_answer(data)
    with suppress(messages.MessageError):
        request = messages.read_request(data, spec())
        same(request, messages.read_request(messages.request_line(request), spec()))


def _plan(data: bytes) -> None:
    with suppress(PlanError, UnicodeDecodeError):
        read_plan(data.decode(), spec())


# Files, and texts of users


def _journal(data: bytes) -> None:
    """Read the lines as they are, and with corrected checksums."""
    lines = (line.partition(b" ")[2] for line in data.split(b"\n"))
    for text in (data, b"".join(b"%08x %s\n" % (zlib.crc32(line), line) for line in lines)):
        memory, _ = recovered(text)
        same(memory, recovered(whole_journal(spec(), memory))[0])


def _contingencies(data: bytes) -> None:
    """Read the bytes as the content of a file, packed here: otherwise only the checksum would be tested."""
    for file in (data, _contingency_file(data)):
        with suppress(ContingencyFileError):
            made = from_bytes(file, spec())
            same(made, from_bytes(to_bytes(made, spec()), spec()))


def _contingency_file(body: bytes) -> bytes:
    head = b"HERONRY\1" + bytes.fromhex(spec().digest) + len(body).to_bytes(4, "big")
    content = head + zlib.compress(body)
    return content + hashlib.sha256(content).digest()


def _contingency_body() -> bytes:
    file = to_bytes(plan_ahead(spec(), 0), spec())
    return zlib.decompress(file[len(_contingency_file(b"")) - len(zlib.compress(b"")) - 32 : -32])


def _spec(data: bytes) -> None:
    with suppress(SpecError):
        loads(data.decode("utf-8", "replace"), "fuzzed.dg.yaml")


def _fault(data: bytes) -> None:
    with suppress(UserError):
        fault = read_fault(spec(), data.decode("utf-8", "replace"))
        same(fault, read_fault(spec(), str(fault)))


def _order(data: bytes) -> None:
    order = control_protocol.read_order(data)
    if not isinstance(order, str):
        same(order, control_protocol.read_order(control_protocol.order_line(order)))
    control_protocol.read_answer(data)


def _softbus(data: bytes) -> None:
    frame = softbus.decode_frame(data)
    if not isinstance(frame, Malformed):
        softbus.encode_frame(frame)
    command = softbus.decode_command(data)
    if isinstance(command, dict):
        softbus.decode_filters(command.get("filters"))


# Seeds


def _plan_text() -> bytes:
    return best_plan(spec(), Situation(frozenset({"device:gps"})), None).to_json().encode()


def _journal_text() -> bytes:
    latched = Latched("device:gps", "tail_pe", "REPORTED", 7)
    memory = Memory(3, {"epoch": 64}, Runs(7, 9, "00"), "cruise", {"device:gps": latched}, {"tail_pe": 2})
    return whole_journal(spec(), memory) + written(8, as_json(Quarantined("tail_pe", 3)))


def _round(state: bytes) -> bytes:
    return b"".join(frame.data for frame in SentState.of(1, 2, state, b"8 bytes.").frames(92))


def _packets() -> list[bytes]:
    result = Result({"a": 1.5, "b": (1, 2)}, (3, "four", b"five"), (("device:gps", 6),), ("landing",))
    said = (Loaded({"image": "missing"}), StartRefused(1, "why"), Failed(1, 2, "oops"), Done(1, 2, 3, result))
    saved, lacking = StateSaved(1, 2, b"8 bytes.", b"state", 3), StateLacking(1, Lack.HANGS, "why")
    return [encode_answer(one) for one in (*said, saved, lacking, StateRestored(1, 5), StateUnused(1))]


def _solution() -> messages.Solution:
    found = best_plan(spec(), Situation(frozenset({"device:gps"})), None)
    return messages.Solution(1, found.configuration, found.objective, found.objective.key())


def _planner_lines() -> list[bytes]:
    situation = Situation(frozenset({"device:gps"}), {"bus:can0": Fraction(2, 5)}, None)
    request = messages.Request(1, situation, {"gps_driver": ("only", "sensor_pe")})
    answers: list[messages.Answer] = [messages.Ready(), _solution(), messages.Refusal(None, "no")]
    return [messages.request_line(request), *map(messages.answer_line, answers)]


def _target(name: str, run: Callable[[bytes], None], *seeds: Callable[[], Iterable[bytes]]) -> Target:
    return Target(name, run, lambda: chain.from_iterable(seed() for seed in seeds))


def _just(*seeds: bytes) -> Callable[[], Iterable[bytes]]:
    return partial(tuple, seeds)


DECODERS = (
    _target("command", _command, lambda: [bytes((kind,)) + one.encode() for one in _COMMANDS for kind in range(7)]),
    _target("state", _state, lambda: [page.encode() for page in _PAGES]),
    _target("emergency", _emergency, _just(Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 1, 57).encode())),
    _target("checkpoint", _checkpoint, lambda: [_round(b"state of a module"), _round(b"a")]),
    _target("link", _link, _just(LinkReport(92, LinkState.UP, 5, 800, 90, 3, 7).encode())),
    _target(
        "frame",
        _frame,
        _just(
            b"\x01\x2c\0\x5c\x02\x11\0\0\0\0\0",
            REQUEST_ID.to_bytes(2, "big") + b"\0\0\0\0\0",
            b"\x00\x44\0\0\0\0\x04\0\0\0\0",
        ),
    ),
    _target("candump", _text_of_frames, _just(b"(12.000345) can0 130#0102 R", b"130#R", b"1ABCDEF0#0102030405060708")),
    _target("slice", _slice, lambda: [_SLICE.encode()]),
    _target("block", _block, lambda: [write_block([Preloaded(b"a slice", 1), Preloaded(b"", 2)])]),
    _target("table", _table, lambda: [table().to_json().encode()]),
    _target("key", _key, _just(b"0123456789abcdef" * 4 + b"\n")),
    _target("partition", _partition, _packets),
    _target("planner", _planner, _planner_lines),
    _target("plan", _plan, lambda: [_plan_text()]),
    _target("journal", _journal, lambda: [_journal_text()]),
    _target("contingencies", _contingencies, lambda: [_contingency_body()]),
    _target("spec", _spec, lambda: [shipped_spec_path("elevator_and_chute").read_bytes()]),
    _target("act", _fault, _just(b"2.013 pause pe:tail_pe for 0.3 in preparing", b"1 loss bus:can0 level 10")),
    _target(
        "order",
        _order,
        lambda: [control_protocol.order_line(AskStatus()), control_protocol.order_line(UnlockPe("pe:tail_pe"))],
        lambda: [control_protocol.answer_line(control_protocol.Answer(True, "done", {}))],
    ),
    _target(
        "softbus",
        _softbus,
        lambda: [softbus.encode_frame(softbus.BusFrame(Frame(300, b"12345678"), 8, 1))],
        _just(b'{"do":"filter","filters":[[300,2047,false],[0,0,null]]}'),
    ),
)
