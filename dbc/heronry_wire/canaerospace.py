"""CANaerospace data frames: the 4-byte header, the 32 data types, validity, emergency events.

The format is that of the CANaerospace Interface Specification V1.7 (Stock Flight Systems, 2006). Below, [S p.8] means
page 8 of this specification.

    byte 0   node-ID: of the sender (in a request for a node service: of the addressed node)     [S p.8]
    byte 1   data type: 0..31 of [S p.5-7], 32..99 reserved, 100..255 user-defined
    byte 2   service code: in data frames of this project the status of the datum, see below
    byte 3   message code: rises by one with each frame of this identifier and node; 255 is followed by 0
    4..7     payload: 0 to 4 bytes, big-endian, exactly as long as its type

This file keeps no state. A receiver finds lost, doubled and late frames by their message code. A forged frame looks
like a true one, since data frames carry no tag.

The status of a datum. V1.7 says that byte 2 "should continuously reflect the status of the data" and defines no values
for it. Here the low nibble is the version of the datum (1 best .. 15) and the high nibble its `Validity`. A few
standard identifiers use byte 2 for a waypoint, tyre or brake number instead: `standard_identifiers` lists them.

Redundancy. [S p.53] gives channel n of the identifier `id` the 29-bit identifier 65536 n + id. In arbitration the upper
11 bits of this number are sent first, and they have the value n // 4. So the frames of channels 1 to 3 begin with 11
zero bits. They have a higher priority than all 11-bit frames with identifiers above 0, even than emergency events (see
`frame.arbitration_key`). This project sends and reads 11-bit frames only (docs/limits.md); it counts the 29-bit frames
of other makers.
"""

import math
import struct
from enum import IntEnum
from typing import NamedTuple

from heronry_wire.frame import EXTENDED_MASK, STANDARD_MASK, Frame, Malformed, WireError
from heronry_wire.identifiers import emergency_event_id

HEADER_BYTES = 4
MAX_PAYLOAD_BYTES = 4
_FIRST_USER_TYPE = 100


class DataType(IntEnum):
    """The data types of [S p.5-7]; the number of a type is its code in byte 1.

    The Python type of a datum's value, by data type:

        NODATA                      None
        ERROR                       `ErrorReport`
        FLOAT                       float
        other types of one value    int; B... types are unsigned bit fields
        halves of a DOUBLE          int, one for each half
        types of 2, 3 or 4 values   tuple of int
        ACHAR to ACHAR4             str of exactly 1 to 4 characters, in Latin-1, so that no byte is lost
    """

    NODATA = 0
    ERROR = 1
    FLOAT = 2
    LONG = 3
    ULONG = 4
    BLONG = 5
    SHORT = 6
    USHORT = 7
    BSHORT = 8
    CHAR = 9
    UCHAR = 10
    BCHAR = 11
    SHORT2 = 12
    USHORT2 = 13
    BSHORT2 = 14
    CHAR4 = 15
    UCHAR4 = 16
    BCHAR4 = 17
    CHAR2 = 18
    UCHAR2 = 19
    BCHAR2 = 20
    MEMID = 21
    CHKSUM = 22
    ACHAR = 23
    ACHAR2 = 24
    ACHAR4 = 25
    CHAR3 = 26
    UCHAR3 = 27
    BCHAR3 = 28
    ACHAR3 = 29
    DOUBLEH = 30
    DOUBLEL = 31

    @property
    def payload_bytes(self) -> int:
        """Length of the payload, 0..4; a frame is 4 bytes longer."""
        return _LAYOUTS[self].size


# One struct per type, in the order of their codes.
_LAYOUTS = tuple(
    struct.Struct(f">{layout}")
    for layout in (
        *("", "hbb", "f", "i", "I", "I", "h", "H", "H", "b", "B", "B", "2h", "2H", "2H", "4b"),
        *("4B", "4B", "2b", "2B", "2B", "I", "I", "1s", "2s", "4s", "3b", "3B", "3B", "3s", "I", "I"),
    )
)
_TYPES = tuple(DataType)
_INTEGERS = frozenset("iIhHbB")  # layouts of one integer
_IS_TEXT = tuple(layout.format.endswith("s") for layout in _LAYOUTS)
_RANGES = {
    "": "no value (None)",
    "hbb": "an ErrorReport of -32768..32767 and twice -128..127",
    "f": "a number of IEEE 754 single precision",
    "i": "-2147483648..2147483647",
    "I": "0..4294967295",
    "h": "-32768..32767",
    "H": "0..65535",
    "b": "-128..127",
    "B": "0..255",
}


def value_range(data_type: DataType) -> tuple[float, float]:
    """Return the least and the greatest value of a type that holds one number.

    For FLOAT the values are minus and plus infinity. For a type that does not hold one number the least value is above
    the greatest, so that no number is in the range.
    """
    layout = _LAYOUTS[data_type].format.removeprefix(">")
    if layout == "f":
        return -math.inf, math.inf
    if layout not in _INTEGERS:
        return math.inf, -math.inf
    bits = 8 * _LAYOUTS[data_type].size
    return (0, (1 << bits) - 1) if layout.isupper() else (-(1 << bits - 1), (1 << bits - 1) - 1)


class ErrorReport(NamedTuple):
    """The value of an ERROR datum, the payload of an emergency event [S p.9]."""

    error_code: int  # -32768..32767
    operation_id: int  # -128..127
    location_id: int  # -128..127


Value = None | int | float | str | bytes | tuple[int, ...]


class Datum(NamedTuple):
    """One CANaerospace frame without its identifier; `data_type` determines the type of `value`.

    `data_type` is a plain int 100..255 for a user-defined type, whose value is 0..4 raw bytes.
    """

    node_id: int
    data_type: DataType | int
    service_code: int
    message_code: int
    value: Value


