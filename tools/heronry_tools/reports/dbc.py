"""Makes a DBC, which gives cantools, SavvyCAN and other tools names and units for the frames on a bus.

With a spec, the DBC has the data frames: one for each variable and producer, with the unit and the header of
CANaerospace. It also has the names of declared foreign frames. With or without a spec, it describes every field of
management frames, states, EMCY, heartbeats and output echoes. These fields come from the tables that the codecs use
(`heronry_wire.management`, `heronry_wire.canaerospace`), so the DBC cannot differ from the codecs.

In three kinds of frames the fields vary. A DBC can express this only if one field multiplexes the others:

    frame          multiplexed by    variants
    SLICE          index             two: index 0, and every other index
    state frame    page              four
    output echo    type              two
"""

from collections import OrderedDict
from collections.abc import Collection, Iterator, Mapping

from cantools.database import Database, Message, Signal
from cantools.database.can import Node
from cantools.database.conversion import BaseConversion
from cantools.database.namedsignalvalue import NamedSignalValue

from heronry_dg.losses import receivers
from heronry_dg.model import Spec
from heronry_dg.traffic import identifiers
from heronry_dg.uplinks import radios
from heronry_wire.canaerospace import HEADER_BYTES, DataType, Validity
from heronry_wire.checkpoint_frames import HEAD, PART
from heronry_wire.gateway_report import LINK, link_id
from heronry_wire.identifiers import (
    GATEWAY_IDS,
    MANAGER_NODES,
    PE_NODES,
    Command,
    actuator_echo_id,
    checkpoint_id,
    emcy_id,
    emergency_event_id,
    heartbeat_id,
    management_id,
    state_id,
)
from heronry_wire.layout import Layout
from heronry_wire.management import (
    ACTIVATE,
    ALIVE,
    CONTROL,
    EMCY,
    LEASE,
    PING,
    PREPARE,
    SLICE_BODY,
    SLICE_HEAD,
    TAG,
    ElementKind,
)
from heronry_wire.state_frames import IN_EVERY_PAGE, STATE_0, STATE_1, STATE_2, STATE_3

_TYPE_NAMES = {data_type.value: data_type.name for data_type in DataType}
_MOST_OF_A_RANGE = 256  # messages for one range of foreign identifiers
_COMMANDS: Mapping[Command, Layout] = {
    Command.LEASE: LEASE,
    Command.ALIVE: ALIVE,
    Command.PREPARE: PREPARE,
    Command.ACTIVATE: ACTIVATE,
    Command.PING: PING,
    Command.CONTROL: CONTROL,
    Command.TAG: TAG,
}


def dbc_text(spec: Spec | None) -> str:
    """Write a DBC of the management protocol; with a spec, it also has the names of the PEs and all data."""
    nodes = {node: f"node_{node}" for node in PE_NODES} if spec is None else _nodes_of(spec)
    messages = [*_management(), *_per_node(nodes, spec), *_links(spec)]
    if spec is not None:
        messages += _data(spec)
        messages += _foreign(spec, {message.frame_id for message in messages})
    senders = [*nodes.values(), *(f"manager_{node}" for node in MANAGER_NODES)]
    database = Database(messages=messages, nodes=[Node(name) for name in senders], version="")
    text: str = database.as_dbc_string()
    return text.replace("\r\n", "\n")


def _nodes_of(spec: Spec) -> dict[int, str]:
    return {pe.node_id: pe.name for pe in spec.pes.values()}


def _signal(
    name: str,
    start: int,
    bits: int,
    labels: Mapping[int, str] | None = None,
    *,
    signed: bool = False,
    is_float: bool = False,
    unit: str | None = None,
) -> Signal:
    """Make a big-endian signal that starts `start` bits after the first bit of the payload."""
    choices: OrderedDict[int, str | NamedSignalValue] | None = OrderedDict(labels) if labels else None
    conversion = BaseConversion.factory(scale=1, offset=0, choices=choices, is_float=is_float)
    first_bit = start // 8 * 8 + 7 - start % 8  # a DBC counts from the least significant bit of each byte
    return Signal(name, first_bit, bits, byte_order="big_endian", is_signed=signed, conversion=conversion, unit=unit)


