"""How long frames take on the wire, and how long they may have to wait.

This file computes the length of a frame on the wire, exact or in the worst case. For a set of periodic messages on one
bus it computes the longest time from the moment a message is due until its last bit has been sent.

Lengths count every bit from start-of-frame to the end of the 3-bit intermission, after which the next frame may start
(ISO 11898-1). The bits from start-of-frame to CRC are stuffed: after five equal bits, one opposite bit is sent. This
stuff bit may itself be the first of the next five. With n data bytes, the lengths without stuff bits are:

    identifier   bits of the frame   of these subject to stuffing
    11 bits      47 + 8n             34 + 8n
    29 bits      67 + 8n             54 + 8n

Response times follow R. I. Davis, A. Burns, R. J. Bril, J. J. Lukkien, "Controller Area Network (CAN) schedulability
analysis: refuted, revisited and revised", Real-Time Systems 35 (2007) 239-272. This is the exact analysis of that
paper: every instance in the busy period is examined, deadlines are arbitrary, and jitter counts. A message waits for at
most one frame of lower priority, which has just started. It also waits for every frame of higher priority that is
queued before the message starts. For each message, C is the length of its frame, T its period, J its jitter, and B the
length of the frame of lower priority:

    busy period    t    = B + sum over this message and all of higher priority of ceil((t + J) / T) C
    instances      Q    = ceil((t + J) / T)
    queueing delay w(q) = B + q C + sum over all of higher priority of ceil((w(q) + J + tau) / T) C
    response       R    = max over q in 0..Q-1 of J + w(q) - q T + C

All times are exact, in bit times (tau = 1). Arguments and results are rationals; the computation uses integers on one
common denominator. The equations for t and w are solved for their least fixed point: a window of time grows until it
has room for all messages that are released inside it (`_Window`). The window of each priority starts from the window of
the next higher priority.

The analysis assumes that every node sends by priority, not first-in-first-out. It ignores offsets between messages (the
result is safe, and exact for unrelated clocks), and considers errors only if they are given (`Errors`).

If a message and all messages of higher priority load the bus to 9 999/10 000 or more, the response time of that message
counts as unbounded. There are two reasons: the clocks of two nodes may differ by 1/10 000, and the busy period grows
without limit near full load.
"""

from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from heapq import heappush, heapreplace
from math import lcm
from typing import NamedTuple

from heronry_wire.frame import MAX_DATA_BYTES, Frame, WireError

WORST_BLOCKING_BITS = 135  # an 8-byte frame with 11 bits of identifier
ERROR_BITS = 31  # error flags, delimiter and intermission after an error, at most (Davis 2007 section 5)

_NEVER_STUFFED_BITS = 13  # CRC delimiter, ACK, ACK delimiter, end of frame (7), intermission (3)
_CRC_BITS = 15
_CRC_POLYNOMIAL = 0x4599
_OVERLOAD = 10_000

Exact = int | Fraction


def worst_bits(data_bytes: int, *, extended: bool = False) -> int:
    """Return the greatest length in bits of a frame with this number of data bytes; raises WireError outside 0..8."""
    if not 0 <= data_bytes <= MAX_DATA_BYTES:
        raise WireError(f"a frame has 0..8 data bytes, not {data_bytes}")
    return (80 if extended else 55) + 10 * data_bytes


def exact_bits(frame: Frame) -> int:
    """Return the length of a frame in bits, with the stuff bits that its content needs; not for error frames."""
    data = frame.data
    if frame.extended:
        base, extension = frame.can_id >> 18, frame.can_id & 0x3FFFF
        header = base << 27 | 0b11 << 25 | extension << 7 | frame.remote << 6 | len(data)
        bits, crc, state = _head(header, 39)
    else:
        bits, crc, state = _head(frame.can_id << 7 | frame.remote << 6 | len(data), 19)
    for byte in data:
        crc = (crc << 8 & 0x7FFF) ^ _CRC_TABLE[crc >> 7 ^ byte]
        bits += _STUFFED[state << 8 | byte]
        state = _NEXT_STATE[state << 8 | byte]
    last = state << 8 | crc >> 7
    return bits + 8 * len(data) + _STUFFED[last] + _STUFFED_IN_7_BITS[_NEXT_STATE[last] << 7 | crc & 0x7F]


@lru_cache(maxsize=4096)
def _head(header: int, header_bits: int) -> tuple[int, int, int]:
    """Return three numbers for the header of a frame: the frame's length, the CRC, and the state of the stuffing.

    The length, in bits, contains neither the data nor the stuff bits after the header. The CRC and the state of the
    stuffing (its index in `_STATES`) are those after the last bit of the header.
    """
    crc = 0
    for bit in f"{header:0{header_bits}b}":
        crc = crc << 1 ^ (_CRC_POLYNOMIAL if (crc >> 14) ^ int(bit) else 0)
        crc &= 0x7FFF
    stuffed, last, run = _stuff(f"{header:0{header_bits}b}", "", 0)
    return header_bits + stuffed + _CRC_BITS + _NEVER_STUFFED_BITS, crc, _STATES.index((last, run))


