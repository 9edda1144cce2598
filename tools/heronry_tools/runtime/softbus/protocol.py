"""The protocol between a client and the hub of a software bus.

A client has two sockets, both SOCK_SEQPACKET, so that one record is one read:

- The *command* socket is its connection to the hub's path. The client says hello, sets filters and asks for statistics;
  each of these is answered by one JSON record. The client also offers frames; the hub answers `DONE` when a frame
  has left the bus. The client offers the next frame only after that. So the command socket is a transmit mailbox for
  one frame, and the client's own priority queue decides which frame comes next.
- The *receive* socket carries frames from the hub, and nothing else. The client makes a pair of sockets, and sends one
  of them to the hub with the hello. Because the command and receive sockets are separate, a thread that waits to send
  does not block a thread that receives.

A client may ask for *batches*, as a node does. Then a packet of the receive socket has up to `BATCH_RECORDS` frames,
every frame that the client has sent comes back on it, whatever its filters, and takes the place of `DONE`. Such a
client has `MAILBOXES` mailboxes, which compete by priority as those of many CAN controllers, and may offer several
frames in one packet. Each frame that it offers has its `Haste`. (A client without batches is always urgent.)
`WANT_ECHO` makes up for an echo that was said to be patient. A withdrawal takes offers back that have not left; each of
them comes back marked.

Records are neither lost nor doubled on a UNIX socket. The end of a socket (an empty read) means that the other side is
gone. Bytes that break these rules are decoded as a `Malformed` value. The hub refuses a client that sends such bytes,
tells that client the reason, and serves the other clients.
"""

import json
from array import array
from collections.abc import Iterator
from enum import Enum
from struct import Struct
from typing import Any, NamedTuple

from heronry_wire.frame import EXTENDED_MASK, MAX_DATA_BYTES, STANDARD_MASK, Frame, Malformed
from heronry_wire.frame_port import Haste
from heronry_wire.thinning import Thinned

PROTOCOL_VERSION = 3
MAX_COMMAND_BYTES = 65536

DONE = b"D"
"""The offered frame has left the bus: the client may offer the next one."""

WANT_ECHO = b"E"
"""The client needs the echo of the frame that it has offered as soon as the frame has left."""

MAILBOXES, BATCH_RECORDS = 8, 64

_FRAME_KIND = 0x4F  # cannot begin a JSON object
_WITHDRAWAL_KIND = b"W"
_EXTENDED, _REMOTE, _OWN, _PROMPT, _PATIENT, _WITHDRAWN = 1, 2, 4, 8, 16, 32
_HASTE_BITS = {Haste.URGENT: 0, Haste.PROMPT: _PROMPT, Haste.PATIENT: _PATIENT}
_HASTE = {bits: haste for haste, bits in _HASTE_BITS.items()}

# kind, flags, data length code, padding, identifier, time, data
_RECORD = Struct("<BBBxIq8s")
RECORD_BYTES = _RECORD.size
BATCH_BYTES = BATCH_RECORDS * RECORD_BYTES

_NO_DATA = bytes(MAX_DATA_BYTES)


class Fate(Enum):
    """What has become of a frame that this client has offered."""

    SENT = 0
    WITHDRAWN = _WITHDRAWN


class BusFrame(NamedTuple):
    """A frame on the software bus; `dlc` is the length of its data, or the length that a remote frame requests."""

    frame: Frame
    dlc: int
    time_ns: int
    """CLOCK_MONOTONIC. Of an offered frame: when it was offered. Of a received one: the end of the frame."""
    own: bool = False
    """Of a received frame: whether it was sent through this connection."""
    haste: Haste = Haste.URGENT
    """Of an offered frame."""


def encode_frame(sent: BusFrame) -> bytes:
    """Encode a frame that a client offers or receives."""
    frame, flags = sent.frame, _HASTE_BITS[sent.haste]
    flags |= (_EXTENDED if frame.extended else 0) | (_REMOTE if frame.remote else 0) | (_OWN if sent.own else 0)
    return _RECORD.pack(_FRAME_KIND, flags, sent.dlc, frame.can_id, sent.time_ns, frame.data)


def encode_received(frame: Frame, dlc: int, end_ns: int, fate: Fate | None = None) -> bytes:
    """Encode a frame that has left the bus, as `encode_frame` does, without a `BusFrame`.

    fate: for the client that has offered the frame.
    """
    flags = (_EXTENDED if frame.extended else 0) | (_REMOTE if frame.remote else 0)
    if fate is not None:
        flags |= _OWN | fate.value
    return _RECORD.pack(_FRAME_KIND, flags, dlc, frame.can_id, end_ns, frame.data)


def frames_of(packet: bytes) -> Iterator[tuple[int, Fate | None, Frame]]:
    """Yield time, fate (None: another client's frame) and frame of each record in a packet of the hub.

    Raises ValueError for what is no packet of this version. The records themselves are the hub's, and not checked.
    """
    if len(packet) % RECORD_BYTES:
        raise ValueError(f"a packet of frames has a multiple of {RECORD_BYTES} bytes, not {len(packet)}")
    for kind, flags, dlc, can_id, time_ns, data in _RECORD.iter_unpack(packet):
        if kind != _FRAME_KIND:
            raise ValueError(f"kind {kind:#x} is unknown")
        if flags:
            fate = (Fate.WITHDRAWN if flags & _WITHDRAWN else Fate.SENT) if flags & _OWN else None
            extended, remote = bool(flags & _EXTENDED), bool(flags & _REMOTE)
            yield time_ns, fate, Frame(can_id, b"" if remote else data[:dlc], extended, remote)
        else:
            yield time_ns, None, Frame(can_id, data[:dlc])


