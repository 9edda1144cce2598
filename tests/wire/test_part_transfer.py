"""The bytes of what comes in parts."""

from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.part_transfer import Part, Received, Transfer

digests = st.binary(min_size=32, max_size=32)
numbers = st.integers(0, 0xFFFF_FFFF)


@given(digests, numbers, numbers, st.binary(min_size=1))
def test_a_part_is_read_as_it_was_written(digest: bytes, length: int, at: int, data: bytes) -> None:
    part = Part(Transfer(digest, length), at, data)
    assert Part.decode(part.encode()) == part


@given(digests, numbers)
def test_how_far_a_transfer_has_come_is_read_as_it_was_written(digest: bytes, length: int) -> None:
    received = Received(digest, length)
    assert Received.decode(received.encode()) == received


@given(st.binary(max_size=40))
def test_what_is_too_short_is_none(content: bytes) -> None:
    assert Part.decode(content) is None
    assert (Received.decode(content) is None) is (len(content) != 36)
