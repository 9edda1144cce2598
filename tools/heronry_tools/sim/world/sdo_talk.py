"""An SDO client that reads and writes objects of a node; each transfer is a generator.

A generator yields each message that it sends, and is resumed with the answer. The client implements CiA 301 (7.2.4)
itself, without the server's code: it raises `WrongAnswerError` on any deviation from the standard. An abort by the
server is a normal answer.
"""

from collections.abc import Generator
from typing import TypeVar

from heronry_wire.frame import Frame
from heronry_wire.identifiers import sdo_request_id, sdo_response_id
from heronry_wire.sdo import (
    ABORT,
    BLOCK_ACKNOWLEDGE,
    BLOCK_CRC,
    BLOCK_DOWNLOAD,
    BLOCK_DOWNLOAD_ANSWER,
    BLOCK_END,
    BLOCK_INITIATE,
    BLOCK_LAST_SEGMENT,
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

T = TypeVar("T")
Request = tuple[Frame | None, int, int]
"""The message to send, the identifier of its answer, and the longest wait for the answer (ns)."""
Talk = Generator[Request, bytes | None, T]

PATIENCE_NS = 700_000_000
_SILENCE_NS = 30_000_000


class WrongAnswerError(Exception):
    """The answer of a node deviates from the standard."""


class SdoTalk:
    """An SDO client that talks to one server, the node with the node-ID `node`."""

    def __init__(self, node: int) -> None:
        self._request_id, self._response_id = sdo_request_id(node), sdo_response_id(node)

    def ask(self, message: bytes) -> Talk[bytes]:
        """Send a message and return its answer; raises WrongAnswerError if the answer is wrong or missing."""
        answer = yield Frame(self._request_id, message), self._response_id, PATIENCE_NS
        if answer is None or len(answer) != MESSAGE_BYTES:
            raise WrongAnswerError(f"{message.hex(' ')} is answered with {_told(answer)}")
        return answer

    def hear(self) -> Talk[bytes]:
        """Return the server's next message, for which no request is sent; raises WrongAnswerError if none comes."""
        answer = yield None, self._response_id, PATIENCE_NS
        if answer is None:
            raise WrongAnswerError("the SDO server of the PE does not send the next message in time")
        return answer

    def say(self, message: bytes, silence_ns: int = _SILENCE_NS) -> Talk[None]:
        """Send a message and demand that no answer comes within `silence_ns`."""
        answer = yield Frame(self._request_id, message), self._response_id, silence_ns
        _demand(answer is None, "%s must have no answer, but is answered with %s", message, answer)

    def refused(self, message: bytes, reason: Abort, index: int = 0, sub_index: int = 0) -> Talk[None]:
        """Send a message and demand that the server answers it with this abort."""
        answer = yield from self.ask(message)
        _demand(_abort(answer, index, sub_index) is reason, "%s is answered with %s", message, answer)

    def upload(self, index: int, sub_index: int) -> Talk[bytes | Abort]:
        """Read an object, expedited or by segments, and return its bytes or the server's abort."""
        answer = yield from self.ask(with_data(UPLOAD, index, sub_index))
        abort = _abort(answer, index, sub_index)
        if abort is not None:
            return abort
        command, place = command_of(answer), read_head(answer)
        _demand(
            command & COMMAND_BITS == UPLOAD_ANSWER and place[:2] == (index, sub_index),
            "an upload is answered with %s",
            answer,
        )
        if command & EXPEDITED:
            return place[2][: expedited_length(command) if command & SIZE_GIVEN else None]
        _demand(bool(command & SIZE_GIVEN), "an upload is answered without a length: %s", answer)
        length, data, toggle = read_length(place[2]), b"", 0
        while True:
            answer = yield from self.ask(segment(SEGMENT_UPLOAD | toggle, b""))
            _demand(
                command_of(answer) & (COMMAND_BITS | TOGGLE) == SEGMENT_UPLOAD_ANSWER | toggle,
                "a request for a segment is answered with %s",
                answer,
            )
            data += segment_data(answer)
            _demand(len(data) <= length, "%s bytes were announced, but %s have come", length, len(data))
            toggle ^= TOGGLE
            if command_of(answer) & LAST_SEGMENT:
                _demand(len(data) == length, "%s bytes were announced, but %s came", length, len(data))
                return data

    def upload_by_block(self, index: int, sub_index: int, size: int, lost: int = 0) -> Talk[bytes | Abort]:
        """Read an object by blocks of `size` segments, and return its bytes or the server's abort.

        The client acts as if it had not received the last `lost` segments of the first block.
        """
        answer = yield from self.ask(
            with_data(BLOCK_UPLOAD | BLOCK_CRC | BLOCK_INITIATE, index, sub_index, bytes((size,)))
        )
        abort = _abort(answer, index, sub_index)
        if abort is not None:
            return abort
        is_opened = command_of(answer) == BLOCK_UPLOAD_ANSWER | BLOCK_CRC | BLOCK_SIZE_GIVEN | BLOCK_INITIATE
        _demand(is_opened and read_head(answer)[:2] == (index, sub_index), "a block upload begins with %s", answer)
        length, data = read_length(read_head(answer)[2]), b""
        answer = yield from self.ask(segment(BLOCK_UPLOAD | BLOCK_START, b""))
        while (
            command_of(answer) & COMMAND_BITS != BLOCK_UPLOAD_ANSWER
            or command_of(answer) & 3 != BLOCK_END
            or len(data) < length
        ):
            block = yield from self._block(answer, size)
            kept = block[: len(block) - lost] if lost else block
            lost = 0
            data += b"".join(kept)
            _demand(len(data) < length + SEGMENT_BYTES, "%s bytes were announced, and %s have come", length, len(data))
            answer = yield from self.ask(segment(BLOCK_UPLOAD | BLOCK_ACKNOWLEDGE, bytes((len(kept), size))))
        data = data[: len(data) - unused_in_block(answer)]
        _demand(len(data) == length, "%s bytes were announced, and %s came", length, len(data))
        _demand(block_checksum(answer) == crc(data), "the checksum of a block upload is wrong: %s", answer)
        yield from self.say(segment(BLOCK_UPLOAD | BLOCK_END, b""))
        return data

    def _block(self, first: bytes, size: int) -> Talk[list[bytes]]:
        """Receive the segments of a block, at most `size`, and return them; `first` is the first segment."""
        parts: list[bytes] = []
        answer = first
        while True:
            _demand(
                command_of(answer) & SEQUENCE_BITS == len(parts) + 1, "a segment of a block is out of order: %s", answer
            )
            parts.append(block_segment_data(answer))
            if command_of(answer) & BLOCK_LAST_SEGMENT or len(parts) == size:
                return parts
            answer = yield from self.hear()

    def download(self, index: int, sub_index: int, data: bytes) -> Talk[Abort | None]:
        """Write an object, expedited if it is short enough, else by segments; return the server's abort, or None."""
        is_short = 0 < len(data) <= EXPEDITED_BYTES
        command = EXPEDITED | (EXPEDITED_BYTES - len(data)) << 2 if is_short else 0
        content = data.ljust(4, b"\0") if is_short else len(data).to_bytes(4, "little")
        answer = yield from self.ask(with_data(DOWNLOAD | SIZE_GIVEN | command, index, sub_index, content))
        abort = _abort(answer, index, sub_index)
        if abort is not None:
            return abort
        _demand(answer == with_data(DOWNLOAD_ANSWER, index, sub_index), "a download is answered with %s", answer)
        toggle = 0
        for at in range(0, 0 if is_short else len(data), SEGMENT_BYTES):
            part = data[at : at + SEGMENT_BYTES]
            last = LAST_SEGMENT if at + SEGMENT_BYTES >= len(data) else 0
            command = SEGMENT_DOWNLOAD | toggle | SEGMENT_BYTES - len(part) << 1 | last
            answer = yield from self.ask(segment(command, part))
            abort = _abort(answer, index, sub_index)
            if abort is not None:
                return abort
            _demand(answer == segment(SEGMENT_DOWNLOAD_ANSWER | toggle, b""), "a segment is answered with %s", answer)
            toggle ^= TOGGLE
        return None

    def download_by_block(
        self, index: int, sub_index: int, data: bytes, *, loses: int = 0, checksum: int | None = None
    ) -> Talk[Abort | None]:
        """Write an object by SDO block transfer; return the server's abort, or None.

        loses: the segment of the first block that is not sent, counted from 1; 0: all are sent
        checksum: a wrong checksum to send; None for the right one
        """
        answer = yield from self.ask(
            with_number(BLOCK_DOWNLOAD | BLOCK_CRC | BLOCK_SIZE_GIVEN | BLOCK_INITIATE, index, sub_index, len(data))
        )
        abort = _abort(answer, index, sub_index)
        if abort is not None:
            return abort
        _demand(
            command_of(answer) == BLOCK_DOWNLOAD_ANSWER | BLOCK_CRC | BLOCK_INITIATE,
            "the begin of a block download is answered with %s",
            answer,
        )
        size, at = block_size(read_head(answer)[2]), 0
        while at < len(data):
            parts = [
                data[i : i + SEGMENT_BYTES] for i in range(at, min(len(data), at + size * SEGMENT_BYTES), SEGMENT_BYTES)
            ]
            answer = yield from self._send_block(parts, loses, is_last=at + size * SEGMENT_BYTES >= len(data))
            _demand(
                command_of(answer) == BLOCK_DOWNLOAD_ANSWER | BLOCK_ACKNOWLEDGE, "a block is answered with %s", answer
            )
            received, size = block_acknowledged(answer)
            _demand(
                received == (loses - 1 if loses else len(parts)),
                "a block download is acknowledged with a wrong count: %s",
                answer,
            )
            at, loses = at + received * SEGMENT_BYTES, 0
        unused = -len(data) % SEGMENT_BYTES
        end = block_end(BLOCK_DOWNLOAD | unused << 2 | BLOCK_END, crc(data) if checksum is None else checksum)
        answer = yield from self.ask(end)
        abort = _abort(answer, index, sub_index)
        _demand(
            abort is not None or answer == segment(BLOCK_DOWNLOAD_ANSWER | BLOCK_END, b""),
            "the end of a block download is answered with %s",
            answer,
        )
        return abort

    def _send_block(self, parts: list[bytes], loses: int, *, is_last: bool) -> Talk[bytes]:
        for number, part in enumerate(parts[:-1], start=1):
            if number != loses:
                yield Frame(self._request_id, segment(number, part)), -1, 2_000_000
        last = len(parts) | (BLOCK_LAST_SEGMENT if is_last else 0)
        return (yield from self.ask(segment(last, parts[-1])))


def _abort(answer: bytes, index: int, sub_index: int) -> Abort | None:
    """Return the reason if the answer aborts the transfer of this object; None if the answer is no abort."""
    if command_of(answer) != ABORT:
        return None
    *place, reason = read_head(answer)
    _demand(place == [index, sub_index], "an abort names another object: %s", answer)
    return Abort(read_length(reason))


def _demand(holds: bool, story: str, *told: bytes | int | None) -> None:
    if not holds:
        raise WrongAnswerError(story % tuple(map(_told, told)))


def _told(what: bytes | int | None) -> str:
    return what.hex(" ") if isinstance(what, bytes) else "nothing" if what is None else str(what)
