"""Contingencies on board are read as they were written, and other bytes are refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.contingency_block import Preloaded, read_block, write_block
from heronry_wire.packing import PackingError, Unpacker, pack

HELD = st.lists(st.builds(Preloaded, st.binary(max_size=9), st.integers(1, 0xFFFFFF)), max_size=9)


@given(HELD)
def test_it_comes_back_as_it_was_written(held: list[Preloaded]) -> None:
    assert read_block(write_block(held)) == tuple(held)


def test_slices_are_kept_once() -> None:
    alike = [Preloaded(b"a long slice", 1), Preloaded(b"", 2), Preloaded(b"a long slice", 3)]
    numbers = Unpacker(write_block(alike))
    assert [numbers.text() for _ in range(numbers.number())] == [b"a long slice", b""]
    assert numbers.numbers() == [0, 1, 0]
    assert numbers.text() == bytes.fromhex("000001 000002 000003")


@given(st.binary(max_size=40))
def test_other_bytes_are_a_block_or_a_packing_error(data: bytes) -> None:
    try:
        held = read_block(data)
    except PackingError:
        return
    assert all(len(one.slice) <= len(data) for one in held)


@pytest.mark.parametrize(
    "numbers",
    [
        [0, 1, 0, 3, 0, 0, 1],  # a slice that is not there
        [1, 0, 1, 0, 2, 0, 1],  # too few digests
        [1, 0, 1, 0, 3, 0, 0, 1, 9],  # more than a block
        [1, 5],  # it ends early
    ],
)
def test_a_block_that_contradicts_itself_is_refused(numbers: list[int]) -> None:
    with pytest.raises(PackingError):
        read_block(pack(numbers))
