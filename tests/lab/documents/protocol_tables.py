"""The protocol, from the tables that the codecs use: identifiers, messages and their fields, times."""

from collections.abc import Iterator
from itertools import groupby

from heronry_agent.core.forwarding import CAPACITY
from heronry_manager.core.epochs import EPOCHS_PER_TERM
from heronry_wire import (
    canopen_objects,
    capacities,
    checkpoint_frames,
    gateway_report,
    link,
    management,
    state_frames,
    transmit_queue,
)
from heronry_wire import protocol_times as promised
from heronry_wire.canaerospace import HEADER_BYTES, DataType
from heronry_wire.frame import STANDARD_MASK
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER, Command, Meaning, Use, classify, management_id
from heronry_wire.layout import Layout
from heronry_wire.timing import worst_bits
from lab.documents.markdown import code, table

_USES = {
    Use.NMT: "CANopen NMT: executed by a PE that runs nothing and hears no manager",
    Use.EMERGENCY_EVENT: "CANaerospace emergency event of node n: a fault that is flight-critical",
    Use.NODE_SERVICE: "CANaerospace node services; answered on channel 0 (128 asks, 129 answers)",
    Use.MANAGEMENT: "management, of manager",
    Use.EMCY: "CANopen EMCY of node n: a fault",
    Use.TIME: "CANopen TIME: left free for it",
    Use.STATE: "state of PE n",
    Use.GATEWAY: "gateways: the condition of a radio",
    Use.STANDARD_DATA: "data with a standard CANaerospace identifier",
    Use.SDO_RESPONSE: "CANopen SDO, answer of PE n",
    Use.SDO_REQUEST: "CANopen SDO, request to PE n",
    Use.ALLOCATED_DATA: "data, allocated",
    Use.HEARTBEAT: "CANopen heartbeat of node n",
    Use.ACTUATOR_ECHO: "output echo of PE n",
    Use.CHECKPOINT: "checkpoints of PE n",
    Use.BULK: "bulk and debug; not used yet",
    Use.UNASSIGNED: "not assigned",
}
_LAYOUTS = {
    Command.LEASE: (management.LEASE,),
    Command.ALIVE: (management.ALIVE,),
    Command.PREPARE: (management.PREPARE,),
    Command.SLICE: (management.SLICE_HEAD, management.SLICE_BODY),
    Command.ACTIVATE: (management.ACTIVATE,),
    Command.PING: (management.PING,),
    Command.CONTROL: (management.CONTROL,),
    Command.TAG: (management.TAG,),
}
_REPORTS = (
    *(state_frames.STATE_0, state_frames.STATE_1, state_frames.STATE_2, state_frames.STATE_3),
    *(management.EMCY, gateway_report.LINK, checkpoint_frames.HEAD, checkpoint_frames.PART),
)
_PAGES = (state_frames.STATE_0, state_frames.STATE_1, state_frames.STATE_2, state_frames.STATE_3)
_OWN_OBJECTS, _OWN_CODES = range(0x2000, 0x6000), range(0xFF00, 0x10000)  # CiA 301: the manufacturer's
_MOST_BYTES = 8


def identifiers() -> str:
    """Return every 11-bit identifier, in runs of one meaning."""
    runs = groupby(range(STANDARD_MASK + 1), key=lambda can_id: _kind(can_id, classify(can_id)))
    rows = []
    for (use, manager, base), run in runs:
        ids = list(run)
        number = "" if base is None else "n" if base == 0 else f"{base} + n"
        what = _USES[use] if manager is None else f"{_USES[use]} {manager}"
        rows.append([_span(ids[0], ids[-1]), _span(ids[0], ids[-1], "03X"), number, what])
    return table(["identifiers", "hexadecimal", "of node n", "what for"], rows)


def _kind(can_id: int, meaning: Meaning) -> tuple[Use, int | None, int | None]:
    if meaning.use is Use.MANAGEMENT:
        return meaning.use, meaning.node_id, None
    return meaning.use, None, None if meaning.node_id is None else can_id - meaning.node_id


