"""CANaerospace data frames against every known byte vector, and encoded and decoded again for all other values."""

import csv
import math
import struct
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from heronry_wire.canaerospace import (
    DataType,
    Datum,
    ErrorReport,
    Status,
    Validity,
    Value,
    decode_data,
    encode_data,
    encode_emergency_event,
    pack_status,
    unpack_status,
    value_range,
)
from heronry_wire.frame import Frame, Malformed, WireError

_VECTOR_FILE = Path(__file__).parent / "data" / "canaerospace_vectors.csv"
VECTORS = list(csv.DictReader(_VECTOR_FILE.read_text(encoding="utf-8").splitlines()))


def vector_frame(row: dict[str, str]) -> Frame:
    frame = Frame(int(row["can_id"]), bytes.fromhex(row["data"]), extended=row["extended"] == "1")
    assert len(frame.data) == int(row["dlc"])
    return frame


def read(frame: Frame) -> Datum:
    datum = decode_data(frame)
    assert isinstance(datum, Datum), datum
    return datum


@pytest.mark.parametrize("row", VECTORS, ids=lambda row: row["name"])
def test_every_vector_is_read_and_written_byte_for_byte(row: dict[str, str]) -> None:
    frame = vector_frame(row)
    assert encode_data(frame.can_id, read(frame), extended=frame.extended) == frame


def test_there_are_as_many_vectors_as_were_collected() -> None:
    assert len(VECTORS) == 66


# What the vectors mean, written by hand from the column `meaning`: the codec must not merely agree with itself.
MEANT = [
    ("spec_egt_short2", Datum(124, DataType.SHORT2, 0, 74, (16384, 1500))),
    ("spec_utc", Datum(1, DataType.CHAR4, 0, 0, (13, 43, 22, 0))),
    ("spec_date", Datum(1, DataType.CHAR4, 0, 0, (12, 6, 19, 87))),
    ("NODATA=0", Datum(1, DataType.NODATA, 0, 0, None)),
    ("FLOAT=2.5f", Datum(1, DataType.FLOAT, 0, 0, 2.5)),
    ("FLOAT=-1.5f", Datum(1, DataType.FLOAT, 0, 0, -1.5)),
    ("LONG=-2", Datum(1, DataType.LONG, 0, 0, -2)),
    ("ULONG=0xdeadbeefu", Datum(1, DataType.ULONG, 0, 0, 0xDEADBEEF)),
    ("BLONG=0x80000001u", Datum(1, DataType.BLONG, 0, 0, 0x80000001)),
    ("SHORT=-10", Datum(1, DataType.SHORT, 0, 0, -10)),
    ("USHORT=65535", Datum(1, DataType.USHORT, 0, 0, 65535)),
    ("BSHORT=0x8001", Datum(1, DataType.BSHORT, 0, 0, 0x8001)),
    ("CHAR=-128", Datum(1, DataType.CHAR, 0, 0, -128)),
    ("UCHAR=200", Datum(1, DataType.UCHAR, 0, 0, 200)),
    ("BCHAR=0xA5", Datum(1, DataType.BCHAR, 0, 0, 0xA5)),
    ("ACHAR='A'", Datum(1, DataType.ACHAR, 0, 0, "A")),
    ("USHORT2_51966_64206", Datum(1, DataType.USHORT2, 0, 0, (51966, 64206))),
    ("ACHAR4_w", Datum(1, DataType.ACHAR4, 7, 0, "WP01")),
    ("UCHAR3_c3", Datum(1, DataType.UCHAR3, 0, 0, (1, 2, 3))),
    ("UCHAR2_c3", Datum(1, DataType.UCHAR2, 0, 0, (1, 2))),
    ("EED_err=0x0102_op=3_loc=4", Datum(1, DataType.ERROR, 0, 0, ErrorReport(0x0102, 3, 4))),
    ("k_marshal_udef3", Datum(42, 100, 0, 0, bytes([12, 34, 56]))),
    ("k_param_pub", Datum(42, DataType.ACHAR2, 34, 1, "ab")),
    ("k_srv_resp_ch101", Datum(43, 100, 8, 1, b"")),
    ("k_dds_start", Datum(42, DataType.MEMID, 2, 2, 0xDEADBEEF)),
    ("k_dds_chk", Datum(42, DataType.CHKSUM, 2, 1, 0x215)),
]


@pytest.mark.parametrize(("name", "datum"), MEANT, ids=[name for name, _ in MEANT])
def test_a_vector_means_what_its_author_meant(name: str, datum: Datum) -> None:
    row = next(row for row in VECTORS if row["name"] == name)
    assert read(vector_frame(row)) == datum


