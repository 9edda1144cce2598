"""Checkpoints on the wire: the bytes of a round, and how a receiver puts rounds together whatever it hears."""

import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.checkpoint_frames import (
    HEAD,
    MOST_STATE_BYTES,
    PART,
    Assembly,
    SentState,
    crc_24,
    frame_count,
)
from heronry_wire.identifiers import checkpoint_id

CODE = bytes(range(8))
LASTING_NS = 1_000_000_000


def division(message: bytes) -> int:
    """The remainder of long division by the generator, bit by bit: what RFC 4880 defines, from the start value 0."""
    number = int.from_bytes(message, "big") << 24
    for bit in reversed(range(24, number.bit_length())):
        if number >> bit & 1:
            number ^= 0x1864CFB << (bit - 24)
    return number


@given(st.binary(max_size=40))
def test_the_check_sum_is_the_remainder_of_a_division(message: bytes) -> None:
    assert crc_24(message) == division(message)


def test_the_check_sum_is_that_of_openpgp_but_for_its_start() -> None:
    start = (0xB704CE).to_bytes(3, "big")  # stands for the start value when it is added to the first three bytes
    message = b"123456789"
    assert crc_24(bytes(a ^ b for a, b in zip(message, start, strict=False)) + message[3:]) == 0x21CF02


def test_a_round_in_bytes() -> None:
    state = SentState.of(3, 250, bytes.fromhex("3ff8000000000000"), CODE)
    assert [(frame.can_id, frame.data.hex()) for frame in state.frames(93)] == [
        (1955, f"03fa000008{division(CODE + bytes((3, 250)) + state.data):06x}"),
        (1955, "03fa013ff8000000"),
        (1955, "03fa020000000000"),
    ]
    assert f"{state.crc:06x}" == "1dbf96"


def test_every_byte_of_a_frame_has_a_field() -> None:
    assert (HEAD.length, PART.length) == (8, 8)


@pytest.mark.parametrize(("length", "frames"), [(1, 2), (5, 2), (6, 3), (1275, 256)])
def test_a_state_takes_a_head_and_a_frame_for_five_bytes(length: int, frames: int) -> None:
    assert frame_count(length) == frames
    assert len(list(SentState.of(0, 0, bytes(length), CODE).frames(92))) == frames


def test_a_state_that_is_too_long_is_not_sent() -> None:
    with pytest.raises(ValueError, match="a state has 1276 bytes; it must have at most 1275"):
        list(SentState.of(0, 0, bytes(MOST_STATE_BYTES + 1), CODE).frames(92))


def test_the_code_the_number_and_the_round_are_part_of_the_check() -> None:
    state = SentState.of(3, 7, b"state", CODE)
    assert state.is_of(CODE)
    assert not state.is_of(bytes(8))
    assert not replace(state, number=4).is_of(CODE)
    assert not replace(state, round=8).is_of(CODE)
    assert not replace(state, data=b"stale").is_of(CODE)


def payloads(round_number: int, data: bytes, code: bytes = CODE) -> list[bytes]:
    return [frame.data for frame in SentState.of(1, round_number, data, code).frames(92)]


def taken(assembly: Assembly, frames: list[bytes], now_ns: int = 0) -> list[SentState]:
    return [state for frame in frames if (state := assembly.take(frame, now_ns)) is not None]


@given(st.binary(max_size=MOST_STATE_BYTES), st.integers(0, 255))
def test_what_is_sent_is_what_is_received(data: bytes, round_number: int) -> None:
    (state,) = taken(Assembly(LASTING_NS), payloads(round_number, data))
    assert state == SentState.of(1, round_number, data, CODE)


def test_copies_change_nothing() -> None:
    doubled = [frame for frame in payloads(9, b"twelve bytes") for _ in range(2)]
    again = payloads(9, b"twelve bytes")
    assert [state.data for state in taken(Assembly(LASTING_NS), doubled + again)] == [b"twelve bytes"]