def _crc_table() -> list[int]:
    table = []
    for byte in range(256):
        crc = byte << 7
        for _ in range(8):
            crc = crc << 1 ^ (_CRC_POLYNOMIAL if crc & 0x4000 else 0)
        table.append(crc & 0x7FFF)
    return table


def _stuff(bits: str, last: str, run: int) -> tuple[int, str, int]:
    """Count the stuff bits in a sequence of bits; gives their number, and `last` and `run` after the sequence.

    last: the bit before the sequence. run: how many equal bits in a row end with the bit `last`.
    """
    stuffed = 0
    for bit in bits:
        last, run = bit, run + 1 if bit == last else 1
        if run == 5:
            last, run, stuffed = "1" if bit == "0" else "0", 1, stuffed + 1
    return stuffed, last, run


# A state of the stuffing is the last bit and the length of its run. The 15 bits of a CRC are a byte and 7 bits.
_STATES = [(last, run) for last in "01" for run in range(1, 5)]
_AFTER_BYTE = [_stuff(f"{byte:08b}", *state) for state in _STATES for byte in range(256)]
_STUFFED = bytes(stuffed for stuffed, _, _ in _AFTER_BYTE)  # by state and byte (state << 8 | byte)
_NEXT_STATE = bytes(_STATES.index((last, run)) for _, last, run in _AFTER_BYTE)
_STUFFED_IN_7_BITS = bytes(_stuff(f"{bits:07b}", *state)[0] for state in _STATES for bits in range(128))
_CRC_TABLE = _crc_table()


class Message(NamedTuple):
    """A periodic (or sporadic) message; all times are exact, in bit times of its bus.

    bits: length of its longest frame, with intermission. period: shortest time between two instances. jitter: longest
    time from when an instance is due until it is queued. deadline: counted from when an instance is due; it may be
    longer than the period.
    """

    name: str
    bits: int
    period: Exact
    jitter: Exact
    deadline: Exact


class Errors(NamedTuple):
    """How often errors destroy frames: up to `burst` (1 or more) in succession, then one per `interval` bit times."""

    burst: int
    interval: Exact


class Response(NamedTuple):
    """The longest response time of a message, in bit times; `bits` is None where the response time is unbounded."""

    name: str
    bits: Fraction | None
    meets_deadline: bool
    instances: int  # number of instances in the busy period; 0 when unbounded


class _Stream(NamedTuple):
    """A message, all of whose times are integers in one unit (`_on_one_denominator`).

    cost: the transmission time of the longest frame of the message.
    """

    cost: int
    period: int
    jitter: int
    deadline: int


