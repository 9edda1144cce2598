"""A layout is one big number cut into fields: values are read as written, and a value that does not fit raises."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.layout import Field, Layout

NIBBLES = Layout("NIBBLES", Field("high", 4), Field("low", 4), Field("rest", 16))


@st.composite
def layouts_and_values(draw: st.DrawFn) -> tuple[Layout, tuple[int, ...]]:
    """A layout of one to eight bytes with cuts anywhere, and a value for each field."""
    total = 8 * draw(st.integers(1, 8))
    cuts = sorted(draw(st.sets(st.integers(1, total - 1), max_size=8)))
    widths = [end - start for start, end in zip([0, *cuts], [*cuts, total], strict=True)]
    values = tuple(draw(st.integers(0, (1 << bits) - 1)) for bits in widths)
    return Layout("ANY", *(Field(f"f{i}", bits) for i, bits in enumerate(widths))), values


def test_the_first_field_is_the_most_significant() -> None:
    assert NIBBLES.pack(0xA, 0xB, 0x0102) == bytes.fromhex("AB0102")
    assert NIBBLES.unpack(bytes.fromhex("AB0102")) == (0xA, 0xB, 0x0102)


@given(layouts_and_values())
def test_what_is_packed_is_unpacked(drawn: tuple[Layout, tuple[int, ...]]) -> None:
    layout, values = drawn
    data = layout.pack(*values)
    assert len(data) == layout.length
    assert layout.unpack(data) == values


@given(layouts_and_values(), st.binary(max_size=9))
def test_any_bytes_of_the_right_length_are_values_and_no_others(
    drawn: tuple[Layout, tuple[int, ...]], data: bytes
) -> None:
    layout, _ = drawn
    values = layout.unpack(data)
    assert (values is None) == (len(data) != layout.length)
    if values is not None:
        assert layout.pack(*values) == data


@pytest.mark.parametrize("values", [(16, 0, 0), (0, -1, 0), (0, 0, 0x10000)])
def test_a_value_that_does_not_fit_is_named(values: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"NIBBLES\.(high|low|rest) is -?\d+; it must be 0 to (15|65535)"):
        NIBBLES.pack(*values)


@pytest.mark.parametrize("count", [0, 2, 4])
def test_there_is_one_value_per_field(count: int) -> None:
    with pytest.raises(ValueError, match="argument"):
        NIBBLES.pack(*[0] * count)


@pytest.mark.parametrize("bits", [4, 12, 72])
def test_a_payload_is_whole_bytes_and_at_most_eight(bits: int) -> None:
    with pytest.raises(ValueError, match=f"layout ODD has {bits} bits"):
        Layout("ODD", Field("all", bits))
