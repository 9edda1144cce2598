"""The messages between an agent and a partition: packets on one socket. A packet has several orders, or one answer.

    order of the agent             answer of the partition
    LOAD    images                 LOADED        images that cannot be loaded, with the reasons
    START   module, leaves, ...    no answer if START has succeeded, else
                                   START_FAILED  module, reason, traceback; of a module with a checkpoint that was
                                                 built, RESTORED or LACKING (`partition_states`)
    STOP    module, keep           no answer
    SAVE    module, round, ...     SAVED or LACKING; no answer if the module does not run
    STEP    module, release, ...   STEPPED       release, when it ended, outputs, writes, reports, requests; or
                                   STEP_FAILED   release, reason, traceback

A partition trusts its agent: orders are plain values in the format of Python's `marshal`, which is the same at both
ends. The agent does not trust a partition: `decode_answer` accepts any bytes, and returns `Garbled` if they are no
answer. Values of a module are int, float, str, bytes or a tuple of int; a module that gives another value has failed
(`Uncarriable`).

START names the leaves (the single inputs) of a module's mode; later messages refer to a leaf by its number. In an
answer numbers are little-endian, and two bytes before a text give its length. STEPPED begins with the names and types
of the values; the values follow. Names and types are usually the same in every step of a module, so each end decodes
them once and then recognizes them by their bytes.
"""

import marshal
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from itertools import islice
from typing import Any, NamedTuple, TypeVar

from heronry_agent.core.vocabulary import StateEvent
from heronry_agent.module import Value
from heronry_agent.shell.module_runner import Orders, Result
from heronry_agent.shell.partition_states import decode_state, encode_state, is_state

SOCKET = 3
"""File descriptor of the socket in the partition."""

ANSWER_BYTES = 16_384
"""Longest packet of a partition; the agent's buffer has one byte more, so that the agent notices a longer packet."""

Input = tuple[int, Value, int, int, bool]
"""A datum at a leaf: the leaf's number, then the fields of `Datum`."""

_LIST = 0xFFFF  # most entries of a list, most bytes of a text
_LAYOUTS, _LAYOUT_BYTES = 256, 1024  # most layouts in the cache, and length in bytes of the longest layout there
_REASON, _TRACEBACK = 500, 3_000  # characters of a failure's texts; the agent keeps fewer (`failure_text`)
_T = TypeVar("_T")


class Uncarriable(ValueError):  # noqa: N818 - the name describes a value
    """The answer to a step cannot be sent; the message says why.

    A value has a wrong type or too many bits, or the values or names of the answer have too many bytes.
    """


class _Kind(IntEnum):
    LOADED = 1
    START_FAILED = 2
    STEPPED = 3
    STEP_FAILED = 4


class Load(NamedTuple):
    """Order: import the code of these images."""

    images: tuple[str, ...]


class Start(NamedTuple):
    """Order: build the object of a module, or go on with the object that STOP has kept.

    leaves: (path, variable) of each leaf; an input in STEP names its leaf by the position in this tuple.
    kept: the state from which the module starts, as plain values (`partition_states`).
    """

    module: int
    orders: Orders
    leaves: tuple[tuple[str, str], ...]
    kept: tuple[int | bytes, ...] | None = None


class Stop(NamedTuple):
    """Order: drop the object of a module, or keep it for the next START."""

    module: int
    keep: bool


class Save(NamedTuple):
    """Order: save the state of a module, at most `most_bytes` bytes; the answer repeats `round`."""

    module: int
    round: int
    most_bytes: int


class Step(NamedTuple):
    """Order: compute one step, unless the time `until_ns` has passed.

    release: number of the release; the answer repeats it.
    now_ns: time of the step on the monotonic clock.
    until_ns: time in ns after which the module must not drive its outputs.
    reading: the reading of the module's device; None: there is none.
    inputs: the fresh data, each with the number of its leaf.
    """

    module: int
    release: int
    now_ns: int
    until_ns: int
    reading: Value | None
    inputs: Sequence[Input]


@dataclass(frozen=True, slots=True)
class Loaded:
    """Answer: the code of all images has been imported, except that of the `missing` ones."""

    missing: Mapping[str, str]  # image -> reason why it cannot be loaded


@dataclass(frozen=True, slots=True)
class StartRefused:
    """Answer: a module could not be built; `reason` is one line, `traceback` may be empty."""

    module: int
    reason: str
    traceback: str = ""


class Done(NamedTuple):
    """Answer: a step has been computed; it ended at `ended_ns` of the monotonic clock."""

    module: int
    release: int
    ended_ns: int
    result: Result


@dataclass(frozen=True, slots=True)
class Failed:
    """Answer: a step has failed; `reason` is one line, `traceback` may be empty."""

    module: int
    release: int
    reason: str
    traceback: str = ""


@dataclass(frozen=True, slots=True)
class Garbled:
    """Stands for a packet that is no answer; `reason` says why not."""

    reason: str


Order = Load | Start | Stop | Step | Save
Answer = Loaded | StartRefused | Done | Failed | Garbled | StateEvent


