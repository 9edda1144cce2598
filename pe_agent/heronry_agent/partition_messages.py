"""What an agent and a partition say to each other: short binary messages on one socket, one message a packet.

    agent to partition            partition to agent
    LOAD    images, then          LOADED       images that cannot be loaded, with the reasons
    START   module, orders        START_FAILED module, reason        only if it failed
    STOP    module, keep                       nothing
    STEP    module, release, ...  STEPPED      release, when it ended, outputs, writes, reports, phases
                                  STEP_FAILED  release, reason

The agent believes nothing of what comes: `decode_answer` gives a value for every packet, `Malformed` for one that is
not what a partition says. A partition trusts its agent. No pickle: what is not a plain value cannot be carried, and
that is the fault of the module that gave it (`Uncarriable`).

Numbers are little-endian; a text or a string of bytes has its length in two bytes before it; a value has its type in
one byte before it. Leaves are named once, in START, and numbered from then on.
"""

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, TypeVar

from heronry_agent.module import Datum, Value
from heronry_agent.module_runner import Orders, Result

SOCKET = 3
"""File descriptor of the socket in the partition."""

ANSWER_BYTES = 16_384
"""A partition says nothing longer; the agent's buffer is one byte more, so that it would notice."""

_LIST = 0xFFFF  # entries of a list, bytes of a text
_INTEGER = range(-(2**63), 2**63)
_T = TypeVar("_T")


class Uncarriable(ValueError):  # noqa: N818 - it is a value that cannot be carried, and read as one
    """A value is no plain one, or too large; the message says which."""


class _Kind(IntEnum):
    LOAD = 1
    START = 2
    STOP = 3
    STEP = 4
    LOADED = 5
    START_FAILED = 6
    STEPPED = 7
    STEP_FAILED = 8


@dataclass(frozen=True, slots=True)
class Load:
    """Import the code of these images."""

    images: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Start:
    """Let a module run; `leaves` are (path, variable) in the order of STEP."""

    module: int
    orders: Orders
    leaves: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Stop:
    """Step a module no more."""

    module: int
    keep: bool


class Step(NamedTuple):
    """Let a module compute: the time, until when it may drive, its device's reading, and data by number of the leaf."""

    module: int
    release: int
    now_ns: int
    until_ns: int
    reading: Value | None
    inputs: Sequence[tuple[int, Datum]]


@dataclass(frozen=True, slots=True)
class Loaded:
    """All has been imported that can be."""

    missing: Mapping[str, str]  # image -> reason


@dataclass(frozen=True, slots=True)
class StartRefused:
    """A module could not be built."""

    module: int
    reason: str


class Done(NamedTuple):
    """A step has ended, at this time of the monotonic clock."""

    module: int
    release: int
    ended_ns: int
    result: Result


@dataclass(frozen=True, slots=True)
class Failed:
    """A step has failed."""

    module: int
    release: int
    reason: str


@dataclass(frozen=True, slots=True)
class Garbled:
    """A packet that is no answer."""

    reason: str


Order = Load | Start | Stop | Step
Answer = Loaded | StartRefused | Done | Failed | Garbled

_KIND, _MODULE, _COUNT, _FLAG = struct.Struct("<B"), struct.Struct("<H"), struct.Struct("<H"), struct.Struct("<B")
_NUMBER, _FLOAT, _DETAIL = struct.Struct("<q"), struct.Struct("<d"), struct.Struct("<H")
_START, _STEP, _ANSWER = struct.Struct("<BHQB"), struct.Struct("<BHQqQ"), struct.Struct("<BHQ")
_LEAF = struct.Struct("<BBBq")