def test_the_float_vector_is_pi_in_single_precision() -> None:
    value = read(Frame(311, bytes.fromhex("0102000040490FDB"))).value
    assert isinstance(value, float)
    assert math.isclose(value, math.pi, rel_tol=1e-7)


def test_a_double_travels_in_two_halves() -> None:
    high = read(Frame(1036, bytes.fromhex("011E000040481199")))
    low = read(Frame(1036, bytes.fromhex("011F00019999999A")))
    assert (high.data_type, low.data_type) == (DataType.DOUBLEH, DataType.DOUBLEL)
    assert struct.pack(">II", high.value, low.value) == struct.pack(">d", 48.1375)


@pytest.mark.parametrize(
    ("data_type", "least", "most"),
    [
        (DataType.FLOAT, -math.inf, math.inf),
        (DataType.CHAR, -128, 127),
        (DataType.BCHAR, 0, 255),
        (DataType.LONG, -(2**31), 2**31 - 1),
        (DataType.USHORT2, math.inf, -math.inf),
        (DataType.NODATA, math.inf, -math.inf),
    ],
)
def test_the_range_of_a_type_of_one_number(data_type: DataType, least: float, most: float) -> None:
    assert value_range(data_type) == (least, most)


def integers(bits: int, *, signed: bool) -> st.SearchStrategy[int]:
    return st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else st.integers(0, 2**bits - 1)


def values_of(data_type: DataType) -> st.SearchStrategy[Value]:
    """What the specification allows, from the name of the type alone."""
    name = data_type.name
    count = int(name[-1]) if name[-1].isdigit() else 1
    if data_type is DataType.NODATA:
        return st.none()
    if data_type is DataType.ERROR:
        char = integers(8, signed=True)
        return st.builds(ErrorReport, integers(16, signed=True), char, char)
    if data_type is DataType.FLOAT:
        return st.floats(width=32, allow_nan=False)
    if name.startswith("ACHAR"):
        return st.binary(min_size=count, max_size=count).map(lambda raw: raw.decode("latin-1"))
    bits = 16 if "SHORT" in name else 8 if "CHAR" in name else 32
    one = integers(bits, signed=name.rstrip("234") in {"LONG", "SHORT", "CHAR"})
    return one if count == 1 else st.tuples(*[one] * count)


byte = st.integers(0, 255)


@pytest.mark.parametrize("data_type", DataType, ids=lambda data_type: data_type.name)
@given(data=st.data(), node_id=byte, service_code=byte, message_code=byte)
def test_every_value_of_every_type_comes_back(
    data_type: DataType, data: st.DataObject, node_id: int, service_code: int, message_code: int
) -> None:
    datum = Datum(node_id, data_type, service_code, message_code, data.draw(values_of(data_type)))
    frame = encode_data(300, datum)
    assert len(frame.data) == 4 + data_type.payload_bytes
    assert decode_data(frame) == datum


def test_the_types_have_the_codes_and_lengths_of_the_specification() -> None:
    lengths = [0, 4, 4, 4, 4, 4, 2, 2, 2, 1, 1, 1, 4, 4, 4, 4, 4, 4, 2, 2, 2, 4, 4, 1, 2, 4, 3, 3, 3, 3, 4, 4]
    assert [(t.value, t.payload_bytes) for t in DataType] == list(enumerate(lengths))


def test_a_float_that_is_no_number_stays_none() -> None:
    frame = encode_data(300, Datum(92, DataType.FLOAT, 0, 0, math.nan))
    value = read(frame).value
    assert isinstance(value, float)
    assert math.isnan(value)


@given(st.binary(max_size=8), st.booleans(), st.booleans(), st.booleans())
def test_any_bytes_give_a_value_and_what_is_read_is_written_again(
    data: bytes, extended: bool, remote: bool, error: bool
) -> None:
    frame = Frame(300, data, extended, remote, error)
    datum = decode_data(frame)
    if isinstance(datum, Malformed):
        return
    assume(not (isinstance(datum.value, float) and math.isnan(datum.value)))  # the payload of a NaN may change
    assert encode_data(300, datum, extended=extended) == frame


@given(st.binary(min_size=9, max_size=12))
def test_more_bytes_than_a_frame_has_are_malformed(data: bytes) -> None:
    assert isinstance(decode_data(Frame(300, data)), Malformed)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        ("", "too few for the 4-byte header"),
        ("010200", "too few for the 4-byte header"),
        ("01020000BFC000", "FLOAT has 4 bytes of payload, not 3"),
        ("0100000000", "NODATA has 0 bytes of payload, not 1"),
        ("01200000", "reserved"),
        ("01630000", "reserved"),
    ],
)
def test_malformed_data_says_why(data: str, reason: str) -> None:
    result = decode_data(Frame(300, bytes.fromhex(data)))
    assert isinstance(result, Malformed)
    assert reason in result.reason