@dataclass(frozen=True, slots=True)
class _Layout:
    """Names and types of the values in the answer to a step."""

    outputs: tuple[str, ...]  # variables
    types: tuple[str, ...]  # of the outputs, then of the writes: a letter, with a length where the type has one
    reports: tuple[str, ...]  # elements
    phases: tuple[str, ...]  # requested phases
    priorities: tuple[str, ...]  # functions
    misspelt: tuple[str, ...]  # pairs: the name that was read, the input that was probably meant
    values: struct.Struct  # what follows the layout: values, a detail for each report, a number for each priority
    is_plain: bool  # every value is one number


_KIND, _COUNT = struct.Struct("<B"), struct.Struct("<H")
_ANSWER, _STEPPED, _STEPPED_KIND = struct.Struct("<BHQ"), struct.Struct("<BHQqH"), _KIND.pack(_Kind.STEPPED)
_SIZED = {"s": "s", "b": "s", "t": "q"}
_NUMBERS = {"f": "d", "i": "q"}
_LETTERS: Mapping[type, str] = {float: "f", int: "i", bool: "i"}
_ORDERS: tuple[type[Order], ...] = (Load, Start, Stop, Step, Save)


def encode_orders(orders: Iterable[Order]) -> bytes:
    """Encode orders as one packet for a partition."""
    return marshal.dumps([(_ORDERS.index(type(order)), *map(_plain, order)) for order in orders])


def _plain(field: object) -> object:
    return tuple(field) if isinstance(field, Orders) else field


def decode_orders(packet: bytes) -> Iterator[Order]:
    """Decode the orders in a packet of the agent."""
    for kind, *fields in marshal.loads(packet):  # noqa: S302 - a partition trusts its agent
        order = _ORDERS[kind]
        yield Start(fields[0], Orders(*fields[1]), *fields[2:]) if order is Start else order(*fields)


def encode_answer(answer: Loaded | StartRefused | Done | Failed | StateEvent) -> bytes:
    """Encode an answer as a packet for the agent.

    Raises Uncarriable if a value cannot be sent, or if the packet would be longer than `ANSWER_BYTES`.
    """
    if isinstance(answer, StateEvent):
        return encode_state(answer)
    packet = _stepped(answer) if isinstance(answer, Done) else _other(answer)
    if len(packet) > ANSWER_BYTES:
        raise Uncarriable(
            f"the results of a step take {len(packet)} bytes, but may take at most {ANSWER_BYTES}; "
            "give fewer or shorter values in one step"
        )
    return packet


def _stepped(answer: Done) -> bytes:
    result = answer.result
    values: Sequence[Value] = (*result.outputs.values(), *result.writes)
    types = tuple([_LETTERS.get(type(value)) or _type(value) for value in values])
    reports, priorities = tuple([name for name, _ in result.reports]), tuple([name for name, _ in result.priorities])
    misspelt = tuple([name for pair in result.misspelt for name in pair]) if result.misspelt else ()
    head, layout = _written(tuple(result.outputs), types, reports, result.phases, priorities, misspelt)
    flat = values if layout.is_plain else _flat(values)
    try:
        body = layout.values.pack(*flat, *(number for _, number in (*result.reports, *result.priorities)))
    except struct.error:
        raise Uncarriable(f"a step gives {values!r:.60}, and one of these values has more than 64 bits") from None
    return _STEPPED.pack(_Kind.STEPPED, answer.module, answer.release, answer.ended_ns, len(head)) + head + body


def _type(value: object) -> str:
    """Return the type of a value as a letter; for a text, bytes or a tuple, its length follows.

    The length of a text is in bytes of UTF-8. Raises Uncarriable for a value of any other type.
    """
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
    """Yield the values as arguments of `Struct.pack`: tuples item by item, texts as bytes."""
    for value in values:
        if isinstance(value, tuple):
            yield from value
        else:
            yield value.encode("utf-8", "replace") if isinstance(value, str) else value


@lru_cache(_LAYOUTS)
def _written(*shape: tuple[str, ...]) -> tuple[bytes, _Layout]:
    """Encode names and types for the head of STEPPED; returns the bytes, and the layout.

    shape: the values of the first six fields of `_Layout`, in their order.
    """
    head = b"".join([_list(names, _text) for names in shape])
    if len(head) > _LIST:
        raise Uncarriable(
            f"the names of the outputs, reports and requests of a step take {len(head)} bytes, "
            f"but all results of a step may take at most {ANSWER_BYTES}; give fewer in one step"
        )
    return head, _layout(*shape)


@lru_cache(_LAYOUTS)
def _read(head: bytes) -> _Layout:
    reader = _Reader(head)
    shape = [tuple(reader.list(reader.text)) for _ in range(6)]
    if reader.at != len(head) or len(shape[0]) > len(shape[1]) or len(shape[5]) % 2:
        raise ValueError("the answer to a step has more outputs than types, half a pair, or bytes after its names")
    return _layout(*shape)


