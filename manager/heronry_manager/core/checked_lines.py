"""Text lines that know whether they are whole: how journals are written, so that a kill at any byte can be survived.

A line is a checksum (CRC-32, 8 hexadecimal digits), a space, JSON, and a line break. One that was torn or changed has
another checksum; CRC-32 finds every change of up to 32 bits in a row. What follows from a bad line is its reader's
affair.
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
    """Write what JSON can hold as one line."""
    text = json.dumps(content, separators=(",", ":")).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def line_content(line: bytes) -> object | Literal[_Damaged.DAMAGED]:
    """Read a line, with its line break; DAMAGED where it is not just what was written."""
    checksum, _, text = line.removesuffix(b"\n").partition(b" ")
    if not line.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text):
        return DAMAGED
    try:
        content: object = json.loads(text)
    except (ValueError, RecursionError):
        return DAMAGED
    return content