def _span(first: int, last: int, form: str = "d") -> str:
    return f"{first:{form}}" if first == last else f"{first:{form}}..{last:{form}}"


def data_types() -> str:
    """Return every data type, the length of its payload, and that of its longest frame."""
    rows = []
    for size, members in groupby(sorted(DataType, key=lambda t: (t.payload_bytes, t)), key=lambda t: t.payload_bytes):
        names = ", ".join(f"{code(member.name)} {member.value}" for member in members)
        rows.append([str(size), str(worst_bits(HEADER_BYTES + size)), names])
    return table(["payload, bytes", "longest frame, bits", "types and their codes"], rows)


def messages() -> str:
    """Return every command of a manager, and its identifiers."""
    rows = []
    for command, layouts in _LAYOUTS.items():
        lengths = " or ".join(dict.fromkeys(f"{layout.length}" for layout in layouts))
        ids = [str(management_id(manager, command)) for manager in (FIRST_MANAGER, LAST_MANAGER)]
        rows.append([command.name, *ids, lengths])
    return table(["message", f"of {FIRST_MANAGER}", f"of {LAST_MANAGER}", "bytes"], rows)


def fields() -> str:
    """Return every field of every message, in the order of transmission."""
    rows = [row for layout in _every_layout() for row in _fields(layout)]
    return table(["message", "bytes", "field", "bits", "values"], rows)


def room() -> str:
    """Return how much of each place by which the protocol may grow is used, and how much is free."""
    own = [entry.index for entry in canopen_objects.OBJECTS if entry.index in _OWN_OBJECTS]
    first, last = f"{_OWN_OBJECTS[0]:X}h", f"{_OWN_OBJECTS[-1]:X}h"
    codes = sum(fault >= _OWN_CODES[0] for fault in management.FaultCode)
    places = [
        ("pages of a state frame", len(_PAGES), 1 << _bits(state_frames.STATE_0, "page")),
        ("flags in a state frame", len(state_frames.PeFlags), _bits(state_frames.STATE_0, "flags")),
        ("kinds of TAG", *_labelled(management.TAG, "kind")),
        ("values of `state`", *_labelled(state_frames.STATE_0, "state")),
        ("values of `step`", *_labelled(management.LEASE, "step")),
        ("values of `reason`", *_labelled(state_frames.STATE_1, "reason")),
        ("operations of CONTROL", *_labelled(management.CONTROL, "operation")),
        ("kinds of elements in EMCY, CLEAR and HOLDS", *_labelled(management.EMCY, "kind")),
        ("manufacturer's codes of EMCY, FF00h to FFFFh", codes, len(_OWN_CODES)),
        (f"CANopen objects, {first} to {last}", len(own), len(_OWN_OBJECTS)),
        (
            "management identifiers of a manager",
            len(Command),
            management_id(LAST_MANAGER, Command.LEASE) - management_id(FIRST_MANAGER, Command.LEASE),
        ),
    ]
    spare = sum(field.bits for layout in _every_layout() for field in layout.fields if field.name == "spare")
    rows = [[what, str(used), str(of - used)] for what, used, of in places]
    full = [layout for layout in _every_layout() if layout.length == _MOST_BYTES and "spare" not in _names(layout)]
    rows.append(
        [
            f"layouts of messages ({len(full)} of {len(_every_layout())} are full)",
            "",
            f"{spare} spare bits in ALIVE, 4 bytes in PING",
        ]
    )
    return table(["place", "used", "free"], rows)


def _labelled(layout: Layout, name: str) -> tuple[int, int]:
    """Return how many values of a field have a meaning, and how many the field can hold."""
    (labels,) = (field.labels for field in layout.fields if field.name == name)
    return len(labels or {}), 1 << _bits(layout, name)


def _bits(layout: Layout, name: str) -> int:
    (bits,) = (field.bits for field in layout.fields if field.name == name)
    return bits


def _every_layout() -> list[Layout]:
    return [*(layout for ours in _LAYOUTS.values() for layout in ours), *_REPORTS]


def _names(layout: Layout) -> set[str]:
    return {field.name for field in layout.fields}


