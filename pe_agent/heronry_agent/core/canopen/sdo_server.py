"""The SDO server of a node: answers the requests of clients, one transfer at a time (CiA 301, 7.2.4).

A client reads (uploads) or writes (downloads) one value of the object dictionary per transfer, in one of three ways:

    expedited   up to four bytes, in the request or the answer itself
    segmented   seven bytes in each request or answer. A toggle bit distinguishes a doubled request from the next one
    block       up to 127 segments in a row; then one answer says how many segments have come in order. Missing segments
                are sent again. The end carries a checksum over all data

The server is in one of these states:

    none            no transfer
    _Download,
    _Upload         segmented: the server awaits the next segment; a wrong toggle bit ends the transfer
    _BlockDownload  the server receives segments. Once the last one has come, `is_complete` is True, and the server
                    awaits the end of the transfer
    _BlockUpload    the transfer has one of four phases:
                    OPENED    the server awaits the client's start
                    SENDING   the server sends segments
                    WAITING   the server awaits the answer to a block
                    CLOSING   the server has sent the end, and awaits the client's answer

The requests of all clients have the same identifier, so the server cannot distinguish two clients. If a second client
initiates a transfer, its transfer replaces the first one. The next request of the first client does not fit this
transfer, and so aborts it. Within a block download the server takes every frame for a segment. So a second client has
to wait for the end of the block download, or for its time-out.

A written value reaches its object at the end of the transfer, complete and checked, or not at all.

    lost request or answer    ends an expedited or segmented transfer: the client gives up. This server gives up after
                              TIME_OUT_NS, and sends an abort
    lost segment of a block   is sent again: the server drops the segments after the gap, and its answer names the last
                              segment in order. If the last segment is lost, the answer comes after BLOCK_PAUSE_NS
    forged request            has the effect of a true one
    garbage                   is answered with an abort, or not at all; no request raises an exception
    restart                   the server has no transfer, and aborts a transfer that a client continues

SDO has a higher priority on the bus than some of the data, so its rate is limited:

- Each request is answered with at most one frame.
- A block upload sends one segment, and then leaves the bus free for `segment_ns`.
- A block download has at most SEGMENTS_PER_BLOCK segments in a block.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Protocol

from heronry_wire.sansio import NEVER_NS
from heronry_wire.sdo import (
    ABORT,
    BLOCK_ACKNOWLEDGE,
    BLOCK_CRC,
    BLOCK_DOWNLOAD,
    BLOCK_DOWNLOAD_ANSWER,
    BLOCK_END,
    BLOCK_INITIATE,
    BLOCK_LAST_SEGMENT,
    BLOCK_PART_BITS,
    BLOCK_SIZE_GIVEN,
    BLOCK_START,
    BLOCK_UPLOAD,
    BLOCK_UPLOAD_ANSWER,
    COMMAND_BITS,
    DOWNLOAD,
    DOWNLOAD_ANSWER,
    EXPEDITED,
    EXPEDITED_BYTES,
    LAST_SEGMENT,
    MESSAGE_BYTES,
    MOST_SEGMENTS,
    SEGMENT_BYTES,
    SEGMENT_DOWNLOAD,
    SEGMENT_DOWNLOAD_ANSWER,
    SEGMENT_UPLOAD,
    SEGMENT_UPLOAD_ANSWER,
    SEQUENCE_BITS,
    SIZE_GIVEN,
    TOGGLE,
    UPLOAD,
    UPLOAD_ANSWER,
    Abort,
    abort_message,
    block_acknowledged,
    block_checksum,
    block_end,
    block_segment_data,
    block_size,
    command_of,
    crc,
    expedited_length,
    read_head,
    read_length,
    segment,
    segment_data,
    unused_in_block,
    with_data,
    with_number,
)

TIME_OUT_NS = 1_000_000_000
BLOCK_PAUSE_NS = 150_000_000  # clients give up after 300 ms and more
SEGMENTS_PER_BLOCK = 32


class Objects(Protocol):
    """The object dictionary that the server serves."""

    def read(self, index: int, sub_index: int) -> bytes | Abort:
        """Return the bytes of an object's value, or the reason why it cannot be read."""

    def room(self, index: int, sub_index: int, length: int | None) -> int | Abort:
        """Return how many bytes may be written to an object, or the reason why it cannot be written.

        length: the number of bytes that the client has announced; None: the client has announced no number.
        """

    def write(self, index: int, sub_index: int, data: bytes) -> Abort | None:
        """Write the value of an object; returns None, or the reason why the value is refused."""


class _Phase(Enum):
    OPENED = auto()
    SENDING = auto()
    WAITING = auto()
    CLOSING = auto()