def _layout(*shape: tuple[str, ...]) -> _Layout:
    """Make a layout of the values of its first six fields."""
    outputs, types, reports, phases, priorities, misspelt = shape
    values = [_NUMBERS.get(kind) or f"{int(kind[1:])}{_SIZED[kind[0]]}" for kind in types]
    is_plain = all(kind in _NUMBERS for kind in types)
    layout = struct.Struct(f"<{''.join(values)}{len(reports) + len(priorities)}H")
    return _Layout(outputs, types, reports, phases, priorities, misspelt, layout, is_plain)


def _other(answer: Loaded | StartRefused | Failed) -> bytes:
    match answer:
        case Failed():
            return _ANSWER.pack(_Kind.STEP_FAILED, answer.module, answer.release) + _told(answer)
        case StartRefused():
            return _ANSWER.pack(_Kind.START_FAILED, answer.module, 0) + _told(answer)
        case Loaded():
            pairs = [(image, reason[:_REASON]) for image, reason in answer.missing.items()]
            return _KIND.pack(_Kind.LOADED) + _list(pairs, lambda pair: _text(pair[0]) + _text(pair[1]))


def _told(answer: StartRefused | Failed) -> bytes:
    return _text(answer.reason[:_REASON]) + _text(answer.traceback[-_TRACEBACK:])


def decode_answer(packet: bytes) -> Answer:
    """Decode a packet of a partition; returns `Garbled` if it is no answer."""
    if len(packet) > ANSWER_BYTES:
        return Garbled("a packet is too long")
    try:
        if packet[:1] == _STEPPED_KIND:
            return _done(packet)
        return decode_state(packet) if is_state(packet) else _decode_other(_Reader(packet))
    except (struct.error, LookupError, ValueError) as error:
        return Garbled(f"it sent an unreadable packet; look for module code that writes to its socket ({error})")


def _done(packet: bytes) -> Done:
    _, module, release, ended_ns, length = _STEPPED.unpack_from(packet)
    begin = _STEPPED.size + length
    head = packet[_STEPPED.size : begin]
    layout = _read(head) if length <= _LAYOUT_BYTES else _read.__wrapped__(head)
    if len(packet) != begin + layout.values.size:
        raise ValueError("the answer to a step is longer or shorter than its names and types say")
    numbers = layout.values.unpack_from(packet, begin)
    values = numbers[: len(layout.types)] if layout.is_plain else tuple(_values(layout.types, iter(numbers)))
    count = len(layout.outputs)
    outputs = dict(zip(layout.outputs, values, strict=False))
    said = numbers[len(numbers) - len(layout.reports) - len(layout.priorities) :]
    reports = tuple(zip(layout.reports, said, strict=False))
    priorities = tuple(zip(layout.priorities, said[len(reports) :], strict=True))
    misspelt = tuple(zip(layout.misspelt[::2], layout.misspelt[1::2], strict=True)) if layout.misspelt else ()
    return Done(
        module, release, ended_ns, Result(outputs, values[count:], reports, layout.phases, priorities, misspelt)
    )


def _values(types: Iterable[str], numbers: Iterator[Any]) -> Iterator[Value]:
    """Yield the values of a module from what `Struct.unpack` has returned."""
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
            answer = Failed(module, release, reader.text(), reader.text())
        elif kind == _Kind.START_FAILED:
            answer = StartRefused(module, reader.text(), reader.text())
        else:
            return Garbled(f"a packet of kind {kind} is no answer")
    return answer if reader.at == len(reader.packet) else Garbled("a packet has bytes beyond its last value")


def _text(text: object) -> bytes:
    if not isinstance(text, str):
        raise Uncarriable(f"an output of a step has the name {text!r:.60}, which is not text; use a variable's name")
    data = text.encode("utf-8", "replace")
    if len(data) > _LIST:
        raise Uncarriable(
            f"the name that begins with {text[:20]!r} has {len(data)} bytes, but all results of a step may take "
            f"at most {ANSWER_BYTES}; use a shorter name"
        )
    return _COUNT.pack(len(data)) + data


def _list(items: Iterable[_T], encode: Callable[[_T], bytes]) -> bytes:
    parts = [encode(item) for item in items]
    if len(parts) > _LIST:
        raise Uncarriable(
            f"a step gives {len(parts)} outputs, commands, reports or requests, which are too many; give fewer"
        )
    return _COUNT.pack(len(parts)) + b"".join(parts)


class _Reader:
    """Reads a packet from front to back; raises struct.error or ValueError where the packet ends too early."""

    def __init__(self, packet: bytes) -> None:
        self.packet, self.at = packet, 0

    def take(self, layout: struct.Struct) -> tuple[int, ...]:
        """Read the numbers that `layout` describes."""
        found = layout.unpack_from(self.packet, self.at)
        self.at += layout.size
        return found

    def bytes(self, length: int) -> bytes:
        """Read `length` bytes."""
        found = self.packet[self.at : self.at + length]
        if len(found) != length:
            raise ValueError("a text in it is cut off")
        self.at += length
        return found

    def text(self) -> str:
        """Read a text, whose length comes first."""
        return self.bytes(self.take(_COUNT)[0]).decode()

    def list(self, read: Callable[[], _T]) -> list[_T]:
        """Read a list, whose length comes first; `read` reads one item."""
        return [read() for _ in range(self.take(_COUNT)[0])]