def test_remote_and_error_frames_are_no_data() -> None:
    good = bytes.fromhex("01000000")
    assert isinstance(decode_data(Frame(300, b"", remote=True)), Malformed)
    assert isinstance(decode_data(Frame(300, good, error=True)), Malformed)


@pytest.mark.parametrize(
    ("data_type", "value", "message"),
    [
        (DataType.SHORT, 40000, "SHORT cannot carry 40000: it takes -32768..32767"),
        (DataType.UCHAR, -1, "UCHAR cannot carry -1: it takes 0..255"),
        (DataType.FLOAT, 1e39, "FLOAT cannot carry 1e+39: it takes a number"),
        (DataType.FLOAT, "one", "FLOAT cannot carry 'one'"),
        (DataType.LONG, 1.5, "LONG cannot carry 1.5"),
        (DataType.LONG, None, "LONG cannot carry None"),
        (DataType.NODATA, 0, "NODATA cannot carry 0: it takes no value"),
        (DataType.SHORT2, (1,), "SHORT2 cannot carry (1,): it takes a tuple of 2, each -32768..32767"),
        (DataType.UCHAR3, (1, 2, 256), "it takes a tuple of 3, each 0..255"),
        (DataType.ERROR, ErrorReport(1, 2, 300), "it takes an ErrorReport"),
        (DataType.ACHAR2, "abc", "it takes text of exactly 2 Latin-1"),
        (DataType.ACHAR2, "a\u20ac", "it takes text of exactly 2 Latin-1"),
        (DataType.ACHAR2, b"ab", "it takes text of exactly 2 Latin-1"),
        (57, b"", "data type 57 is reserved"),
        (100, 1, "user-defined type 100 takes 0 to 4 raw bytes"),
        (255, b"12345", "user-defined type 255 takes 0 to 4 raw bytes"),
    ],
)
def test_an_impossible_value_is_refused_with_its_remedy(data_type: int, value: Value, message: str) -> None:
    with pytest.raises(WireError) as refused:
        encode_data(300, Datum(92, data_type, 0, 0, value))
    assert message in str(refused.value)


def test_an_impossible_header_or_identifier_is_refused() -> None:
    with pytest.raises(WireError, match=r"identifier 2048 is outside 0\.\.2047"):
        encode_data(2048, Datum(92, DataType.NODATA, 0, 0, None))
    with pytest.raises(WireError, match=r"identifier 536870912 is outside"):
        encode_data(1 << 29, Datum(92, DataType.NODATA, 0, 0, None), extended=True)
    with pytest.raises(WireError, match=r"header \(92, 0, 0, 256\) does not fit"):
        encode_data(300, Datum(92, DataType.NODATA, 0, 256, None))


def test_an_emergency_event_goes_out_under_the_number_of_its_node() -> None:
    frame = encode_emergency_event(94, ErrorReport(0x0102, 3, 4), service_code=5, message_code=6)
    assert frame == Frame(94, bytes.fromhex("5E01050601020304"))
    assert read(frame) == Datum(94, DataType.ERROR, 5, 6, ErrorReport(0x0102, 3, 4))
    with pytest.raises(WireError, match=r"0 is not the node-ID of any node: use 1\.\.127"):
        encode_emergency_event(0, ErrorReport(1, 0, 0))


@given(st.integers(1, 15), st.sampled_from(Validity))
def test_version_and_validity_share_byte_2(version: int, validity: Validity) -> None:
    code = pack_status(Status(version, validity))
    assert code == validity * 16 + version
    assert unpack_status(code) == Status(version, validity)


def test_other_codes_in_byte_2_are_malformed() -> None:
    read_codes = {code: unpack_status(code) for code in range(256)}
    assert sum(isinstance(status, Status) for status in read_codes.values()) == 15 * len(Validity)
    assert read_codes[0x10] == Malformed("the datum states no version (low nibble of byte 2 is 0)")
    assert read_codes[0x51] == Malformed("validity 5 is not defined")
    for version in (0, 16):
        with pytest.raises(WireError, match="a version from 1 to 15"):
            pack_status(Status(version, Validity.VALID))


def test_the_bytes_are_those_of_struct() -> None:
    frame = encode_data(300, Datum(1, DataType.FLOAT, 2, 3, 0.1))
    assert frame.data == struct.pack(">BBBBf", 1, 2, 2, 3, 0.1)
