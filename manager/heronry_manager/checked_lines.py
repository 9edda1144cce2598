"""Text lines with a checksum, by which a reader of a journal recognizes a line that was only partly written.

A line is a checksum (CRC-32, 8 hexadecimal digits), a space, JSON, and a line break. The checksum of a partly written
or changed line does not fit: CRC-32 finds every change of up to 32 bits in a row. The reader decides what to do
about a bad line.
"""

import json
import zlib
from enum import Enum
from typing import Final, Literal


class _Damaged(Enum):
    DAMAGED = "damaged"


DAMAGED: Final = _Damaged.DAMAGED


def checked_line(content: object) -> bytes:
    """Encode a JSON value as one line, with its checksum and its line break."""
    text = json.dumps(content, separators=(",", ":")).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def line_content(line: bytes) -> object | Literal[_Damaged.DAMAGED]:
    """Decode one line, line break included, into its JSON value; DAMAGED: the line is not exactly as it was written."""
    checksum, _, text = line.removesuffix(b"\n").partition(b" ")
    if not line.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text):
        return DAMAGED
    try:
        content: object = json.loads(text)
    except (ValueError, RecursionError):
        return DAMAGED
    return content