def _signals(layout: Layout) -> Iterator[Signal]:
    start = 0
    for field in layout.fields:
        yield _signal(field.name, start, field.bits, field.labels, unit=field.unit or None)
        start += field.bits


def _message(frame_id: int, name: str, length: int, signals: list[Signal], sender: str) -> Message:
    return Message(frame_id, name, length, signals, senders=[sender] if sender else [], strict=False)


def _management() -> Iterator[Message]:
    for node in MANAGER_NODES:
        for command, layout in _COMMANDS.items():
            name = f"{command.name}_{node}"
            yield _message(management_id(node, command), name, layout.length, list(_signals(layout)), f"manager_{node}")
        slices = list(_split(SLICE_HEAD, SLICE_BODY, "index"))
        yield _message(management_id(node, Command.SLICE), f"SLICE_{node}", 8, slices, f"manager_{node}")
        yield _heartbeat(node, f"manager_{node}")


def _split(first: Layout, others: Layout, number: str) -> Iterator[Signal]:
    """Yield the signals of what takes several frames; the third field, `number`, is 0 in the first of them."""
    head, body = list(_signals(first)), list(_signals(others))
    for signal in head[:3]:
        signal.is_multiplexer = signal.name == number
        yield signal
    for signal, indices in [*((s, [0]) for s in head[3:]), (body[3], list(range(1, 256)))]:
        signal.multiplexer_ids, signal.multiplexer_signal = indices, number
        yield signal


def _per_node(nodes: Mapping[int, str], spec: Spec | None) -> Iterator[Message]:
    for node, name in nodes.items():
        yield _message(state_id(node), f"STATE_{name}", 8, list(_state()), name)
        yield _message(emcy_id(node), f"EMCY_{name}", EMCY.length, list(_signals(EMCY)), name)
        yield _message(emergency_event_id(node), f"EMERGENCY_{name}", 8, list(_emergency_event()), name)
        yield _heartbeat(node, name)
        yield _message(actuator_echo_id(node), f"ECHO_{name}", 8, list(_echo(spec)), name)
        if spec is None or f"pe:{name}" in receivers(spec):
            yield _message(
                checkpoint_id(node), f"CHECKPOINT_{name}", HEAD.length, list(_split(HEAD, PART, "frame")), name
            )


def _links(spec: Spec | None) -> Iterator[Message]:
    """Write a LINK message for each radio of a spec; without a spec, one for each LINK identifier."""
    if spec is None:
        for number in range(len(GATEWAY_IDS)):
            yield _message(link_id(number), f"LINK_{number}", LINK.length, list(_signals(LINK)), "")
        return
    for radio in radios(spec).values():
        yield _message(radio.link_id, f"LINK_{radio.bus}", LINK.length, list(_signals(LINK)), radio.gateway)


def _heartbeat(node: int, name: str) -> Message:
    return _message(heartbeat_id(node), f"HEARTBEAT_{name}", 1, [_signal("canopen_state", 0, 8, _CANOPEN)], name)


_CANOPEN = {0x00: "BOOT_UP", 0x04: "STOPPED", 0x05: "OPERATIONAL", 0x7F: "PRE_OPERATIONAL"}


def _state() -> Iterator[Signal]:
    for page, layout in enumerate((STATE_0, STATE_1, STATE_2, STATE_3)):
        for signal in _signals(layout):
            if signal.name in IN_EVERY_PAGE:
                signal.is_multiplexer = signal.name == "page"
                if page == 0:
                    yield signal
            else:
                signal.multiplexer_ids, signal.multiplexer_signal = [page], "page"
                yield signal


