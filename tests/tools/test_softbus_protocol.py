"""Records of the software bus: an encoded record is decoded again, and no bytes raise."""

from hypothesis import given
from hypothesis import strategies as st

from heronry_tools.runtime.softbus.protocol import (
    RECORD_BYTES,
    BusFrame,
    BusStatistics,
    ClientStatistics,
    decode_command,
    decode_filters,
    decode_frame,
    decode_statistics,
    decode_thinned,
    decode_withdrawal,
    encode_command,
    encode_frame,
    encode_withdrawal,
    is_command,
)
from heronry_wire.frame import EXTENDED_MASK, STANDARD_MASK, Frame, Malformed
from heronry_wire.frame_port import Haste
from heronry_wire.thinning import Thinned

times_ns = st.integers(-(2**63), 2**63 - 1)


@st.composite
def bus_frames(draw: st.DrawFn) -> BusFrame:
    extended, remote = draw(st.booleans()), draw(st.booleans())
    can_id = draw(st.integers(0, EXTENDED_MASK if extended else STANDARD_MASK))
    dlc = draw(st.integers(0, 8))
    data = b"" if remote else draw(st.binary(min_size=dlc, max_size=dlc))
    own, haste = draw(st.booleans()), draw(st.sampled_from(Haste))
    return BusFrame(Frame(can_id, data, extended, remote), dlc, draw(times_ns), own, haste)


@given(bus_frames())
def test_a_frame_comes_back_as_it_was(sent: BusFrame) -> None:
    record = encode_frame(sent)
    assert decode_frame(record) == sent
    assert not is_command(record)


@given(st.binary(min_size=RECORD_BYTES, max_size=RECORD_BYTES) | st.binary(max_size=64))
def test_any_bytes_are_a_frame_that_fits_or_a_reason(record: bytes) -> None:
    match decode_frame(record):
        case Malformed(reason):
            assert reason
        case BusFrame(frame, dlc):
            assert dlc <= 8
            assert frame.can_id <= (EXTENDED_MASK if frame.extended else STANDARD_MASK)


@given(st.binary() | st.text().map(str.encode))
def test_any_bytes_are_a_command_or_a_reason(record: bytes) -> None:
    assert isinstance(decode_command(record), dict | Malformed)


def test_a_command_nested_beyond_all_measure_is_malformed() -> None:
    assert isinstance(decode_command(b'{"a":' + b"[" * 60_000), Malformed)


@given(st.recursive(st.none() | st.booleans() | st.integers() | st.text(), st.lists))
def test_anything_is_filters_or_a_reason(content: object) -> None:
    assert isinstance(decode_filters(content), tuple | Malformed)


@given(st.lists(st.tuples(st.integers(0), st.integers(0), st.none() | st.booleans())))
def test_filters_come_back_as_they_were(filters: list[tuple[int, int, bool | None]]) -> None:
    command = decode_command(encode_command({"filters": filters}))
    assert isinstance(command, dict)
    assert decode_filters(command["filters"]) == tuple(filters)


def test_statistics_come_back_as_they_were() -> None:
    clients = (ClientStatistics(1, 4711, 5, 6, 7), ClientStatistics(2, 4712, 0, 0, 0))
    earlier = BusStatistics(500_000, 1_000, 100, 1, clients)
    answer = decode_command(encode_command(earlier._asdict()))
    assert isinstance(answer, dict)
    assert decode_statistics(answer) == earlier
    assert earlier._replace(time_ns=2_000, busy_ns=350).load_since(earlier) == 0.25


@given(st.frozensets(st.integers(0, STANDARD_MASK)))
def test_a_withdrawal_comes_back_as_it_was_and_is_no_other_record(identifiers: frozenset[int]) -> None:
    record = encode_withdrawal(identifiers)
    assert decode_withdrawal(record) == identifiers
    assert not is_command(record)


@given(bus_frames())
def test_a_frame_is_no_withdrawal(sent: BusFrame) -> None:
    assert decode_withdrawal(encode_frame(sent)) is None
    assert decode_withdrawal(b"W1") is None


def test_a_group_to_thin_comes_back_or_a_reason() -> None:
    content = {"identifiers": [257], "signs": [200], "mask": 7, "every_ns": 30}
    assert decode_thinned(content) == Thinned(frozenset((257,)), frozenset((200,)), 7, 30)
    for wrong in ({}, content | {"mask": "7"}, content | {"signs": ["200"]}):
        assert isinstance(decode_thinned(wrong), Malformed)