@dataclass(slots=True)
class _Download:
    """A segmented download under way.

    length: number of bytes that the client has announced; None: the client has announced no number.
    room: the greatest number of bytes that the object can take.
    """

    index: int
    sub_index: int
    length: int | None
    room: int
    data: bytearray = field(default_factory=bytearray)
    toggle: int = 0


@dataclass(slots=True)
class _Upload:
    """A segmented upload under way.

    at: the index in `data` at which the next segment begins.
    """

    index: int
    sub_index: int
    data: bytes
    at: int = 0
    toggle: int = 0


@dataclass(slots=True)
class _BlockDownload:
    """A block download under way; `sequence`: number of the last segment of the present block that came in order."""

    index: int
    sub_index: int
    length: int | None
    room: int
    has_crc: bool
    data: bytearray = field(default_factory=bytearray)
    sequence: int = 0
    is_complete: bool = False


@dataclass(slots=True)
class _BlockUpload:
    """A block upload under way.

    The present block begins at `at`, and `sent` of at most `size` segments have been sent.
    """

    index: int
    sub_index: int
    data: bytes
    has_crc: bool
    size: int
    at: int = 0
    sent: int = 0
    phase: _Phase = _Phase.OPENED


_Transfer = _Download | _Upload | _BlockDownload | _BlockUpload