def encode_withdrawal(identifiers: frozenset[int]) -> bytes:
    """Encode the withdrawal of offers with these 11-bit identifiers."""
    return _WITHDRAWAL_KIND + array("H", identifiers).tobytes()


def decode_withdrawal(record: bytes) -> frozenset[int] | None:
    """Decode a withdrawal; None: it is another record."""
    if not record.startswith(_WITHDRAWAL_KIND) or len(record) % 2 == 0:
        return None
    return frozenset(array("H", record[1:]))


def decode_frame(record: bytes) -> BusFrame | Malformed:
    """Decode a frame that a client offers or receives."""
    if len(record) != RECORD_BYTES:
        return Malformed(f"a frame record has {RECORD_BYTES} bytes, not {len(record)}")
    kind, flags, dlc, can_id, time_ns, data = _RECORD.unpack(record)
    extended, remote = bool(flags & _EXTENDED), bool(flags & _REMOTE)
    haste = _HASTE.get(flags & (_PROMPT | _PATIENT))
    if kind != _FRAME_KIND or haste is None or flags & ~(_EXTENDED | _REMOTE | _OWN | _PROMPT | _PATIENT):
        return Malformed(f"kind {kind:#x} with flags {flags:#x} is unknown")
    if dlc > MAX_DATA_BYTES:
        return Malformed(f"a classical frame has at most {MAX_DATA_BYTES} bytes, not {dlc}")
    if can_id > (EXTENDED_MASK if extended else STANDARD_MASK):
        return Malformed(f"identifier {can_id:#x} has more than {29 if extended else 11} bits")
    frame = Frame(can_id, b"" if remote else data[:dlc], extended, remote)
    return BusFrame(frame, dlc, time_ns, bool(flags & _OWN), haste)


def is_command(record: bytes) -> bool:
    """Tell whether a record is a JSON command or answer; else it is a frame."""
    return record.startswith(b"{")


def encode_command(content: dict[str, Any]) -> bytes:
    """Encode a command or an answer."""
    return json.dumps(content, separators=(",", ":")).encode()


def decode_command(record: bytes) -> dict[str, Any] | Malformed:
    """Decode a JSON record of the command socket: a command of a client, or an answer of the hub.

    Returns Malformed if the record is no JSON object.
    """
    try:
        content = json.loads(record)
    except (ValueError, RecursionError) as error:
        return Malformed(f"a command is a JSON object: {error}")
    if not isinstance(content, dict):
        return Malformed("a command is a JSON object")
    return content


class AcceptanceFilter(NamedTuple):
    """Accepts the identifiers that equal `can_id` in the bits of `mask`.

    extended: only identifiers of 29 bits (True), only those of 11 bits (False), or both (None).
    """

    can_id: int
    mask: int
    extended: bool | None

    def accepts(self, can_id: int, *, extended: bool) -> bool:
        """Tell whether this filter lets an identifier pass."""
        return (self.extended is None or self.extended == extended) and not (can_id ^ self.can_id) & self.mask


def decode_filters(content: object) -> tuple[AcceptanceFilter, ...] | Malformed:
    """Read the filters of a command: a list of [can_id, mask, extended or null]."""
    if not isinstance(content, list):
        return Malformed("filters are a list of [can_id, mask, extended]")
    filters = []
    for entry in content:
        match entry:
            case [int(can_id), int(mask), (bool() | None) as extended]:
                filters.append(AcceptanceFilter(can_id, mask, extended))
            case _:
                return Malformed(f"{entry!r} is not a filter [can_id, mask, extended]")
    return tuple(filters)


def decode_thinned(content: dict[str, Any]) -> Thinned | Malformed:
    """Read the group of a command to thin frames: a list of identifiers, a mask, and a time in ns."""
    match content:
        case {"identifiers": list(identifiers), "signs": list(signs), "mask": int(mask), "every_ns": int(every_ns)} if (
            all(isinstance(one, int) for one in (*identifiers, *signs))
        ):
            return Thinned(frozenset(identifiers), frozenset(signs), mask, every_ns)
        case _:
            return Malformed("a group to thin has identifiers, signs, a mask and every_ns")


class ClientStatistics(NamedTuple):
    """What the hub counted for one connected client."""

    number: int
    pid: int
    sent: int
    received: int
    overruns: int
    """Frames that this client was too slow to receive."""


class BusStatistics(NamedTuple):
    """Counters of the hub since its start; the difference of two readings gives a rate."""

    bitrate: int
    time_ns: int
    busy_ns: int
    frames: int
    clients: tuple[ClientStatistics, ...]

    def load_since(self, earlier: "BusStatistics") -> float:
        """Return the share of the time between two readings in which the bus was occupied, 0.0..1.0."""
        return (self.busy_ns - earlier.busy_ns) / max(self.time_ns - earlier.time_ns, 1)


def decode_statistics(content: dict[str, Any]) -> BusStatistics:
    """Decode the hub's answer to a request for statistics."""
    clients = tuple(ClientStatistics(*entry) for entry in content.pop("clients"))
    return BusStatistics(**content, clients=clients)
