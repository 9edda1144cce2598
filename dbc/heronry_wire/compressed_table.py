"""The bytes of a PE's table on the bus: its text, compressed by zlib (RFC 1950); plain text is read, too.

Compression makes 28 kB of text into 5 kB. A zlib stream with the usual window begins with the byte 78h, and the text
of a table with a brace, so the first byte tells one from the other. This file keeps no state.
"""

import zlib

from heronry_wire.pe_table import TableError

_ZLIB_BEGINS = b"\x78"
_BEST = 9


def compressed(text: str) -> bytes:
    """Compress the text of a table; the same text always gives the same bytes."""
    return zlib.compress(text.encode(), _BEST)


def table_bytes(content: bytes, most: int) -> bytes:
    """Return the text of a table, as bytes, from what has come over the bus.

    most: number of bytes that the text may have, so that a few bytes cannot fill the memory of a node.

    Raises TableError if the content is no whole zlib stream although it begins like one, or if its text is too long.
    """
    if not content.startswith(_ZLIB_BEGINS):
        return content
    reader = zlib.decompressobj()
    try:
        text = reader.decompress(content, most)
    except zlib.error as error:
        raise TableError("its compressed text is damaged: send it again") from error
    if not reader.eof or reader.unused_data:
        raise TableError(f"it is not whole, or longer than {most} bytes: send it again")
    return text
