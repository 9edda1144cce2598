"""The messages between an agent and a partition: packets on one socket, of several orders or of one answer.

    agent to partition            partition to agent
    LOAD    images, then          LOADED       images that cannot be loaded, with the reasons
    START   module, orders        START_FAILED module, reason        only if it failed
    STOP    module, keep                       nothing
    STEP    module, release, ...  STEPPED      release, when it ended, outputs, writes, reports, phases
                                  STEP_FAILED  release, reason

A partition trusts its agent: orders are plain values in the format of Python's `marshal`, of which both ends run the
same version. The agent does not trust an answer: `decode_answer` gives a value for every packet, `Garbled` for one that
is no answer. A value that is not a plain one cannot be carried, which is a failure of the module that gave it
(`Uncarriable`).

Leaves are named once, in START, and numbered from then on. In an answer numbers are little-endian, and a text has its
length in two bytes before it. The outputs of a module have the same names and types from one step to the next: STEPPED
begins with these, which either end decodes once and then recognizes by their bytes; all values follow as numbers.
"""

import marshal
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from itertools import islice
from typing import Any, NamedTuple, TypeVar

from heronry_agent.module import Value
from heronry_agent.shell.module_runner import Orders, Result

SOCKET = 3
"""File descriptor of the socket in the partition."""

ANSWER_BYTES = 16_384
"""Longest packet of a partition; the agent's buffer has one byte more, so that it notices a longer one."""

Input = tuple[int, Value, int, int, bool]
"""A datum at a leaf: the leaf's number, then the fields of `Datum`."""

_LIST = 0xFFFF  # entries of a list, bytes of a text
_LAYOUTS, _LAYOUT_BYTES = 256, 1024  # layouts that are kept, and how long the longest of them is in a packet
_T = TypeVar("_T")


class Uncarriable(ValueError):  # noqa: N818 - it is a value that cannot be carried, and read as one
    """A value is not a plain one, or too large; the message says which."""


class _Kind(IntEnum):
    LOADED = 1
    START_FAILED = 2
    STEPPED = 3
    STEP_FAILED = 4


class Load(NamedTuple):
    """Import the code of these images."""

    images: tuple[str, ...]


class Start(NamedTuple):
    """Let a module run; `leaves` are (path, variable) in the order of STEP."""

    module: int
    orders: Orders
    leaves: tuple[tuple[str, str], ...]


class Stop(NamedTuple):
    """Stop stepping a module: drop it, or keep it for the next START."""

    module: int
    keep: bool


class Step(NamedTuple):
    """Let a module compute: the time, the end of its authorization, the reading of its device, and its inputs."""

    module: int
    release: int
    now_ns: int
    until_ns: int
    reading: Value | None
    inputs: Sequence[Input]


@dataclass(frozen=True, slots=True)
class Loaded:
    """The code of all images has been imported, except `missing`."""

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


@dataclass(frozen=True, slots=True)
class _Layout:
    """The part of the answers to a step that stays from one to the next; both ends keep layouts that they have seen."""

    outputs: tuple[str, ...]
    types: tuple[str, ...]  # of the outputs, then of the writes: a letter, and a length where there is one
    reports: tuple[str, ...]
    phases: tuple[str, ...]
    values: struct.Struct  # all that follows: the values, and a detail for each report
    is_plain: bool  # every value is one number


_KIND, _COUNT = struct.Struct("<B"), struct.Struct("<H")
_ANSWER, _STEPPED, _STEPPED_KIND = struct.Struct("<BHQ"), struct.Struct("<BHQqH"), _KIND.pack(_Kind.STEPPED)
_SIZED = {"s": "s", "b": "s", "t": "q"}
_NUMBERS = {"f": "d", "i": "q"}
_LETTERS: Mapping[type, str] = {float: "f", int: "i", bool: "i"}
_ORDERS: tuple[type[Order], ...] = (Load, Start, Stop, Step)


def encode_orders(orders: Iterable[Order]) -> bytes:
    """Packet of the agent."""
    return marshal.dumps([(_ORDERS.index(type(order)), *map(_plain, order)) for order in orders])