class SdoServer:
    """The SDO server of one node; `next_ns` is the latest time at which to call `tick`."""

    def __init__(self, objects: Objects, segment_ns: int) -> None:
        """Begin without a transfer.

        segment_ns: the time from one segment of a block upload to the next; the attribute may be changed later.
        """
        self._objects = objects
        self.segment_ns = segment_ns
        self._transfer: _Transfer | None = None
        self.next_ns = NEVER_NS
        self._limit_ns = NEVER_NS  # when the transfer times out
        self._commands: dict[int, Callable[[bytes, int], bytes | None]] = {
            DOWNLOAD: self._download,
            SEGMENT_DOWNLOAD: self._download_segment,
            UPLOAD: self._upload,
            SEGMENT_UPLOAD: self._upload_segment,
            BLOCK_DOWNLOAD: self._block_download,
            BLOCK_UPLOAD: self._block_upload,
        }

    @property
    def receives_segments(self) -> bool:
        """Tell whether the next request is a segment of a block download."""
        return isinstance(self._transfer, _BlockDownload) and not self._transfer.is_complete

    def reset(self) -> None:
        """End the transfer under way, and send no abort."""
        self._transfer = None
        self.next_ns = self._limit_ns = NEVER_NS

    def request(self, message: bytes, now_ns: int) -> bytes | None:
        """Process a request of a client; returns the answer, None if there is none."""
        if len(message) != MESSAGE_BYTES:
            return None
        if command_of(message) == ABORT:
            self.reset()
            return None
        transfer = self._transfer
        self._await(now_ns)
        if isinstance(transfer, _BlockDownload) and not transfer.is_complete:
            return self._block_segment(transfer, message, now_ns)
        answer = self._commands.get(command_of(message) & COMMAND_BITS, self._unknown)(message, now_ns)
        if self._transfer is None:
            self.reset()
        return answer

    def tick(self, now_ns: int) -> bytes | None:
        """Return the frame that is due: a segment of an upload, the answer to an interrupted block, or an abort."""
        transfer = self._transfer
        if transfer is None or now_ns < self.next_ns:
            return None
        if now_ns >= self._limit_ns:
            return self._abort(transfer.index, transfer.sub_index, Abort.TIME_OUT)
        self.next_ns = self._limit_ns
        if isinstance(transfer, _BlockUpload):
            return self._send_segment(transfer, now_ns)
        assert isinstance(transfer, _BlockDownload)
        return self._acknowledge(transfer)

    def _await(self, now_ns: int, wake_ns: int = NEVER_NS) -> None:
        """Restart the time-out, and have `tick` called at `wake_ns` (ns) if that is earlier."""
        self._limit_ns = now_ns + TIME_OUT_NS
        self.next_ns = min(self._limit_ns, wake_ns)

    def _abort(self, index: int, sub_index: int, reason: Abort) -> bytes:
        self.reset()
        return abort_message(index, sub_index, reason)

    def _unknown(self, message: bytes, _now_ns: int) -> bytes:
        """Abort the transfer, because a request is unknown or does not fit the transfer."""
        transfer = self._transfer
        index, sub_index = read_head(message)[:2] if transfer is None else (transfer.index, transfer.sub_index)
        return self._abort(index, sub_index, Abort.COMMAND)

    # Expedited and segmented

    def _download(self, message: bytes, _now_ns: int) -> bytes:
        self._transfer = None
        command, (index, sub_index, rest) = command_of(message), read_head(message)
        length = None
        if command & SIZE_GIVEN:
            length = expedited_length(command) if command & EXPEDITED else read_length(rest)
        room = self._objects.room(index, sub_index, length)
        if isinstance(room, Abort):
            return self._abort(index, sub_index, room)
        if command & EXPEDITED:
            return self._write(index, sub_index, rest[: room if length is None else length], DOWNLOAD_ANSWER)
        self._transfer = _Download(index, sub_index, length, room)
        return with_data(DOWNLOAD_ANSWER, index, sub_index)

    def _write(self, index: int, sub_index: int, data: bytes, answer: int) -> bytes:
        """Write a complete value to its object, and end the transfer; returns the message to send.

        This message has the command byte `answer`, or is an abort if the value is refused.
        """
        refusal = self._objects.write(index, sub_index, data)
        if refusal is not None:
            return self._abort(index, sub_index, refusal)
        self._transfer = None
        is_initiate = answer == DOWNLOAD_ANSWER
        return with_data(answer, index, sub_index) if is_initiate else segment(answer, b"")

    def _download_segment(self, message: bytes, now_ns: int) -> bytes:
        transfer, command = self._transfer, command_of(message)
        if not isinstance(transfer, _Download):
            return self._unknown(message, now_ns)
        if command & TOGGLE != transfer.toggle:
            return self._abort(transfer.index, transfer.sub_index, Abort.TOGGLE)
        transfer.data += segment_data(message)
        is_last = bool(command & LAST_SEGMENT)
        if not _fits(transfer, is_last=is_last):
            return self._abort(transfer.index, transfer.sub_index, Abort.LENGTH)
        answer = SEGMENT_DOWNLOAD_ANSWER | transfer.toggle
        if is_last:
            return self._write(transfer.index, transfer.sub_index, bytes(transfer.data), answer)
        transfer.toggle ^= TOGGLE
        return segment(answer, b"")

    def _upload(self, message: bytes, _now_ns: int) -> bytes:
        self._transfer = None
        index, sub_index, _ = read_head(message)
        data = self._objects.read(index, sub_index)
        if isinstance(data, Abort):
            return self._abort(index, sub_index, data)
        if 0 < len(data) <= EXPEDITED_BYTES:
            unused = EXPEDITED_BYTES - len(data)
            return with_data(UPLOAD_ANSWER | unused << 2 | EXPEDITED | SIZE_GIVEN, index, sub_index, data)
        self._transfer = _Upload(index, sub_index, data)
        return with_number(UPLOAD_ANSWER | SIZE_GIVEN, index, sub_index, len(data))

    def _upload_segment(self, message: bytes, now_ns: int) -> bytes:
        transfer, command = self._transfer, command_of(message)
        if not isinstance(transfer, _Upload):
            return self._unknown(message, now_ns)
        if command & TOGGLE != transfer.toggle:
            return self._abort(transfer.index, transfer.sub_index, Abort.TOGGLE)
        part = transfer.data[transfer.at : transfer.at + SEGMENT_BYTES]
        answer = SEGMENT_UPLOAD_ANSWER | transfer.toggle | SEGMENT_BYTES - len(part) << 1
        transfer.at += SEGMENT_BYTES
        transfer.toggle ^= TOGGLE
        if transfer.at >= len(transfer.data):
            self._transfer = None
            answer |= LAST_SEGMENT
        return segment(answer, part)

    # Block download

    def _block_download(self, message: bytes, now_ns: int) -> bytes:
        command, (index, sub_index, rest) = command_of(message), read_head(message)
        if command & BLOCK_END:
            return self._block_download_end(message, now_ns)
        self._transfer = None
        length = read_length(rest) if command & BLOCK_SIZE_GIVEN else None
        room = self._objects.room(index, sub_index, length)
        if isinstance(room, Abort):
            return self._abort(index, sub_index, room)
        self._transfer = _BlockDownload(index, sub_index, length, room, bool(command & BLOCK_CRC))
        answer = BLOCK_DOWNLOAD_ANSWER | command & BLOCK_CRC | BLOCK_INITIATE
        return with_data(answer, index, sub_index, bytes((SEGMENTS_PER_BLOCK,)))

    def _block_segment(self, transfer: _BlockDownload, message: bytes, now_ns: int) -> bytes | None:
        sequence, is_last = command_of(message) & SEQUENCE_BITS, bool(command_of(message) & BLOCK_LAST_SEGMENT)
        if sequence == transfer.sequence + 1:
            transfer.sequence = sequence
            transfer.data += block_segment_data(message)
            transfer.is_complete = is_last
            most = transfer.room if transfer.length is None else transfer.length
            if len(transfer.data) > most + SEGMENT_BYTES:
                return self._abort(transfer.index, transfer.sub_index, Abort.LENGTH)
        if is_last or sequence >= SEGMENTS_PER_BLOCK:
            return self._acknowledge(transfer)
        self._await(now_ns, now_ns + BLOCK_PAUSE_NS)
        return None

    def _acknowledge(self, transfer: _BlockDownload) -> bytes:
        """Return the answer to a block: how many segments have come in order; the next segment has number 1 again."""
        received, transfer.sequence = transfer.sequence, 0
        return segment(BLOCK_DOWNLOAD_ANSWER | BLOCK_ACKNOWLEDGE, bytes((received, SEGMENTS_PER_BLOCK)))

    def _block_download_end(self, message: bytes, now_ns: int) -> bytes:
        transfer = self._transfer
        if not isinstance(transfer, _BlockDownload):
            return self._unknown(message, now_ns)
        del transfer.data[len(transfer.data) - unused_in_block(message) :]
        if not _fits(transfer, is_last=True):
            return self._abort(transfer.index, transfer.sub_index, Abort.LENGTH)
        if transfer.has_crc and crc(transfer.data) != block_checksum(message):
            return self._abort(transfer.index, transfer.sub_index, Abort.CRC)
        answer = BLOCK_DOWNLOAD_ANSWER | BLOCK_END
        return self._write(transfer.index, transfer.sub_index, bytes(transfer.data), answer)

    # Block upload

    def _block_upload(self, message: bytes, now_ns: int) -> bytes | None:
        part, transfer = command_of(message) & BLOCK_PART_BITS, self._transfer
        if part == BLOCK_INITIATE:
            return self._block_upload_initiate(message)
        if isinstance(transfer, _BlockUpload):
            if part == BLOCK_START and transfer.phase is _Phase.OPENED:
                return self._send_segment(transfer, now_ns)
            if part == BLOCK_ACKNOWLEDGE and transfer.phase in (_Phase.SENDING, _Phase.WAITING):
                return self._acknowledged(transfer, *block_acknowledged(message), now_ns)
            if part == BLOCK_END and transfer.phase is _Phase.CLOSING:
                self._transfer = None
                return None
        return self._unknown(message, now_ns)

    def _block_upload_initiate(self, message: bytes) -> bytes:
        self._transfer = None
        index, sub_index, rest = read_head(message)
        if not 0 < block_size(rest) <= MOST_SEGMENTS:
            return self._abort(index, sub_index, Abort.BLOCK_SIZE)
        data = self._objects.read(index, sub_index)
        if isinstance(data, Abort):
            return self._abort(index, sub_index, data)
        self._transfer = _BlockUpload(index, sub_index, data, bool(command_of(message) & BLOCK_CRC), block_size(rest))
        answer = BLOCK_UPLOAD_ANSWER | command_of(message) & BLOCK_CRC | BLOCK_SIZE_GIVEN | BLOCK_INITIATE
        return with_number(answer, index, sub_index, len(data))

    def _send_segment(self, transfer: _BlockUpload, now_ns: int) -> bytes:
        """Send the next segment of the block; if the block has another segment, that one is due `segment_ns` later."""
        start = transfer.at + transfer.sent * SEGMENT_BYTES
        part = transfer.data[start : start + SEGMENT_BYTES]
        transfer.sent += 1
        command = transfer.sent
        if start + SEGMENT_BYTES >= len(transfer.data):
            command |= BLOCK_LAST_SEGMENT
        if command & BLOCK_LAST_SEGMENT or transfer.sent == transfer.size:
            transfer.phase = _Phase.WAITING
        else:
            transfer.phase = _Phase.SENDING
            self._await(now_ns, now_ns + self.segment_ns)
        return segment(command, part)

    def _acknowledged(self, transfer: _BlockUpload, received: int, size: int, now_ns: int) -> bytes:
        """Continue a block upload after the client has confirmed `received` segments of the last block.

        size: how many segments the next block has.
        """
        if received > transfer.sent:
            return self._abort(transfer.index, transfer.sub_index, Abort.SEQUENCE)
        if not 0 < size <= MOST_SEGMENTS:
            return self._abort(transfer.index, transfer.sub_index, Abort.BLOCK_SIZE)
        transfer.at += received * SEGMENT_BYTES
        if received and transfer.at >= len(transfer.data):
            transfer.phase = _Phase.CLOSING
            unused = transfer.at - len(transfer.data)
            checksum = crc(transfer.data) if transfer.has_crc else 0
            return block_end(BLOCK_UPLOAD_ANSWER | unused << 2 | BLOCK_END, checksum)
        transfer.sent, transfer.size = 0, size
        return self._send_segment(transfer, now_ns)


def _fits(transfer: _Download | _BlockDownload, *, is_last: bool) -> bool:
    """Tell whether the data received so far have an allowed length.

    - If the client has announced no length, the data must not be longer than the object's room.
    - If the client has announced a length, the data must not be longer than this length. After the last segment they
      must have exactly this length.
    """
    length = len(transfer.data)
    if transfer.length is None:
        return length <= transfer.room
    return length == transfer.length if is_last else length <= transfer.length