class Validity(IntEnum):
    """Whether a datum may be used; the values are those of the high nibble of byte 2."""

    NOT_STATED = 0
    VALID = 1
    DEGRADED = 2  # usable, outside its usual accuracy
    INVALID = 3  # the source has failed: do not use
    NO_COMPUTED_DATA = 4  # the source works and has no value yet


class Status(NamedTuple):
    """Byte 2 of a data frame of this project: version of the datum (1 best .. 15) and validity."""

    version: int
    validity: Validity


def pack_status(status: Status) -> int:
    """Encode a status as byte 2 of a data frame; raises WireError for a version outside 1..15."""
    if not 1 <= status.version <= 15:
        raise WireError(f"version {status.version} does not fit into a frame: use a version from 1 to 15")
    return status.validity << 4 | status.version


_VALIDITIES = tuple(Validity)


def unpack_status(service_code: int) -> Status | Malformed:
    """Decode byte 2 of a data frame; `Malformed` where it states no version or no known validity."""
    version, validity = service_code & 0x0F, service_code >> 4
    if version == 0:
        return Malformed("the datum states no version (low nibble of byte 2 is 0)")
    if validity >= len(_VALIDITIES):
        return Malformed(f"validity {validity} is not defined")
    return Status(version, _VALIDITIES[validity])


def encode_data(can_id: int, datum: Datum, *, extended: bool = False) -> Frame:
    """Encode a data frame; raises WireError where a field or the value is out of its range."""
    limit = EXTENDED_MASK if extended else STANDARD_MASK
    if not 0 <= can_id <= limit:
        raise WireError(f"identifier {can_id} is outside 0..{limit}")
    header = (datum.node_id, datum.data_type, datum.service_code, datum.message_code)
    try:
        data = bytes(header)
    except ValueError:
        told = tuple(map(int, header))
        raise WireError(f"header {told} does not fit into a frame: each of its four fields takes 0..255") from None
    return Frame(can_id, data + _encode_value(datum.data_type, datum.value), extended)


def _encode_value(code: int, value: Value) -> bytes:
    if code >= _FIRST_USER_TYPE:
        if not isinstance(value, bytes) or len(value) > MAX_PAYLOAD_BYTES:
            raise WireError(f"user-defined type {code} takes 0 to 4 raw bytes, not {value!r}")
        return value
    if code >= len(_TYPES):
        raise WireError(f"data type {code} is reserved: use 0..31, or 100..255 for a user-defined type")
    layout = _LAYOUTS[code]
    try:
        if _IS_TEXT[code]:
            return _encode_text(layout.size, value)
        arguments = () if value is None else value if isinstance(value, tuple) else (value,)
        return layout.pack(*arguments)
    except (struct.error, OverflowError, ValueError):
        raise WireError(f"{_TYPES[code].name} cannot carry {value!r}: it takes {_takes(layout)}") from None


def _encode_text(characters: int, value: Value) -> bytes:
    text = value.encode("latin-1") if isinstance(value, str) else b""
    if len(text) != characters:
        raise ValueError
    return text


def _takes(layout: struct.Struct) -> str:
    form = layout.format[1:]
    if form.endswith("s"):
        return f"text of exactly {layout.size} Latin-1 character(s)"
    if form[:1].isdigit():
        return f"a tuple of {form[0]}, each {_RANGES[form[1:]]}"
    return _RANGES[form]


def decode_data(frame: Frame) -> Datum | Malformed:
    """Decode the header and the value of a data frame under any identifier; `Malformed` if the frame breaks a rule."""
    data = frame.data
    if frame.remote or frame.error:
        return Malformed("not a data frame")
    if len(data) < HEADER_BYTES:
        return Malformed(f"{len(data)} bytes are too few for the 4-byte header")
    node_id, code, service_code, message_code = read_header(data)
    payload = data[HEADER_BYTES:]
    if code < len(_TYPES):
        layout = _LAYOUTS[code]
        if len(payload) != layout.size:
            return Malformed(f"{_TYPES[code].name} has {layout.size} bytes of payload, not {len(payload)}")
        return Datum(node_id, _TYPES[code], service_code, message_code, decode_payload(code, payload))
    if code < _FIRST_USER_TYPE or len(payload) > MAX_PAYLOAD_BYTES:
        return Malformed(f"data type {code} with {len(payload)} bytes of payload: reserved, or more than 4 bytes")
    return Datum(node_id, code, service_code, message_code, payload)


def read_header(data: bytes) -> tuple[int, int, int, int]:
    """Return node-ID, type, service code and message code of a data frame of at least four bytes."""
    return data[0], data[1], data[2], data[3]


def node_of(data: bytes) -> int | None:
    """Return the node-ID of the sender, byte 0 of a data frame; None where the frame is empty."""
    return data[0] if data else None


def type_and_service_of(data: bytes) -> bytes:
    """Return bytes 1 and 2 of a data frame, type and service code; fewer bytes where the frame is shorter."""
    return data[1:3]


def decode_payload(code: int, payload: bytes) -> Value:
    """Read the payload of a frame of type `code`, 0..31; the payload must have the length of that type."""
    values = _LAYOUTS[code].unpack(payload)
    if len(values) != 1:
        if code == DataType.ERROR:
            return ErrorReport(*values)
        return values or None
    value: int | float | bytes = values[0]
    return value.decode("latin-1") if isinstance(value, bytes) else value


def encode_emergency_event(node_id: int, report: ErrorReport, *, service_code: int = 0, message_code: int = 0) -> Frame:
    """Encode the emergency event of a node, under the identifier for it in the identifier plan."""
    datum = Datum(node_id, DataType.ERROR, service_code, message_code, report)
    return encode_data(emergency_event_id(node_id), datum)