def _plain(field: object) -> object:
    return tuple(field) if isinstance(field, Orders) else field


def decode_orders(packet: bytes) -> Iterator[Order]:
    """Orders in a packet of the agent."""
    for kind, *fields in marshal.loads(packet):  # noqa: S302 - a partition trusts its agent
        order = _ORDERS[kind]
        yield Start(fields[0], Orders(*fields[1]), fields[2]) if order is Start else order(*fields)


def encode_answer(answer: Loaded | StartRefused | Done | Failed) -> bytes:
    """Packet of a partition; raises Uncarriable."""
    packet = _stepped(answer) if isinstance(answer, Done) else _other(answer)
    if len(packet) > ANSWER_BYTES:
        raise Uncarriable(f"it gives {len(packet)} bytes at once, more than {ANSWER_BYTES}")
    return packet


def _stepped(answer: Done) -> bytes:
    result = answer.result
    values: Sequence[Value] = (*result.outputs.values(), *result.writes)
    types = tuple([_LETTERS.get(type(value)) or _type(value) for value in values])
    head, layout = _written(tuple(result.outputs), types, tuple([name for name, _ in result.reports]), result.phases)
    flat = values if layout.is_plain else _flat(values)
    try:
        body = layout.values.pack(*flat, *(detail for _, detail in result.reports))
    except struct.error:
        raise Uncarriable(f"one of {values!r:.60} has more than 64 bits") from None
    return _STEPPED.pack(_Kind.STEPPED, answer.module, answer.release, answer.ended_ns, len(head)) + head + body


def _type(value: object) -> str:
    """Letter of a value's type, with its length."""
    match value:
        case float():
            return "f"
        case int():
            return "i"
        case str():
            return f"s{len(value.encode('utf-8', 'replace'))}"
        case bytes():
            return f"b{len(value)}"
        case tuple() if all(isinstance(item, int) for item in value):
            return f"t{len(value)}"
    raise Uncarriable(f"{value!r:.60} is no value of a module: use int, float, str, bytes or a tuple of int")


def _flat(values: Iterable[Value]) -> Iterator[Value]:
    """Values as `struct` takes them."""
    for value in values:
        if isinstance(value, tuple):
            yield from value
        else:
            yield value.encode("utf-8", "replace") if isinstance(value, str) else value


@lru_cache(_LAYOUTS)
def _written(*shape: tuple[str, ...]) -> tuple[bytes, _Layout]:
    """Bytes of the names and types of a step's answer, and their layout."""
    head = b"".join([_list(names, _text) for names in shape])
    if len(head) > _LIST:
        raise Uncarriable(f"it gives {len(head)} bytes of names at once")
    return head, _layout(*shape)


@lru_cache(_LAYOUTS)
def _read(head: bytes) -> _Layout:
    reader = _Reader(head)
    shape = [tuple(reader.list(reader.text)) for _ in range(4)]
    if reader.at != len(head) or len(shape[0]) > len(shape[1]):
        raise ValueError("its names contradict themselves")
    return _layout(*shape)


def _layout(
    outputs: tuple[str, ...], types: tuple[str, ...], reports: tuple[str, ...], phases: tuple[str, ...]
) -> _Layout:
    values = [_NUMBERS.get(kind) or f"{int(kind[1:])}{_SIZED[kind[0]]}" for kind in types]
    is_plain = all(kind in _NUMBERS for kind in types)
    layout = struct.Struct(f"<{''.join(values)}{len(reports)}H")
    return _Layout(outputs, types, reports, phases, layout, is_plain)


def _other(answer: Loaded | StartRefused | Failed) -> bytes:
    match answer:
        case Failed():
            return _ANSWER.pack(_Kind.STEP_FAILED, answer.module, answer.release) + _text(answer.reason[:500])
        case StartRefused():
            return _ANSWER.pack(_Kind.START_FAILED, answer.module, 0) + _text(answer.reason[:500])
        case Loaded():
            pairs = [(image, reason[:500]) for image, reason in answer.missing.items()]
            return _KIND.pack(_Kind.LOADED) + _list(pairs, lambda pair: _text(pair[0]) + _text(pair[1]))


