"""The frames that carry the state of a module to the PEs on which the module may start (protocol rule 10).

A state is sent in a *round*: one frame after another under the identifier of the sender (`checkpoint_id`). Each frame
has 8 bytes:

    byte 0     number of the module among the modules with `checkpoint`, from 0 in the spec's order
    byte 1     number of the round: 0..255, then 0 again
    byte 2     number of the frame in the round, from 0
    byte 3..7  in frame 0: length of the state in bytes (2 bytes), and a CRC (3 bytes); in the others: 5 bytes of the
               state, in the last one filled up with zeros

The CRC is that of OpenPGP (RFC 4880, section 6.1: generator 864CFBh) with the start value 0, over the digest of the
module's code (8 bytes), bytes 0 and 1 of the frames, and the state. So a state of another version of the code has a
wrong CRC, although the version is not sent.

A round of frame 0 alone, with the length 0, carries the empty state: the states that were sent before are void.

*Assembly.* CAN keeps the frames of one identifier in their order. So the receiver takes frame 0, and then only the
next frame of the same round:

    idle        frame 0 begins a round
    gathering   the next frame is added; a copy of a frame that was added is dropped; any other frame ends the round,
                and a frame 0 begins another one. A round whose first frame is older than `lasting_ns` has ended, too:
                rounds have the same number again after 256 rounds
    whole       the state is complete. Frames of this round are copies, and are dropped

So a lost frame costs its round, and frames of two rounds are never mixed. A restarted sender begins with any round: if
that is the round that came last, its frames count as copies, and the next round is taken. A forged frame ends the
round, or begins a false one: checkpoints are not authenticated, as all data (docs/limits.md). A receiver that has
restarted waits for the next frame 0. Nothing here raises an exception for any bytes.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

from heronry_wire.frame import Frame
from heronry_wire.identifiers import checkpoint_id
from heronry_wire.layout import Field, Layout

PART_BYTES = 5
"""Bytes of the state in one frame."""

MOST_STATE_BYTES = 255 * PART_BYTES
"""Longest state in bytes: that of 255 frames after frame 0."""

MOST_CHECKPOINTS = 256
"""Most modules with a checkpoint: the number of a module has one byte."""

DIGEST_BYTES = 8
"""Length of the digest of a module's code."""

ROUNDS = 256


class Lack(IntEnum):
    """Why a module has started without its state (below 16), or why its state cannot be saved."""

    NO_STATE = 1  # none was saved here, and none has come from another PE
    TOO_OLD = 2
    OTHER_CODE = 3  # another version of the code has saved it, or it is damaged
    REFUSED = 4  # `restore` has raised an exception, or hung
    RAISES = 16  # `save` raises an exception
    HANGS = 17
    TOO_LONG = 18
    NO_NUMBERS = 19  # `save` gives something else than numbers, or an infinite one, or NaN

    @property
    def is_of_save(self) -> bool:
        """Tell whether the state cannot be saved."""
        return self >= Lack.RAISES


_PLACE = (Field("module", 8), Field("round", 8), Field("frame", 8))
HEAD = Layout("CHECKPOINT_HEAD", *_PLACE, Field("length", 16, unit="byte"), Field("crc", 24))
PART = Layout("CHECKPOINT_PART", *_PLACE, Field("state", 40))

_GENERATOR = 0x864CFB


def _crc_of_byte(byte: int) -> int:
    crc = byte << 16
    for _ in range(8):
        crc = crc << 1 ^ (_GENERATOR | 1 << 24 if crc & 0x800000 else 0)
    return crc


_CRC_OF_BYTE = tuple(map(_crc_of_byte, range(256)))


def crc_24(data: bytes) -> int:
    """Return the CRC-24 of OpenPGP over `data`, with the start value 0: a number of 24 bits."""
    crc = 0
    for byte in data:
        crc = crc << 8 & 0xFFFFFF ^ _CRC_OF_BYTE[crc >> 16 ^ byte]
    return crc