class _Window:
    """A time window that is exactly as long as it takes to send the messages that are released in it.

    length: the length of the window.
    ahead: time after the window; a message that is released in this time counts as released in the window.
    due: a heap with an entry (next release, period, cost) for each stream. The next release is not counted yet.
    All times are integers (`_on_one_denominator`). The window only grows, so each release is counted once.
    """

    __slots__ = ("ahead", "due", "length")

    def __init__(self, length: int, ahead: int, due: list[tuple[int, int, int]]) -> None:
        self.length = length
        self.ahead = ahead
        self.due = due

    def admit(self, cost: int, period: int, jitter: int) -> None:
        """Add a stream, and lengthen the window by the frames that the stream releases in it.

        The first release is at -jitter, and always counts. A later one counts if it lies before the end of the
        window plus the time `ahead`; here the window has the length that it had before the call.

        cost: length of the frame. period: time between two releases. All times are integers, as in the class.
        """
        count = max(1, -(-(self.length + self.ahead + jitter) // period))
        self.length += count * cost
        heappush(self.due, (count * period - jitter, period, cost))

    def settle(self) -> None:
        """Grow until the window contains every message that is released in it: the least fixed point."""
        due, limit = self.due, self.length + self.ahead
        while due and due[0][0] < limit:
            release, period, cost = due[0]
            count = -((release - limit) // period)
            limit += count * cost
            heapreplace(due, (release + count * period, period, cost))
        self.length = limit - self.ahead

    def copy(self) -> "_Window":
        return _Window(self.length, self.ahead, self.due.copy())


class _Level(NamedTuple):
    """The delays at one priority that have other causes than messages of higher priority.

    All times are bit times multiplied by the common denominator of `_on_one_denominator`.

    blocking: length of the longest frame of lower priority, which may have just started.
    error_cost: length of an error together with the frame that the error destroys.
    error_jitter: jitter of the errors.
    """

    blocking: int
    error_cost: int  # 0: no errors
    error_jitter: int


def analyse(messages: Sequence[Message], *, blocking_bits: int = 0, errors: Errors | None = None) -> list[Response]:
    """Compute the longest response time of each message; `messages` are in order of priority, highest first.

    blocking_bits: length of the longest frame on the bus that has a lower priority than all these messages; 0 if there
    is none. errors: errors that the bus must tolerate; None for no errors. Raises WireError for a message without a
    length or a period, or with a negative jitter.
    """
    _check(messages, errors)
    scale, streams, interval = _on_one_denominator(messages, errors)
    levels = _levels(streams, scale, blocking_bits, with_errors=errors is not None)
    bounded = _bounded(streams, levels, interval)
    responses: list[Response] = []
    busy = queue = _Window(0, 0, [])
    for index, (message, stream) in enumerate(zip(messages, streams, strict=True)):
        if index >= bounded:
            responses.append(Response(message.name, None, meets_deadline=False, instances=0))
            continue
        if index == 0 or levels[index] != levels[index - 1]:
            burst = errors.burst if errors else 0
            busy = _window(levels[index], burst, interval, 0, streams[:index])
            queue = _window(levels[index], burst, interval, scale, streams[:index])
        busy.admit(*stream[:3])
        busy.settle()
        queue.settle()
        worst, instances = _longest(stream, busy.length, queue)
        responses.append(Response(message.name, Fraction(worst, scale), worst <= stream.deadline, instances))
        queue.admit(*stream[:3])
    return responses


def _check(messages: Sequence[Message], errors: Errors | None) -> None:
    for message in messages:
        if message.bits <= 0 or message.period <= 0 or message.jitter < 0:
            raise WireError(f"message {message.name}: give a length and a period above 0, and no negative jitter")
    if errors and (errors.burst < 1 or errors.interval <= 0):
        raise WireError(f"{errors}: give a burst of 1 or more and an interval above 0, or no errors at all")


def _on_one_denominator(messages: Sequence[Message], errors: Errors | None) -> tuple[int, list[_Stream], int]:
    """Express all times as integers, in parts of a bit time; no time is rounded.

    Returns how many parts a bit time has, the messages, and the interval between errors (without errors one bit time).
    """
    interval = errors.interval if errors else 1
    times = [interval, *(time for m in messages for time in (m.period, m.jitter, m.deadline))]
    scale = lcm(*(time.denominator for time in times))

    def steps(time: Exact) -> int:
        return time.numerator * (scale // time.denominator)

    streams = [_Stream(m.bits * scale, steps(m.period), steps(m.jitter), steps(m.deadline)) for m in messages]
    return scale, streams, steps(interval)


def _levels(streams: list[_Stream], scale: int, blocking_bits: int, *, with_errors: bool) -> list[_Level]:
    blocking, blockings = blocking_bits * scale, []
    for stream in reversed(streams):
        blockings.append(blocking)
        blocking = max(blocking, stream.cost)
    longest, levels = 0, []
    for stream, blocking in zip(streams, reversed(blockings), strict=True):
        longest = max(longest, stream.cost)
        if with_errors:
            # An error may also occur while the message itself is sent: errors up to w + C count.
            levels.append(_Level(blocking, ERROR_BITS * scale + longest, stream.cost - scale))
        else:
            levels.append(_Level(blocking, 0, 0))
    return levels


def _bounded(streams: list[_Stream], levels: list[_Level], interval: int) -> int:
    """Count the messages whose response time is bounded.

    The messages in `streams` are in the order of their priority. If the response time of one is not bounded, the
    response times of all messages after it are not bounded either. So the counted messages are the first ones.

    interval: time between two errors, in the unit of the times of `streams`; not used if there are no errors.
    """
    whole = lcm(interval, *(stream.period for stream in streams))
    load = 0
    for index, (stream, level) in enumerate(zip(streams, levels, strict=True)):
        load += stream.cost * (whole // stream.period)
        with_errors = load + level.error_cost * (whole // interval)
        if with_errors * _OVERLOAD >= whole * (_OVERLOAD - 1):
            return index
    return len(streams)


def _window(level: _Level, burst: int, interval: int, ahead: int, above: list[_Stream]) -> _Window:
    window = _Window(level.blocking, ahead, [])
    if burst:
        window.length += (burst - 1) * level.error_cost
        window.admit(level.error_cost, interval, level.error_jitter if ahead else 0)
    for stream in above:
        window.admit(*stream[:3])
    return window


def _longest(stream: _Stream, busy: int, queue: _Window) -> tuple[int, int]:
    """Return the longest response time of a message in its busy period, and how many instances this period has.

    All times are in the unit of the times of `stream`.

    busy: length of the busy period.
    queue: the window in which the first instance waits; its length is the time of this wait.
    """
    instances = -(-(busy + stream.jitter) // stream.period)
    worst = delay = queue.length
    if instances > 1:
        queue = queue.copy()
    for index in range(1, instances):
        queue.length += stream.cost
        queue.settle()
        delay = queue.length - index * stream.period
        worst = max(worst, delay)
    return stream.jitter + worst + stream.cost, instances
