"""The frame: the unit that every core takes in and gives out, and its text form.

This file defines the frame as cores see it (identifier, data, three flags), the order in which frames win arbitration,
and the text form. The text form is the notation of can-utils (`130#01020000BFC00000`), and the lines of its log
(`(12.000345) can0 130#...`). So a recorded flight can be replayed through the cores, and any CAN tool can read the log
of a simulated flight.

This file keeps no state. Everything here is a pure function of its arguments.

Errors have two forms, used by all of this package:

- bytes or text from outside that break a rule give a `Malformed` value with the reason: the receiver counts it per
  peer and goes on;
- a call of this project's own code with an impossible value raises `WireError`, with a sentence that says what to do.

This file handles classical CAN only (at most 8 bytes); CAN FD text is `Malformed`. A remote frame here has no data, and
its requested length is not kept, because no protocol of this project sends or answers a remote frame.
"""

import re
from typing import NamedTuple

from heronry_wire.errors import HeronryError

STANDARD_MASK = 0x7FF
EXTENDED_MASK = 0x1FFF_FFFF
MAX_DATA_BYTES = 8

_ERROR_FLAG = 0x2000_0000  # how can-utils marks an error frame: CAN_ERR_FLAG of linux/can.h
_NS_PER_S = 1_000_000_000

_FRAME_TEXT = re.compile(r"([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?:(R)[0-8]?|((?:[0-9A-Fa-f]{2}){0,8}))", re.ASCII)
_LOG_TEXT = re.compile(r"\((\d{1,12})\.(\d{1,9})\) (\S+) (\S+)(?: [RT])?", re.ASCII)


class WireError(HeronryError, ValueError):
    """A caller gave a value that cannot be put on the bus; the message says what to change."""


class Malformed(NamedTuple):
    """Bytes or text from outside that break a rule: a value to be counted, never an exception."""

    reason: str


class Frame(NamedTuple):
    """One classical CAN frame.

    `can_id` has 11 bits, or 29 when `extended`; `data` has 0..8 bytes, none when `remote`. With `error` set the frame
    is not traffic but a controller's report (SocketCAN error frame): `can_id` then holds the error class. A constructor
    call checks nothing: cores make frames through the codecs, drivers take them from hardware.
    """

    can_id: int
    data: bytes
    extended: bool = False
    remote: bool = False
    error: bool = False


class LoggedFrame(NamedTuple):
    """One line of a candump log: the time in ns of the recorder's clock, the channel, and the frame."""

    time_ns: int
    channel: str
    frame: Frame


def arbitration_key(frame: Frame) -> int:
    """Return a key by which frames sort as in arbitration: of two frames that start together, the smaller key wins.

    The bits are compared as they are sent: the 11 base bits, RTR (SRR when extended), IDE, then the other 18 bits and
    RTR. So a standard frame wins against an extended one with the same base, and a data frame against the remote frame
    of its identifier. Never compare 29-bit identifiers with 11-bit ones as integers.
    """
    if frame.extended:
        base, extension = frame.can_id >> 18, frame.can_id & 0x3FFFF
        return base << 21 | 0b11 << 19 | extension << 1 | frame.remote
    return frame.can_id << 21 | frame.remote << 20


def format_frame(frame: Frame) -> str:
    """Write a frame as can-utils do (`130#0102`): an identifier of three hexadecimal digits, or eight if extended."""
    if frame.error:
        identifier = f"{frame.can_id | _ERROR_FLAG:08X}"
    else:
        identifier = f"{frame.can_id:08X}" if frame.extended else f"{frame.can_id:03X}"
    return f"{identifier}#{'R' if frame.remote else frame.data.hex().upper()}"


def parse_frame(text: str) -> Frame | Malformed:
    """Read a frame in the form of `format_frame`, candump, cansend or python-can; `Malformed` for any other text."""
    match = _FRAME_TEXT.fullmatch(text)
    if match is None:
        return Malformed(f"{text[:60]!r} is not a classical CAN frame, such as 130#01020000BFC00000")
    digits, remote, data_hex = match.groups()
    can_id = int(digits, 16)
    data = bytes.fromhex(data_hex or "")
    if len(digits) == 3:
        if can_id > STANDARD_MASK:
            return Malformed(f"identifier {digits} has more than 11 bits")
        return Frame(can_id, data, remote=remote is not None)
    if can_id & ~EXTENDED_MASK == _ERROR_FLAG and remote is None:
        return Frame(can_id & EXTENDED_MASK, data, error=True)
    if can_id > EXTENDED_MASK:
        return Malformed(f"identifier {digits} has more than 29 bits")
    return Frame(can_id, data, extended=True, remote=remote is not None)


def format_log_line(logged: LoggedFrame) -> str:
    """Write one line of `candump -L`, without a line end.

    A time of whole microseconds gets six digits, which every tool reads. A finer time gets nine digits, so that a
    replay has the same times; canplayer of older can-utils reads only six.
    """
    seconds, fraction_ns = divmod(logged.time_ns, _NS_PER_S)
    whole_us = fraction_ns % 1000 == 0
    fraction = f"{fraction_ns // 1000:06d}" if whole_us else f"{fraction_ns:09d}"
    return f"({seconds:010d}.{fraction}) {logged.channel} {format_frame(logged.frame)}"


def parse_log_line(line: str) -> LoggedFrame | Malformed:
    """Read one line of a candump log, as can-utils and python-can write it; `Malformed` for any other text.

    A trailing R or T (received, transmitted) is ignored.
    """
    match = _LOG_TEXT.fullmatch(line.strip())
    if match is None:
        return Malformed(f"{line.strip()[:60]!r} is not a candump log line, such as (12.000345) can0 130#0102")
    seconds, fraction, channel, frame_text = match.groups()
    frame = parse_frame(frame_text)
    if isinstance(frame, Malformed):
        return frame
    return LoggedFrame(int(seconds) * _NS_PER_S + int(fraction.ljust(9, "0")), channel, frame)