def decode_answer(packet: bytes) -> Answer:
    """Answer in a packet of a partition; `Garbled` for any packet that is no answer."""
    if len(packet) > ANSWER_BYTES:
        return Garbled("a packet is too long")
    try:
        return _done(packet) if packet[:1] == _STEPPED_KIND else _decode_other(_Reader(packet))
    except (struct.error, LookupError, ValueError) as error:
        return Garbled(f"a packet cannot be read: {error}")


def _done(packet: bytes) -> Done:
    _, module, release, ended_ns, length = _STEPPED.unpack_from(packet)
    begin = _STEPPED.size + length
    head = packet[_STEPPED.size : begin]
    layout = _read(head) if length <= _LAYOUT_BYTES else _read.__wrapped__(head)
    if len(packet) != begin + layout.values.size:
        raise ValueError("it is not as long as it says")
    numbers = layout.values.unpack_from(packet, begin)
    values = numbers[: len(layout.types)] if layout.is_plain else tuple(_values(layout.types, iter(numbers)))
    count = len(layout.outputs)
    outputs = dict(zip(layout.outputs, values, strict=False))
    details = numbers[len(numbers) - len(layout.reports) :]
    reports = tuple(zip(layout.reports, details, strict=True))
    return Done(module, release, ended_ns, Result(outputs, values[count:], reports, layout.phases))


def _values(types: Iterable[str], numbers: Iterator[Any]) -> Iterator[Value]:
    """Values from the numbers and bytes that `struct` has read."""
    for kind in types:
        match kind[0]:
            case "s":
                yield next(numbers).decode()
            case "t":
                yield tuple(islice(numbers, int(kind[1:])))
            case _:
                yield next(numbers)


def _decode_other(reader: "_Reader") -> Answer:
    kind = reader.take(_KIND)[0]
    if kind == _Kind.LOADED:
        answer: Answer = Loaded(dict(reader.list(lambda: (reader.text(), reader.text()))))
    else:
        module, release = struct.unpack("<HQ", reader.bytes(10))
        if kind == _Kind.STEP_FAILED:
            answer = Failed(module, release, reader.text())
        elif kind == _Kind.START_FAILED:
            answer = StartRefused(module, reader.text())
        else:
            return Garbled(f"a packet of kind {kind} is no answer")
    return answer if reader.at == len(reader.packet) else Garbled("a packet has more in it than it says")


def _text(text: object) -> bytes:
    if not isinstance(text, str):
        raise Uncarriable(f"a name is {text!r:.60}, which is no text")
    data = text.encode("utf-8", "replace")
    if len(data) > _LIST:
        raise Uncarriable(f"a text has {len(data)} bytes")
    return _COUNT.pack(len(data)) + data


def _list(items: Iterable[_T], encode: Callable[[_T], bytes]) -> bytes:
    parts = [encode(item) for item in items]
    if len(parts) > _LIST:
        raise Uncarriable(f"it gives {len(parts)} values at once")
    return _COUNT.pack(len(parts)) + b"".join(parts)


class _Reader:
    """Reads a packet from its front; raises struct.error or ValueError where it ends too early."""

    def __init__(self, packet: bytes) -> None:
        self.packet, self.at = packet, 0

    def take(self, layout: struct.Struct) -> tuple[int, ...]:
        """Read the numbers of a layout."""
        found = layout.unpack_from(self.packet, self.at)
        self.at += layout.size
        return found

    def bytes(self, length: int) -> bytes:
        """Read `length` bytes."""
        found = self.packet[self.at : self.at + length]
        if len(found) != length:
            raise ValueError("it ends too early")
        self.at += length
        return found

    def text(self) -> str:
        """Read a text with its length before it."""
        return self.bytes(self.take(_COUNT)[0]).decode()

    def list(self, read: Callable[[], _T]) -> list[_T]:
        """Read a list of items, each with `read`; its length stands before it."""
        return [read() for _ in range(self.take(_COUNT)[0])]