def encode_order(order: Order) -> bytes:
    """Packet of the agent."""
    match order:
        case Step():
            head = _STEP.pack(_Kind.STEP, order.module, order.release, order.now_ns, order.until_ns)
            leaves = [
                _LEAF.pack(leaf, datum.version, datum.valid, datum.age_ns) + _value(datum.value)
                for leaf, datum in order.inputs
            ]
            return b"".join((head, _value(order.reading), *leaves))
        case Load():
            return _KIND.pack(_Kind.LOAD) + _list(order.images, _text)
        case Start():
            orders = order.orders
            head = _START.pack(_Kind.START, order.module, orders.period_ns, orders.has_device)
            names = b"".join(map(_text, (orders.name, orders.image, orders.mode)))
            return head + names + _list(order.leaves, lambda leaf: _text(leaf[0]) + _text(leaf[1]))
        case Stop():
            return _KIND.pack(_Kind.STOP) + _MODULE.pack(order.module) + _FLAG.pack(order.keep)


def decode_order(packet: bytes) -> Order:
    """What the agent said."""
    reader = _Reader(packet)
    kind = reader.take(_KIND)[0]
    if kind == _Kind.STEP:
        module, release, now_ns, until_ns = struct.unpack_from("<HQqQ", packet, 1)
        reader.at = _STEP.size
        reading = reader.value()
        inputs = []
        while reader.at < len(packet):
            leaf, version, valid, age_ns = reader.take(_LEAF)
            value = reader.value()
            assert value is not None
            inputs.append((leaf, Datum(value, version, age_ns, bool(valid))))
        return Step(module, release, now_ns, until_ns, reading, inputs)
    if kind == _Kind.LOAD:
        return Load(tuple(reader.list(reader.text)))
    if kind == _Kind.START:
        module, period_ns, has_device = struct.unpack_from("<HQB", packet, 1)
        reader.at = _START.size
        orders = Orders(reader.text(), reader.text(), reader.text(), period_ns, bool(has_device))
        return Start(module, orders, tuple(reader.list(lambda: (reader.text(), reader.text()))))
    return Stop(reader.take(_MODULE)[0], bool(reader.take(_FLAG)[0]))


def encode_answer(answer: Loaded | StartRefused | Done | Failed) -> bytes:
    """Packet of a partition; raises Uncarriable."""
    packet = _answer_packet(answer)
    if len(packet) > ANSWER_BYTES:
        raise Uncarriable(f"it gives {len(packet)} bytes at once, more than {ANSWER_BYTES}")
    return packet


def _answer_packet(answer: Loaded | StartRefused | Done | Failed) -> bytes:
    match answer:
        case Done():
            result = answer.result
            return b"".join(
                (
                    _ANSWER.pack(_Kind.STEPPED, answer.module, answer.release),
                    _NUMBER.pack(answer.ended_ns),
                    _list(result.outputs.items(), lambda given: _text(given[0]) + _carried(given[0], given[1])),
                    _list(result.writes, lambda value: _carried("a write", value)),
                    _list(result.reports, lambda report: _text(report[0]) + _DETAIL.pack(report[1])),
                    _list(result.phases, _text),
                )
            )
        case Failed():
            return _ANSWER.pack(_Kind.STEP_FAILED, answer.module, answer.release) + _text(answer.reason[:500])
        case StartRefused():
            return _ANSWER.pack(_Kind.START_FAILED, answer.module, 0) + _text(answer.reason[:500])
        case Loaded():
            pairs = [(image, reason[:500]) for image, reason in answer.missing.items()]
            return _KIND.pack(_Kind.LOADED) + _list(pairs, lambda pair: _text(pair[0]) + _text(pair[1]))


def decode_answer(packet: bytes) -> Answer:
    """What a partition said; whatever it was."""
    if len(packet) > ANSWER_BYTES:
        return Garbled("a packet is too long")
    try:
        return _decode_answer(_Reader(packet))
    except (struct.error, UnicodeDecodeError, ValueError) as error:
        return Garbled(f"a packet cannot be read: {error}")


