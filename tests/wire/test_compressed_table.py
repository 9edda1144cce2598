"""The bytes of a table on the bus: compressed or plain, whole or refused."""

import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.compressed_table import compressed, table_bytes
from heronry_wire.pe_table import TableError

MOST = 1_000
TEXT = '{"key": "value", "list": [1, 2, 3, 1, 2, 3, 1, 2, 3]}'


@given(st.text(alphabet=st.characters(codec="utf-8"), max_size=200))
def test_what_is_compressed_can_be_read(text: str) -> None:
    assert table_bytes(compressed(text), MOST).decode() == text


def test_plain_text_is_read_as_it_is() -> None:
    assert table_bytes(TEXT.encode(), MOST) == TEXT.encode()
    assert table_bytes(b"", MOST) == b""


def test_a_part_a_longer_one_and_a_damaged_one_are_refused() -> None:
    whole = compressed(TEXT)
    assert table_bytes(whole, len(TEXT)) == TEXT.encode()
    for content in [*(whole[:length] for length in range(1, len(whole))), whole + b"\0"]:
        with pytest.raises(TableError, match="send it again"):
            table_bytes(content, MOST)
    for place in range(1, len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x10
        assert read(bytes(damaged)) in (TEXT.encode(), None)


def read(content: bytes) -> bytes | None:
    """Give the text; None: it is refused."""
    try:
        return table_bytes(content, MOST)
    except TableError:
        return None


def test_a_few_bytes_cannot_fill_the_memory() -> None:
    with pytest.raises(TableError, match="longer than 1000 bytes"):
        table_bytes(zlib.compress(bytes(1 << 20), 9), MOST)