def _header(service: tuple[Signal, ...]) -> Iterator[Signal]:
    """Yield the signals of the CANaerospace header: node-ID, data type, service code, message code."""
    yield _signal("node_id", 0, 8)
    yield _signal("data_type", 8, 8, _TYPE_NAMES)
    yield from service
    yield _signal("message_code", 24, 8)


def _emergency_event() -> Iterator[Signal]:
    """Yield the signals of the CANaerospace emergency event, which reports the same fault as an EMCY of CANopen."""
    yield from _header((_signal("service_code", 16, 8),))
    yield _signal("error_code", 32, 16, signed=True)
    yield _signal("operation_id", 48, 8, _ELEMENT_KINDS, signed=True)
    yield _signal("location_id", 56, 8, signed=True)


_ELEMENT_KINDS = {kind.value: kind.name for kind in ElementKind}


def _echo(spec: Spec | None) -> Iterator[Signal]:
    """Yield the signals of an output echo.

    An echo with the data type FLOAT shows a device and the value to which it was driven. An echo with the data
    type ULONG shows a module that ran, and its mode.

    spec: has the names that the numbers of devices and modules get; None: the numbers get no names.
    """
    devices = dict(enumerate(spec.devices)) if spec is not None else None
    modules = dict(enumerate(spec.modules)) if spec is not None else None
    kinds = {
        DataType.FLOAT: (_signal("device", 16, 8, devices), _signal("value", 32, 32, is_float=True)),
        DataType.ULONG: (_signal("mode", 16, 8), _signal("module", 32, 32, modules)),
    }
    for signal in _header(()):
        signal.is_multiplexer = signal.name == "data_type"
        yield signal
    for kind, signals in kinds.items():
        for signal in signals:
            signal.multiplexer_ids, signal.multiplexer_signal = [kind.value], "data_type"
            yield signal


def _data(spec: Spec) -> Iterator[Message]:
    validity = {v.value: v.name for v in Validity}
    for (producer, variable), identifier in identifiers(spec).items():
        entry = spec.variables[variable]
        kind = DataType[entry.type]
        service = (_signal("validity", 16, 4, validity), _signal("version", 20, 4))
        values = _values(variable, kind, entry.unit)
        name = f"{variable}__{producer}"
        length = HEADER_BYTES + kind.payload_bytes
        yield Message(identifier, name, length, [*_header(service), *values], senders=[], strict=False)


def _foreign(spec: Spec, taken: Collection[int]) -> Iterator[Message]:
    """Write a message without signals for each identifier of foreign frames, of a long range for the first 256.

    taken: 11-bit identifiers that have a message already; another bus may have foreign frames with one of them.
    """
    found: dict[tuple[bool, int], Message] = {}
    for bus in spec.buses.values():
        for one in bus.foreign:
            for can_id in range(one.first, min(one.last, one.first + _MOST_OF_A_RANGE - 1) + 1):
                key = (one.extended, can_id)
                if key not in found and (one.extended or can_id not in taken):
                    name = f"FOREIGN_{bus.name}_{can_id}{'x' if one.extended else ''}"
                    found[key] = Message(
                        can_id, name, one.data_bytes, [], senders=[], is_extended_frame=one.extended, strict=False
                    )
    yield from found.values()


def _values(variable: str, kind: DataType, unit: str | None) -> Iterator[Signal]:
    """Write one signal with the name of the variable; for an array type, one per element (`variable_0`, ...)."""
    if kind.payload_bytes == 0:
        return
    digits = "".join(c for c in kind.name if c.isdigit())
    count = int(digits) if digits else 1
    bits = 8 * kind.payload_bytes // count
    signed = kind.name.rstrip("1234") in ("LONG", "SHORT", "CHAR")
    for i in range(count):
        name = variable if count == 1 else f"{variable}_{i}"
        start = 8 * HEADER_BYTES + i * bits
        yield _signal(name, start, bits, signed=signed, unit=unit, is_float=kind is DataType.FLOAT)
