"""What travels between an agent and its partitions arrives as it was; whatever else arrives does not raise."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_agent.module import Datum, Value
from heronry_agent.module_runner import Orders, Result
from heronry_agent.partition_messages import (
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
    decode_order,
    encode_answer,
    encode_order,
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
data = st.builds(Datum, values, st.integers(1, 15), times, st.booleans())
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
        st.lists(st.tuples(st.integers(0, 255), data), max_size=3),
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


@given(orders)
def test_an_order_arrives_as_it_was_given(order: Order) -> None:
    assert decode_order(encode_order(order)) == order


@given(answers)
def test_an_answer_arrives_as_it_was_given(answer: Answer) -> None:
    assert not isinstance(answer, Garbled)
    assert decode_answer(encode_answer(answer)) == answer


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


@pytest.mark.parametrize(
    "packet",
    [
        b"\x09" + bytes(10),  # no kind of answer
        b"\x01\x00\x00",  # an order
        bytes(ANSWER_BYTES + 1),
        encode_answer(Done(1, 1, 1, Result({"a": 1}))).replace(b"ai", b"az"),  # no type of a value
        encode_answer(Done(1, 1, 1, Result({"a": 1}))).replace(b"ai", b"an"),  # none, where one must be
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
