"""The part of the messages between agent and partition that concerns the states of modules (`partition_messages`).

An order carries a state as plain values. In the answers numbers are little-endian; each begins with its kind:

    SAVED     module, round, time in ns when it was saved, digest of the code (8 bytes), the state
    RESTORED  module, age in ns
    LACKING   module, why (`Lack`), reason
    UNUSED    module

The agent does not trust a partition: bytes that are no answer raise ValueError or struct.error here.
"""

import struct

from heronry_agent.core.vocabulary import KeptState, StateEvent, StateLacking, StateRestored, StateSaved, StateUnused
from heronry_wire.checkpoint_frames import DIGEST_BYTES, Lack, SentState

_SAVED, _RESTORED, _LACKING, _UNUSED = b"\x05", b"\x06", b"\x07", b"\x08"  # others have those before
_HEAD = struct.Struct("<cH")
_ROUND, _AGE, _WHY = struct.Struct("<Bq"), struct.Struct("<q"), struct.Struct("<B")
_REASON = 160  # characters


def kept_of(kept: KeptState | Lack | None) -> tuple[int | bytes, ...] | None:
    """Return a state, or why there is none, as plain values for an order."""
    match kept:
        case None:
            return None
        case Lack():
            return (int(kept),)
        case KeptState(state, since_ns, until_ns):
            return state.number, state.round, state.data, state.crc, since_ns, until_ns


def state_of(kept: tuple[int | bytes, ...] | None) -> KeptState | Lack | None:
    """Return what `kept_of` has made plain values of."""
    match kept:
        case (int(number), int(round_number), bytes(data), int(crc), int(since_ns), int(until_ns)):
            return KeptState(SentState(number, round_number, data, crc), since_ns, until_ns)
        case (int(lack),):
            return Lack(lack)
        case _:
            return None


def encode_state(answer: StateEvent) -> bytes:
    """Encode an answer about a state as a packet for the agent."""
    match answer:
        case StateSaved(module, round_number, code, data, saved_ns):
            return _HEAD.pack(_SAVED, module) + _ROUND.pack(round_number, saved_ns) + code + data
        case StateRestored(module, age_ns):
            return _HEAD.pack(_RESTORED, module) + _AGE.pack(age_ns)
        case StateLacking(module, lack, reason):
            return _HEAD.pack(_LACKING, module) + _WHY.pack(lack) + reason[:_REASON].encode("utf-8", "replace")
        case StateUnused(module):
            return _HEAD.pack(_UNUSED, module)


def is_state(packet: bytes) -> bool:
    """Tell whether a packet of a partition is an answer about a state."""
    return packet[:1] in (_SAVED, _RESTORED, _LACKING, _UNUSED)


def decode_state(packet: bytes) -> StateEvent:
    """Decode an answer about a state; raises struct.error or ValueError if the packet is none."""
    kind, module = _HEAD.unpack_from(packet)
    rest = packet[_HEAD.size :]
    if kind == _RESTORED:
        return StateRestored(module, *_AGE.unpack(rest))
    if kind == _LACKING:
        return StateLacking(module, Lack(_WHY.unpack(rest[:1])[0]), rest[1:].decode())
    if kind == _UNUSED:
        if rest:
            raise ValueError("an answer has bytes beyond its last value")
        return StateUnused(module)
    round_number, saved_ns = _ROUND.unpack_from(rest)
    code = rest[_ROUND.size : _ROUND.size + DIGEST_BYTES]
    if len(code) < DIGEST_BYTES:
        raise ValueError("a saved state has no digest of its code")
    return StateSaved(module, round_number, code, rest[_ROUND.size + DIGEST_BYTES :], saved_ns)