def frame_count(state_bytes: int) -> int:
    """Return how many frames a state of `state_bytes` bytes takes: one, and one for each 5 bytes begun."""
    return 1 - -state_bytes // PART_BYTES


def number_of(payload: bytes) -> int:
    """Return the number of the module of a frame; -1 if the frame is empty."""
    return payload[0] if payload else -1


@dataclass(frozen=True, slots=True)
class SentState:
    """The state of a module as one round carries it.

    number: of the module among those with a checkpoint. round: 0..255. crc: as in frame 0.
    """

    number: int
    round: int
    data: bytes
    crc: int

    @classmethod
    def of(cls, number: int, round: int, data: bytes, code_digest: bytes) -> "SentState":  # noqa: A002 - as in wire
        """Return a state with its CRC; `code_digest`: digest of the module's code, 8 bytes."""
        return cls(number, round, data, _crc(number, round, data, code_digest))

    def is_of(self, code_digest: bytes) -> bool:
        """Tell whether the state is undamaged, and was saved by the code with this digest."""
        return self.crc == _crc(self.number, self.round, self.data, code_digest)

    def frames(self, node_id: int) -> Iterator[Frame]:
        """Yield the frames of the round, as the PE `node_id` sends them.

        Raises ValueError for a state of more than MOST_STATE_BYTES bytes.
        """
        if len(self.data) > MOST_STATE_BYTES:
            raise ValueError(f"a state has {len(self.data)} bytes; it must have at most {MOST_STATE_BYTES}")
        can_id = checkpoint_id(node_id)
        yield Frame(can_id, HEAD.pack(self.number, self.round, 0, len(self.data), self.crc))
        for place in range(1, frame_count(len(self.data))):
            part = self.data[(place - 1) * PART_BYTES : place * PART_BYTES].ljust(PART_BYTES, b"\0")
            yield Frame(can_id, bytes((self.number, self.round, place)) + part)


def _crc(number: int, round_number: int, data: bytes, code_digest: bytes) -> int:
    return crc_24(code_digest + bytes((number, round_number)) + data)


class Assembly:
    """Puts together the states that one PE sends of one module."""

    __slots__ = ("_begun_ns", "_frames", "_lasting_ns", "_whole", "_whole_ns")

    def __init__(self, lasting_ns: int) -> None:
        """Begin idle. `lasting_ns`: time from the first frame after which a round that is not complete has ended."""
        self._lasting_ns = lasting_ns
        self._frames: list[bytes] = []  # payloads of the present round, in their order
        self._whole: int | None = None  # the last complete round
        self._begun_ns = self._whole_ns = 0  # when the present round began, and when the last complete one did

    def take(self, payload: bytes, now_ns: int) -> SentState | None:
        """Take the 8 bytes of a frame that arrived at `now_ns`; returns the state that it completes, otherwise None."""
        if len(payload) != PART.length:
            return None
        round_number, place = payload[1], payload[2]
        if self._whole == round_number and now_ns - self._whole_ns <= self._lasting_ns:
            return None
        frames = self._frames
        if frames and (frames[0][1] != round_number or now_ns - self._begun_ns > self._lasting_ns):
            frames.clear()
        if place < len(frames):
            if frames[place] == payload:
                return None
            frames.clear()
        if place != len(frames):
            frames.clear()
            return None
        if not place:
            self._begun_ns = now_ns
        frames.append(payload)
        return self._completed()

    def _completed(self) -> SentState | None:
        """Return the state if its last frame is there, and forget the frames then; otherwise None."""
        number, round_number, _, length, crc = HEAD.fields_of(self._frames[0])
        if len(self._frames) < frame_count(length):
            return None
        parts = b"".join([frame[3:] for frame in self._frames[1:]])
        self._whole, self._whole_ns = round_number, self._begun_ns
        self._frames.clear()
        if length > MOST_STATE_BYTES or any(parts[length:]):
            return None
        return SentState(number, round_number, parts[:length], crc)
