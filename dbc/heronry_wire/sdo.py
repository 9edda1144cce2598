"""CANopen SDO: the first byte of its messages, its abort codes and its checksum (CiA 301, 7.2.4.3).

This file reads and writes messages, and keeps no state. The server (`heronry_agent.core.canopen`) acts on the messages.
An SDO message always has eight bytes, in one of two forms:

- a command, the index (little-endian), the sub-index, and four bytes of data or a length;
- a command and seven bytes of data.

The upper three bits of the first byte are the command:

    client                      server answers
    1   download, initiate      3
    0   download, segment       1
    2   upload, initiate        2
    3   upload, segment         0
    6   block download          5
    5   block upload            6
    4   abort                   4

In a block transfer, two further bits of this byte tell its step.
"""

import struct
from binascii import crc_hqx
from enum import Enum

MESSAGE_BYTES = 8
SEGMENT_BYTES = 7
MOST_SEGMENTS = 127  # in one block
EXPEDITED_BYTES = 4
LATE_NS = 10_000_000
"""How far a client that paces its requests may fall behind, in ns, and send the missing ones without their pauses."""

# First byte of a message: the command in the upper three bits, and flags below it.
DOWNLOAD, UPLOAD = 1 << 5, 2 << 5
SEGMENT_DOWNLOAD, SEGMENT_UPLOAD = 0 << 5, 3 << 5
BLOCK_DOWNLOAD, BLOCK_UPLOAD = 6 << 5, 5 << 5
ABORT = 4 << 5
DOWNLOAD_ANSWER, UPLOAD_ANSWER = 3 << 5, 2 << 5
SEGMENT_DOWNLOAD_ANSWER, SEGMENT_UPLOAD_ANSWER = 1 << 5, 0 << 5
BLOCK_DOWNLOAD_ANSWER, BLOCK_UPLOAD_ANSWER = 5 << 5, 6 << 5

COMMAND_BITS = 0xE0
EXPEDITED, SIZE_GIVEN = 0x02, 0x01  # of an initiate; bits 3 and 2 count the bytes without data
TOGGLE, LAST_SEGMENT = 0x10, 0x01  # of a segment; bits 3 to 1 count the bytes without data
BLOCK_PART_BITS = 0x03
BLOCK_INITIATE, BLOCK_END, BLOCK_ACKNOWLEDGE, BLOCK_START = 0, 1, 2, 3
BLOCK_SIZE_GIVEN, BLOCK_CRC = 0x02, 0x04  # of a block's initiate
BLOCK_LAST_SEGMENT, SEQUENCE_BITS = 0x80, 0x7F  # of a segment in a block

_HEAD = struct.Struct("<BHB4s")
_WITH_NUMBER = struct.Struct("<BHBI")
_BLOCK_END = struct.Struct("<BH5x")


class Abort(Enum):
    """Why a transfer ends without success (CiA 301, table 22)."""

    TOGGLE = 0x0503_0000  # the toggle bit has not alternated
    TIME_OUT = 0x0504_0000
    COMMAND = 0x0504_0001  # there is no such command, or it is not allowed at this point of a transfer
    BLOCK_SIZE = 0x0504_0002
    SEQUENCE = 0x0504_0003
    CRC = 0x0504_0004
    OUT_OF_MEMORY = 0x0504_0005
    UNSUPPORTED = 0x0601_0000
    WRITE_ONLY = 0x0601_0001
    READ_ONLY = 0x0601_0002
    NO_OBJECT = 0x0602_0000
    LENGTH = 0x0607_0010  # the data do not have the length of the object, or not the length that was announced
    NO_SUB_INDEX = 0x0609_0011
    VALUE = 0x0609_0030
    DEVICE_STATE = 0x0800_0022  # the device cannot do this in its present state
    NO_DATA = 0x0800_0024


def read_head(message: bytes) -> tuple[int, int, bytes]:
    """Return index, sub-index and the last four bytes of a message that opens a transfer or aborts one."""
    _, index, sub_index, rest = _HEAD.unpack(message)
    return index, sub_index, rest


def command_of(message: bytes) -> int:
    """First byte of a message: the command in the upper three bits, and its flags."""
    return message[0]


def read_length(rest: bytes) -> int:
    """Convert the last four bytes of a message to a number: a length, or the code of an abort."""
    return int.from_bytes(rest, "little")


def read_number(value: bytes) -> int | None:
    """Convert the value of an object to an unsigned number; None: it has not one to four bytes, so it is none."""
    return int.from_bytes(value, "little") if 1 <= len(value) <= EXPEDITED_BYTES else None


def expedited_length(command: int) -> int:
    """Return the number of data bytes in a message with all data, from its first byte."""
    return EXPEDITED_BYTES - (command >> 2 & 3)


def segment_data(message: bytes) -> bytes:
    """Return the data that a segment carries, 1 to 7 bytes."""
    return message[1 : MESSAGE_BYTES - (message[0] >> 1 & 7)]


def block_segment_data(message: bytes) -> bytes:
    """Return the seven bytes of a segment in a block, of which the last ones may be padding (`unused_in_block`)."""
    return message[1:]


def unused_in_block(message: bytes) -> int:
    """Return the number of padding bytes in the last segment; `message` is the one that ends the block transfer."""
    return message[0] >> 2 & 7


def block_acknowledged(message: bytes) -> tuple[int, int]:
    """Read the acknowledgement of a block: give the number of segments received in order, and the next block's size."""
    return message[1], message[2]


def block_size(rest: bytes) -> int:
    """Number of segments in a block; `rest` has the last four bytes of the message that opens a block transfer."""
    return rest[0]


def with_data(command: int, index: int, sub_index: int, data: bytes = b"") -> bytes:
    """Make a message with up to four bytes of data."""
    return _HEAD.pack(command, index, sub_index, data)


def with_number(command: int, index: int, sub_index: int, number: int) -> bytes:
    """Make a message with a number, such as a length, in its last four bytes."""
    return _WITH_NUMBER.pack(command, index, sub_index, number)


def abort_message(index: int, sub_index: int, reason: Abort) -> bytes:
    """Make the message that aborts a transfer."""
    return _WITH_NUMBER.pack(ABORT, index, sub_index, reason.value)


def segment(command: int, data: bytes) -> bytes:
    """Make a message of the byte `command` and up to seven bytes of data, which are filled up with zero bytes."""
    return bytes((command,)) + data.ljust(SEGMENT_BYTES, b"\0")


def block_end(command: int, checksum: int = 0) -> bytes:
    """Make the message that ends a block transfer, with the checksum of its data if the transfer uses one."""
    return _BLOCK_END.pack(command, checksum)


def block_checksum(message: bytes) -> int:
    """Return the checksum that the message at the end of a block transfer carries."""
    checksum: int = _BLOCK_END.unpack(message)[1]
    return checksum


def crc(data: bytes | bytearray) -> int:
    """Compute the checksum of a block transfer: CRC-16, polynomial 1021h, start value 0 (CiA 301, 7.2.4.3.16)."""
    return crc_hqx(data, 0)