def _decode_answer(reader: "_Reader") -> Answer:
    kind = reader.take(_KIND)[0]
    if kind == _Kind.LOADED:
        answer: Answer = Loaded(dict(reader.list(lambda: (reader.text(), reader.text()))))
    else:
        module, release = struct.unpack("<HQ", reader.bytes(10))
        if kind == _Kind.STEPPED:
            ended_ns = reader.take(_NUMBER)[0]
            outputs = dict(reader.list(lambda: (reader.text(), reader.given())))
            writes = tuple(reader.list(reader.given))
            reports = tuple(reader.list(lambda: (reader.text(), int(reader.take(_DETAIL)[0]))))
            result = Result(outputs, writes, reports, tuple(reader.list(reader.text)))
            answer = Done(module, release, ended_ns, result)
        elif kind == _Kind.STEP_FAILED:
            answer = Failed(module, release, reader.text())
        elif kind == _Kind.START_FAILED:
            answer = StartRefused(module, reader.text())
        else:
            return Garbled(f"a packet of kind {kind} is no answer")
    return answer if reader.at == len(reader.packet) else Garbled("a packet has more in it than it says")


def _text(text: object) -> bytes:
    if not isinstance(text, str):
        raise Uncarriable(f"a name is {text!r:.60}, which is no text")
    return _sized(text.encode("utf-8", "replace"))


def _sized(data: bytes) -> bytes:
    if len(data) > _LIST:
        raise Uncarriable(f"a text has {len(data)} bytes")
    return _COUNT.pack(len(data)) + data


def _list(items: Iterable[_T], encode: Callable[[_T], bytes]) -> bytes:
    parts = [encode(item) for item in items]
    if len(parts) > _LIST:
        raise Uncarriable(f"it gives {len(parts)} values at once")
    return _COUNT.pack(len(parts)) + b"".join(parts)


def _carried(name: str, value: object) -> bytes:
    if value is None:
        raise Uncarriable(f"{name} is None, which is no value")
    return _value(value)


def _value(value: object) -> bytes:
    """Carry a value; None is only a reading's."""
    match value:
        case float():
            return b"f" + _FLOAT.pack(value)
        case int() if value in _INTEGER:
            return b"i" + _NUMBER.pack(value)
        case str():
            return b"s" + _text(value)
        case bytes():
            return b"b" + _sized(value)
        case tuple() if all(isinstance(item, int) and item in _INTEGER for item in value):
            return b"t" + _list(value, _NUMBER.pack)
        case None:
            return b"n"
    raise Uncarriable(f"{value!r:.60} is no value of a module: use int, float, str, bytes or a tuple of int")


class _Reader:
    """Reads a packet from its front; raises struct.error or ValueError where it ends too early."""

    def __init__(self, packet: bytes) -> None:
        self.packet, self.at = packet, 0

    def take(self, layout: struct.Struct) -> tuple[int, ...]:
        """Numbers."""
        found = layout.unpack_from(self.packet, self.at)
        self.at += layout.size
        return found

    def bytes(self, length: int) -> bytes:
        """So many bytes."""
        found = self.packet[self.at : self.at + length]
        if len(found) != length:
            raise ValueError("it ends too early")
        self.at += length
        return found

    def text(self) -> str:
        """A text."""
        return self.bytes(self.take(_COUNT)[0]).decode()

    def list(self, read: Callable[[], _T]) -> list[_T]:
        """As many of something as the packet says."""
        return [read() for _ in range(self.take(_COUNT)[0])]

    def given(self) -> Value:
        """A value that is there."""
        value = self.value()
        if value is None:
            raise ValueError("a value is missing")
        return value

    def value(self) -> Value | None:
        """A value, or None."""
        match self.bytes(1):
            case b"f":
                return float(_FLOAT.unpack(self.bytes(8))[0])
            case b"i":
                return self.take(_NUMBER)[0]
            case b"s":
                return self.text()
            case b"b":
                return self.bytes(self.take(_COUNT)[0])
            case b"t":
                return tuple(self.list(lambda: self.take(_NUMBER)[0]))
            case b"n":
                return None
            case unknown:
                raise ValueError(f"{unknown!r} is no type of a value")
