"""Messages between an agent and its partitions arrive unchanged; no other packet raises."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_agent.module import Value
from heronry_agent.shell.module_runner import Orders, Result
from heronry_agent.shell.partition_messages import (
    ANSWER_BYTES,
    Answer,
    Done,
    Failed,
    Garbled,
    Load,
    Loaded,
    Order,
    Start,
    StartRefused,
    Step,
    Stop,
    Uncarriable,
    decode_answer,
    decode_orders,
    encode_answer,
    encode_orders,
)

integers = st.integers(-(2**63), 2**63 - 1)
values = st.one_of(
    integers,
    st.floats(allow_nan=False),
    st.text(max_size=8),
    st.binary(max_size=8),
    st.lists(integers, max_size=4).map(tuple),
)
modules, releases, times = st.integers(0, 0xFFFF), st.integers(0, 2**64 - 1), integers
names = st.text(max_size=12)
orders = st.one_of(
    st.builds(Load, st.lists(names, max_size=3).map(tuple)),
    st.builds(Stop, modules, st.booleans()),
    st.builds(
        Start,
        modules,
        st.builds(Orders, names, names, names, st.integers(0, 2**64 - 1), st.booleans()),
        st.lists(st.tuples(names, names), max_size=3).map(tuple),
    ),
    st.builds(
        Step,
        modules,
        releases,
        times,
        st.integers(0, 2**64 - 1),
        st.none() | values,
        st.lists(st.tuples(st.integers(0, 255), values, st.integers(1, 15), times, st.booleans()), max_size=3),
    ),
)
results = st.builds(
    Result,
    st.dictionaries(names, values, max_size=3),
    st.lists(values, max_size=3).map(tuple),
    st.lists(st.tuples(names, st.integers(0, 0xFFFF)), max_size=3).map(tuple),
    st.lists(names, max_size=3).map(tuple),
)
answers = st.one_of(
    st.builds(Loaded, st.dictionaries(names, names, max_size=3)),
    st.builds(StartRefused, modules, names),
    st.builds(Done, modules, releases, times, results),
    st.builds(Failed, modules, releases, names),
)


@given(st.lists(orders, max_size=3))
def test_orders_arrive_as_they_were_given_and_in_order(given: list[Order]) -> None:
    assert list(decode_orders(encode_orders(given))) == given


@given(answers)
def test_an_answer_arrives_as_it_was_given(answer: Answer) -> None:
    assert not isinstance(answer, Garbled)
    assert decode_answer(encode_answer(answer)) == answer


@given(results, st.binary(max_size=40), st.integers(0, 60))
def test_a_step_s_answer_with_other_bytes_in_it_is_an_answer_or_garbled(result: Result, other: bytes, at: int) -> None:
    packet = encode_answer(Done(1, 2, 3, result))
    decoded = decode_answer(packet[:at] + other + packet[at + len(other) :])
    assert isinstance(decoded, (Done, Failed, StartRefused, Loaded, Garbled))


@given(answers, st.binary(min_size=1, max_size=4))
def test_an_answer_with_more_or_less_in_it_is_garbled(answer: Answer, more: bytes) -> None:
    assert not isinstance(answer, Garbled)
    packet = encode_answer(answer)
    assert isinstance(decode_answer(packet + more), Garbled)
    assert isinstance(decode_answer(packet[:-1]), Garbled)


@given(st.binary(max_size=80))
def test_bytes_of_any_kind_are_an_answer_or_garbled(packet: bytes) -> None:
    decoded = decode_answer(packet)
    assert isinstance(decoded, Garbled) or decode_answer(encode_answer(decoded)) == decoded or _has_nan(decoded)


def _has_nan(answer: Answer) -> bool:
    return isinstance(answer, Done) and any(
        isinstance(value, float) and math.isnan(value)
        for value in (*answer.result.outputs.values(), *answer.result.writes)
    )


def stepped(outputs: list[bytes], types: list[bytes], length: int, values: bytes = b"") -> bytes:
    """The answer to a step with these names and types, and bytes of this length for the values."""
    lists = (outputs, types, [], [], [], [])
    names = b"".join(
        struct.pack("<H", len(each)) + b"".join(struct.pack("<H", len(text)) + text for text in each) for each in lists
    )
    return struct.pack("<BHQqH", 3, 1, 1, 1, len(names)) + names + values.ljust(length, b"\0")


def test_a_step_s_answer_reads_as_it_is_laid_out() -> None:
    assert decode_answer(stepped([b"a"], [b"i", b"s2"], 10)) == Done(1, 1, 1, Result({"a": 0}, ("\0\0",)))
    assert decode_answer(stepped([b"a" * 2000], [b"f"], 8)) == Done(1, 1, 1, Result({"a" * 2000: 0.0}))


@pytest.mark.parametrize(
    "packet",
    [
        b"",
        b"\x09" + bytes(10),  # no kind of answer
        encode_orders([Load(())]),
        bytes(ANSWER_BYTES + 1),
        *(stepped([b"a"], [kind], 8) for kind in (b"", b"z", b"s", b"s-1", b"t8x", b"i8x", b"\xff", b"s9", b"s7")),
        stepped([b"a"], [], 0),  # no value for a name
        stepped([], [b"s2"], 2, b"\xff\xff"),  # no text
        stepped([], [], 0)[:-3],
        stepped([b"a" * 2000], [b"f"], 7),  # longer than what is kept
    ],
)
def test_what_is_no_answer_is_garbled(packet: bytes) -> None:
    assert isinstance(decode_answer(packet), Garbled)


def test_true_and_a_number_of_ones_own_kind_travel_as_numbers() -> None:
    class Celsius(float):
        pass

    packet = encode_answer(Done(1, 1, 1, Result({"a": True, "b": Celsius(3.5)})))
    assert decode_answer(packet) == Done(1, 1, 1, Result({"a": 1, "b": 3.5}))


@pytest.mark.parametrize(
    "outputs",
    [
        {"a": None},
        {"a": 2**63},
        {"a": [1, 2]},
        {"a": (1, "b")},
        {"a": object()},
        {3: 1},
        {"a": "x" * 70_000},
        {"a": b"x" * ANSWER_BYTES},
        {str(number): 0 for number in range(70_000)},
    ],
)
def test_what_is_no_plain_value_or_too_much_cannot_be_carried(outputs: dict[str, Value]) -> None:
    with pytest.raises(Uncarriable):
        encode_answer(Done(1, 1, 1, Result(outputs)))