def _fields(layout: Layout) -> Iterator[list[str]]:
    at, name = 0, code(layout.name)
    for field in layout.fields:
        end = at + field.bits - 1
        if at % 8 or (end + 1) % 8:
            place = f"{at // 8}.{7 - at % 8}..{end // 8}.{7 - end % 8}"
        else:
            place = _span(at // 8, end // 8)
        labels = ", ".join(f"{value} {label}" for value, label in (field.labels or {}).items())
        yield [name, place, field.name, str(field.bits), labels or field.unit]
        at, name = end + 1, ""


def times() -> str:
    """Return every time and number of the protocol that a spec does not set."""
    periods = "heartbeat periods"
    rows = [
        (
            "T_lease",
            f"{promised.LEASE_PERIODS} {periods}",
            "how long a PE may drive an exclusive output without hearing another node",
        ),
        (
            "listening",
            f"{promised.LEASE_PERIODS} {periods}",
            "how long a manager listens before it sends its first frame",
        ),
        (
            "start-up window",
            _time(promised.START_UP_WINDOW_NS),
            "how long a manager waits for PEs that it has not heard",
        ),
        (
            "hold-down",
            f"{promised.HOLD_DOWN_PERIODS} {periods}",
            "how long a PE must be heard without a gap before it is available again",
        ),
        ("longest hold-down", _time(promised.LONGEST_HOLD_DOWN_NS), "a hold-down doubles with each loss, up to this"),
        (
            "forgiveness",
            _time(promised.FORGIVEN_AFTER_NS),
            "how long a PE must be available before its losses are forgiven, and a module run before its restarts are",
        ),
        (
            "patience",
            f"{promised.PATIENCE_PERIODS} {periods}",
            "how long the manager waits for one answer before it declares the PE failed",
        ),
        ("planning again", _time(promised.PLAN_AGAIN_NS), "until the next request, after the planner has failed"),
        (
            "page 1",
            f"every {promised.STATE_PAGE_1_EVERY}th page 0",
            "and whenever a configuration was staged or refused",
        ),
        (
            "CANopen heartbeat",
            _time(canopen_objects.HEARTBEAT_MS * 1_000_000),
            "of a PE; a write to object 1017h changes it",
        ),
        ("CANopen heartbeat", _time(promised.CANOPEN_HEARTBEAT_NS), "of a manager"),
        (
            "quiet",
            _time(promised.FAULT_QUIET_NS),
            "how long a PE does not report an acknowledged fault that is found again",
        ),
        (
            "freshness",
            f"{promised.FRESH_PERIODS} periods of the source",
            "greatest age of an input at the start of a step; an older input is absent",
        ),
        (
            "silence",
            f"{promised.SILENT_PERIODS} periods of the source, at least T_lease",
            "how long an input may have no datum until its PE reports it; of an output, periods of its module",
        ),
        (
            "echo",
            _time(link.ECHO_TIMEOUT_NS),
            "how long a sender waits for the echo of a frame before it sends the next one",
        ),
        ("retry", _time(link.RETRY_NS), "until the next attempt to send, when the queue of the controller is full"),
        (
            "transmit queue",
            f"{transmit_queue.CAPACITY} frames",
            "per bus; if it is full, the least urgent frame is dropped",
        ),
        (
            "radio queue",
            f"{CAPACITY} frames",
            "at a gateway; if it is full, the least urgent frame is dropped",
        ),
        (
            "measure of a radio",
            f"{promised.RADIO_WINDOW_PERIODS} {periods} of it",
            "over which the usable share is measured; the last two periods alone, if they are far worse",
        ),
        ("slice", f"{capacities.MOST_SLICE_BYTES} bytes", "the longest slice of a PE"),
        ("term", f"{management.MAX_TERM}", "the highest term"),
        (
            "epochs",
            f"{EPOCHS_PER_TERM} in a block",
            "term t starts with block t - 1, and takes every second block",
        ),
    ]
    return table(["name", "value", "what it is"], rows)


def _time(ns: int) -> str:
    return f"{ns // 1_000_000_000} s" if ns % 1_000_000_000 == 0 else f"{ns // 1_000_000} ms"
