"""The text forms of a frame: a written frame is read back, broken text gives a value."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.frame import (
    Frame,
    LoggedFrame,
    Malformed,
    arbitration_key,
    format_frame,
    format_log_line,
    parse_frame,
    parse_log_line,
)

data = st.binary(max_size=8)
standard_ids, extended_ids = st.integers(0, 0x7FF), st.integers(0, 0x1FFF_FFFF)
no, yes = st.just(value=False), st.just(value=True)
frames = st.one_of(
    st.builds(Frame, standard_ids, data, no, no, no),
    st.builds(Frame, extended_ids, data, yes, no, no),
    st.builds(Frame, standard_ids, st.just(b""), st.booleans(), yes, no),
    st.builds(Frame, extended_ids, data, no, no, yes),
)


@pytest.mark.parametrize(
    ("text", "frame"),
    [
        ("130#01020000BFC00000", Frame(0x130, bytes.fromhex("01020000BFC00000"))),
        ("000#", Frame(0, b"")),
        ("00010130#01", Frame(0x10130, b"\x01", extended=True)),
        ("00000130#", Frame(0x130, b"", extended=True)),
        ("7FF#R", Frame(0x7FF, b"", remote=True)),
        ("1FFFFFFF#R", Frame(0x1FFFFFFF, b"", extended=True, remote=True)),
        ("20000040#0000000000000000", Frame(0x40, bytes(8), error=True)),
    ],
)
def test_the_candump_notation_both_ways(text: str, frame: Frame) -> None:
    assert parse_frame(text) == frame
    assert format_frame(frame) == text


def test_a_remote_frame_forgets_the_length_it_asks_for() -> None:
    assert parse_frame("123#R8") == Frame(0x123, b"", remote=True)


def test_lower_case_is_read() -> None:
    assert parse_frame("1ab#beef") == Frame(0x1AB, b"\xbe\xef")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "not a classical CAN frame"),
        ("130", "not a classical CAN frame"),
        ("130#0", "not a classical CAN frame"),
        ("0130#00", "not a classical CAN frame"),
        ("130##100", "not a classical CAN frame"),  # CAN FD
        ("130#000102030405060708", "not a classical CAN frame"),
        ("130#R9", "not a classical CAN frame"),
        ("130#00\n", "not a classical CAN frame"),
        ("\u0661\u0663\u0660#00", "not a classical CAN frame"),
        ("800#00", "more than 11 bits"),
        ("40000000#00", "more than 29 bits"),
        ("20000040#R", "more than 29 bits"),
    ],
)
def test_broken_text_is_a_value_with_its_reason(text: str, reason: str) -> None:
    parsed = parse_frame(text)
    assert isinstance(parsed, Malformed)
    assert reason in parsed.reason


@given(frames)
def test_every_frame_survives_its_text(frame: Frame) -> None:
    assert parse_frame(format_frame(frame)) == frame


@given(frames, st.integers(0, 10**21 - 1), st.sampled_from(["can0", "vcan0", "radio"]))
def test_every_frame_survives_a_log(frame: Frame, time_ns: int, channel: str) -> None:
    logged = LoggedFrame(time_ns, channel, frame)
    assert parse_log_line(format_log_line(logged) + "\n") == logged


def test_a_log_line_is_what_candump_writes() -> None:
    line = "(1436509052.249713) can0 044#2A366C2BBA"
    logged = LoggedFrame(1_436_509_052_249_713_000, "can0", Frame(0x44, bytes.fromhex("2A366C2BBA")))
    assert parse_log_line(line) == logged
    assert format_log_line(logged) == line
    assert parse_log_line(line + " R") == logged


def test_a_finer_clock_keeps_its_nanoseconds() -> None:
    logged = LoggedFrame(12_000_345_678, "can0", Frame(1, b""))
    assert format_log_line(logged) == "(0000000012.000345678) can0 001#"


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("", "not a candump log line"),
        ("12.5 can0 123#00", "not a candump log line"),
        ("(12) can0 123#00", "not a candump log line"),
        ("(12.5) 123#00", "not a candump log line"),
        ("(12.5) can0 123#0", "not a classical CAN frame"),
    ],
)
def test_a_broken_log_line_is_a_value(line: str, reason: str) -> None:
    parsed = parse_log_line(line)
    assert isinstance(parsed, Malformed)
    assert reason in parsed.reason


@given(st.text())
def test_any_text_gives_a_value(text: str) -> None:
    assert isinstance(parse_frame(text), Frame | Malformed)
    assert isinstance(parse_log_line(text), LoggedFrame | Malformed)


def sent_bits(frame: Frame) -> list[int]:
    """Bits that a node sends until arbitration ends, from the frame formats of ISO 11898-1."""
    if frame.extended:
        base, extension = f"{frame.can_id >> 18:011b}", f"{frame.can_id & 0x3FFFF:018b}"
        return [int(bit) for bit in f"{base}11{extension}{frame.remote:d}"]
    return [int(bit) for bit in f"{frame.can_id:011b}{frame.remote:d}0"]


traffic = frames.filter(lambda frame: not frame.error)


@given(traffic, traffic)
def test_the_smaller_key_is_the_frame_whose_dominant_bit_comes_first(one: Frame, other: Frame) -> None:
    winner = next(((a < b) for a, b in zip(sent_bits(one), sent_bits(other), strict=False) if a != b), None)
    keys = arbitration_key(one), arbitration_key(other)
    assert (keys[0] < keys[1]) == (winner is True)
    assert (keys[0] == keys[1]) == (winner is None)


def test_a_redundant_29_bit_frame_beats_every_emergency_event_but_none_with_base_0() -> None:
    roll_rate_on_channel_1 = Frame(0x10130, b"", extended=True)
    order = sorted([Frame(1, b""), roll_rate_on_channel_1, Frame(0, b"")], key=arbitration_key)
    assert order == [Frame(0, b""), roll_rate_on_channel_1, Frame(1, b"")]
