"""Text lines with a checksum, which shows a torn line: journals are written so, and survive a kill at any byte.

A line is a checksum (CRC-32, 8 hexadecimal digits), a space, JSON, and a line break. A line that was torn or changed
has another checksum; CRC-32 finds every change of up to 32 bits in a row. The reader decides what follows from a bad
line.
"""

import json
import zlib
from enum import Enum
from typing import Final, Literal


class _Damaged(Enum):
    """The type of DAMAGED."""

    DAMAGED = "damaged"


DAMAGED: Final = _Damaged.DAMAGED


def checked_line(content: object) -> bytes:
    """Write a value that JSON can hold as one line, with its line break."""
    text = json.dumps(content, separators=(",", ":")).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def line_content(line: bytes) -> object | Literal[_Damaged.DAMAGED]:
    """Read a line, with its line break; gives DAMAGED where it is not exactly what was written."""
    checksum, _, text = line.removesuffix(b"\n").partition(b" ")
    if not line.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text):
        return DAMAGED
    try:
        content: object = json.loads(text)
    except (ValueError, RecursionError):
        return DAMAGED
    return content