def test_a_lost_frame_costs_its_round_and_no_other() -> None:
    lost, whole = payloads(9, b"twelve bytes"), payloads(10, b"eleven byte")
    for missing in range(len(lost)):
        assembly = Assembly(LASTING_NS)
        assert not taken(assembly, lost[:missing] + lost[missing + 1 :])
        assert [state.data for state in taken(assembly, whole)] == [b"eleven byte"]


def test_frames_of_two_rounds_are_never_mixed() -> None:
    first, second = payloads(9, bytes(12)), payloads(10, bytes(range(12)))
    assembly = Assembly(LASTING_NS)
    assert not taken(assembly, first[:2] + second[2:])
    assert not taken(assembly, first[2:])


def test_a_round_of_the_same_number_after_256_rounds_is_another_one() -> None:
    first, later = payloads(9, bytes(12)), payloads(9, bytes(range(12)))
    assembly = Assembly(LASTING_NS)
    assert not taken(assembly, first[:2])
    assert not taken(assembly, later[2:], LASTING_NS + 1)
    assert [state.data for state in taken(assembly, later, LASTING_NS + 2)] == [bytes(range(12))]
    assert not taken(assembly, later, 2 * LASTING_NS)
    assert len(taken(assembly, first, 2 * LASTING_NS + 3)) == 1


def test_a_restarted_sender_that_uses_the_number_of_a_broken_round_begins_anew() -> None:
    assembly = Assembly(LASTING_NS)
    assert not taken(assembly, payloads(0, bytes(12))[:2])
    assert [state.data for state in taken(assembly, payloads(0, bytes(range(12))))] == [bytes(range(12))]


def test_a_forged_part_ends_the_round() -> None:
    frames = payloads(9, bytes(12))
    assert not taken(Assembly(LASTING_NS), [*frames[:2], frames[1][:3] + b"other", *frames[2:]])


@pytest.mark.parametrize("length", [MOST_STATE_BYTES + 1, 0xFFFF])
def test_a_length_that_no_state_has_completes_nothing(length: int) -> None:
    frames = [HEAD.pack(1, 9, 0, length, 0), *(PART.pack(1, 9, place, 0) for place in range(1, 256))]
    assert not taken(Assembly(LASTING_NS), frames)


def test_what_fills_up_the_last_frame_is_zero() -> None:
    head, part = payloads(9, b"abc")
    assert not taken(Assembly(LASTING_NS), [head, part[:-1] + b"x"])


@pytest.mark.parametrize("length", [0, 1, 7])
def test_a_frame_of_another_length_is_dropped(length: int) -> None:
    frames = payloads(9, b"abc")
    assert len(taken(Assembly(LASTING_NS), [frames[0], frames[1][:length], frames[1]])) == 1


@given(st.randoms(use_true_random=False))
def test_whatever_is_heard_what_is_whole_was_sent(rng: random.Random) -> None:
    """Frames of some rounds are lost, doubled, swapped and forged: a state with the right CRC is one that was sent."""
    sent = {(n % 256, rng.randbytes(rng.randint(1, 12))) for n in range(rng.randint(1, 4))}
    heard = [
        frame for number, data in sorted(sent) for frame in payloads(number, data) for _ in range(rng.randint(0, 2))
    ]
    for _ in range(rng.randint(0, 3)):
        at, other = rng.randrange(len(heard) + 1), rng.randrange(len(heard) + 1)
        heard[at:at] = heard[other : other + 2] if rng.random() < 0.6 else [rng.randbytes(rng.choice((8, 8, 8, 3)))]
    whole = taken(Assembly(LASTING_NS), heard)
    assert {(state.round, state.data) for state in whole if state.is_of(CODE)} <= sent


def test_the_identifiers_are_the_lowest_of_all_that_a_pe_sends() -> None:
    assert [checkpoint_id(node) for node in (92, 125)] == [1954, 1987]
