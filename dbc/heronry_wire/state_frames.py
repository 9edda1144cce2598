"""State frames: the report of a PE in every heartbeat period, in four pages, and their bytes.

    page 0   the running configuration: in every period, on each bus of the PE
    page 1   the staged configuration, or why there is none, and the load: on change and with every tenth page 0
    page 2   with a key: the nonce with which a PE requests a new session
    page 3   with a key: the digest of the running configuration, and the number of refused commands

Every page begins with one byte (`_HEAD`): the number of the page, the PE's progress in its epoch, and its flags.
No flag is free. The highest bit of the field `state` is, but an older node takes a frame with that bit for malformed,
and loses the PE: so a fact that a PE tells is rather a code of EMCY or a CANopen object (docs/protocol/growth.md). To
add a field to a page, add a `Field` to the page's layout and a field to its dataclass, in the same order.

With a key, pages 0 and 1 carry a tag in the place of their digest (docs/protocol/authentication.md): `split_state`
takes a digest or tag out, and `joined_state` puts a tag in. Some functions below give a single field, and are faster
than decoding the whole page. Only this file contains the positions of the bytes.

Malformed bytes decode to `Malformed` with a reason; encoding a number that does not fit raises ValueError.

Source: docs/protocol.md, protocol rules 1, 8 and 11.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, IntFlag

from heronry_wire.frame import Malformed
from heronry_wire.layout import Field, Layout


class PeState(IntEnum):
    """How far a PE has taken the steps of the epoch that its state frame names."""

    UNCONFIGURED = 0  # no step has been taken since the start
    BROKEN = 1  # the step BREAK is taken
    PARTIAL = 2  # the step GO is taken, and DEMUX branches that are new on this PE wait for GO_ALL
    ACTIVE = 3  # the step GO_ALL is taken, or GO if no DEMUX branch is new on this PE


class PeFlags(IntFlag):
    """Flags of a PE in every state frame."""

    HEARS_LEASE = 1  # the PE hears a manager
    FAULT_PENDING = 2  # the PE has an EMCY that is not acknowledged
    OUTPUT_HELD = 4  # exclusive outputs of the PE are not authorized now


class Reason(IntEnum):
    """Why a PE has not staged a configuration, or why it last refused a command."""

    NONE = 0
    INCOMPLETE = 1  # frames of the slice are missing: send it again
    DIGEST = 2  # the bytes do not have the announced digest, or the PE has the table of another spec
    UNKNOWN_INDEX = 3  # the slice has an index that the table does not have
    IMAGE = 4  # this PE cannot load an image
    STALE_TERM = 5  # a higher term has been heard
    STALE_EPOCH = 6  # this epoch, or a newer one, has been staged or abandoned before
    NOT_ON_BOARD = 7  # the PE's table does not have this contingency under this number: send the slice


_STATES = {state.value: state.name for state in PeState}
_REASONS = {reason.value: reason.name for reason in Reason}

_HEAD = Layout("STATE_HEAD", Field("page", 2), Field("state", 3, _STATES), Field("flags", 3))
STATE_0 = Layout(
    "STATE_0", *_HEAD.fields, Field("incarnation", 8), Field("epoch", 16), Field("sequence", 8), Field("digest", 24)
)
STATE_1 = Layout(
    "STATE_1",
    *_HEAD.fields,
    Field("staged_epoch", 16),
    Field("staged_digest", 24),
    Field("reason", 8, _REASONS),
    Field("load", 8, unit="%"),
)
STATE_2 = Layout("STATE_2", *_HEAD.fields, Field("nonce", 56))
STATE_3 = Layout("STATE_3", *_HEAD.fields, Field("runs_digest", 24), Field("unproven", 16), Field("other", 16))

STATE_BYTES = STATE_0.length
IN_EVERY_PAGE = frozenset(field.name for field in _HEAD.fields)


@dataclass(frozen=True, slots=True)
class StatePage0:
    """Page 0: the running configuration of a PE."""

    state: PeState
    flags: PeFlags
    incarnation: int
    epoch: int
    sequence: int
    digest: int

    def encode(self) -> bytes:
        """Encode the payload of a state frame, page 0."""
        return STATE_0.pack(0, self.state, self.flags, self.incarnation, self.epoch, self.sequence, self.digest)


@dataclass(frozen=True, slots=True)
class StatePage1:
    """Page 1: the epoch of the last PREPARE, what is staged for it, and the CPU load in per cent.

    staged_digest: digest of the whole configuration whose slice is staged; 0 while frames of the slice are missing.
    reason: why nothing is staged, or why the PE has refused a command.
    """

    state: PeState
    flags: PeFlags
    staged_epoch: int
    staged_digest: int
    reason: Reason
    load: int

    def encode(self) -> bytes:
        """Encode the payload of a state frame, page 1."""
        return STATE_1.pack(
            1, self.state, self.flags, self.staged_epoch, self.staged_digest, self.reason, min(self.load, 255)
        )


@dataclass(frozen=True, slots=True)
class StatePage2:
    """Page 2: a PE with a key requests a new session; WELCOME answers its nonce (protocol rule 11)."""

    state: PeState
    flags: PeFlags
    nonce: int

    def encode(self) -> bytes:
        """Encode the payload of a state frame, page 2."""
        return STATE_2.pack(2, self.state, self.flags, self.nonce)


@dataclass(frozen=True, slots=True)
class StatePage3:
    """Page 3, with a key: digest of the running configuration, and how many commands the PE has refused, modulo 2^16.

    unproven: refused commands with an invalid tag. other: commands refused for other reasons.
    """

    state: PeState
    flags: PeFlags
    digest: int
    unproven: int
    other: int

    def encode(self) -> bytes:
        """Encode the payload of a state frame, page 3."""
        return STATE_3.pack(3, self.state, self.flags, self.digest, self.unproven, self.other)


StatePage = StatePage0 | StatePage1 | StatePage2 | StatePage3


def decode_state(data: bytes) -> StatePage | Malformed:
    """Decode a state frame, any page."""
    if len(data) != STATE_BYTES:
        return _NO_STATE
    page, state, flags = _HEADS[data[0]]
    return _NO_STATE if state is None else _PAGES[page](state, flags, data)


def page_of(data: bytes) -> int | None:
    """Number of the page, from the first byte of a state frame; None where the frame is empty."""
    return _HEADS[data[0]][0] if data else None


def epoch_of(page_0: bytes) -> int:
    """Return the number of the epoch in the bytes of a page 0; the caller has checked their length."""
    return int.from_bytes(page_0[_EPOCH_FROM:_EPOCH_TO], "big")


def sequence_of(page_0: bytes) -> int:
    """Return the sequence number in a page 0; the bytes after that number may be missing."""
    return page_0[_SEQUENCE_FROM]


def without_sequence(data: bytes) -> bytes:
    """Return a state frame without the byte that holds the sequence in page 0, so that repeated states are equal."""
    return data[:_SEQUENCE_FROM] + data[_SEQUENCE_TO:]


def split_state(data: bytes) -> tuple[bytes, int]:
    """Take the digest, or the tag in its place, out of a page 0 or 1; gives the other bytes, and the digest or tag."""
    first, after = _tag_place(data)
    return data[:first] + data[after:], int.from_bytes(data[first:after], "big")


def joined_state(said: bytes, tag: int) -> bytes:
    """Return a page 0 or 1 with a tag in the place of its digest.

    said: the other bytes of the page, as `split_state` gives them.
    """
    first, after = _tag_place(said)
    return said[:first] + tag.to_bytes(after - first, "big") + said[first:]


def _tag_place(data: bytes) -> tuple[int, int]:
    return _STAGED_DIGEST if page_of(data) else _DIGEST


def _page_0(state: PeState, flags: PeFlags, data: bytes) -> StatePage0:
    return StatePage0(state, flags, *STATE_0.fields_of(data)[3:])


def _page_1(state: PeState, flags: PeFlags, data: bytes) -> StatePage1 | Malformed:
    staged_epoch, staged_digest, reason, load = STATE_1.fields_of(data)[3:]
    if reason not in _REASONS:
        return Malformed("STATE page 1 has an unknown reason")
    return StatePage1(state, flags, staged_epoch, staged_digest, Reason(reason), load)


def _page_2(state: PeState, flags: PeFlags, data: bytes) -> StatePage2:
    return StatePage2(state, flags, *STATE_2.fields_of(data)[3:])


def _page_3(state: PeState, flags: PeFlags, data: bytes) -> StatePage3:
    return StatePage3(state, flags, *STATE_3.fields_of(data)[3:])


def _head(byte: int) -> tuple[int, PeState | None, PeFlags]:
    page, state, flags = _HEAD.fields_of(bytes((byte,)))
    return page, PeState(state) if state in _STATES else None, PeFlags(flags)


_NO_STATE = Malformed("STATE has a wrong length or state")
_HEADS = tuple(_head(byte) for byte in range(256))  # by the first byte; precomputed for speed
_PAGES: tuple[Callable[[PeState, PeFlags, bytes], StatePage | Malformed], ...] = (_page_0, _page_1, _page_2, _page_3)
_EPOCH_FROM, _EPOCH_TO = STATE_0.span("epoch")
_SEQUENCE_FROM, _SEQUENCE_TO = STATE_0.span("sequence")
NEWS_MASK = (1 << 8 * STATE_BYTES) - (1 << 8 * (STATE_BYTES - _SEQUENCE_FROM))
"""Mask of a state frame's bytes before the sequence of page 0: what another PE has to hear of at once."""

_DIGEST, _STAGED_DIGEST = STATE_0.span("digest"), STATE_1.span("staged_digest")
