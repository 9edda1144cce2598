"""What the object dictionary refuses by itself, and that it agrees with the table of objects."""

from typing import Any

import pytest

from heronry_agent.core.canopen.object_dictionary import MOST_BYTES, ObjectDictionary
from heronry_wire.canopen_objects import ERROR_HISTORY, HEARTBEAT_TIME, IDENTITY, OBJECTS, TABLE, Access, Kind
from heronry_wire.sansio import InvariantError
from heronry_wire.sdo import Abort

NODE = 93
ARRAYS = [entry.index for entry in OBJECTS if entry.kind is Kind.ARRAY and entry.most > 1]
PLACES = [
    (entry.index, sub_index)
    for entry in OBJECTS
    if entry.index not in ARRAYS
    for sub_index in range(max(entry.most, len(entry.variables)) + 1)
    if (variable := entry.variable(sub_index)) is not None
    and variable.access not in (Access.CONST, Access.WRITE)
    and not variable.of_node
]


def dictionary(**other: Any) -> ObjectDictionary:
    """A dictionary whose values are 7, or seven letters, and that takes every value that fits."""
    given = {
        "readers": {place: lambda: 7 for place in PLACES},
        "arrays": {index: lambda: ["a name"] * 300 for index in ARRAYS},
        "number_writers": {(HEARTBEAT_TIME, 0): lambda _: None, (ERROR_HISTORY, 0): lambda _: None},
        "bytes_writers": {(TABLE, 0): lambda _: None},
        "takes_bytes": lambda _: True,
    }
    return ObjectDictionary(NODE, **{**given, **other})


def test_every_object_has_a_value_and_every_value_an_object() -> None:
    dictionary()
    readers = {place: lambda: 7 for place in PLACES}
    with pytest.raises(InvariantError, match="4120"):  # the identity is fixed
        dictionary(readers={**readers, (IDENTITY, 1): lambda: 7})
    with pytest.raises(InvariantError, match="4119"):  # nothing gives the heartbeat time
        dictionary(readers={place: lambda: 7 for place in PLACES if place != (HEARTBEAT_TIME, 0)})
    with pytest.raises(InvariantError, match="read-only"):
        dictionary(number_writers={(IDENTITY, 1): lambda _: None})
    with pytest.raises(InvariantError, match="read-only"):
        dictionary(bytes_writers={(0x3000, 0): lambda _: None})


def test_numbers_are_little_endian_and_never_longer_than_their_type() -> None:
    readers = {place: lambda: 0x0102 for place in PLACES}
    large = dictionary(readers={**readers, (HEARTBEAT_TIME, 0): lambda: 0x12345})
    assert large.read(HEARTBEAT_TIME, 0) == b"\xff\xff"
    assert large.read(0x2000, 5) == b"\x02\x01\0\0"
    assert large.read(0x2000, 1) == b"\xff"


def test_an_array_shows_as_many_elements_as_sub_indices_can_name() -> None:
    assert dictionary().read(0x2010, 0) == bytes((254,))
    assert dictionary().read(0x2010, 254) == b"a name"
    assert dictionary().read(0x2010, 255) is Abort.NO_SUB_INDEX


@pytest.mark.parametrize(
    ("place", "length", "answer"),
    [
        ((0x3000, 0), 1, Abort.NO_OBJECT),
        ((IDENTITY, 9), 1, Abort.NO_SUB_INDEX),
        ((IDENTITY, 1), 4, Abort.READ_ONLY),
        ((0x2000, 1), 1, Abort.READ_ONLY),
        ((0x1F51, 1), 1, Abort.UNSUPPORTED),
        ((HEARTBEAT_TIME, 0), 4, Abort.LENGTH),
        ((HEARTBEAT_TIME, 0), 2, 2),
        ((HEARTBEAT_TIME, 0), None, 2),
        ((TABLE, 0), MOST_BYTES, MOST_BYTES),
        ((TABLE, 0), MOST_BYTES + 1, Abort.OUT_OF_MEMORY),
        ((TABLE, 0), None, MOST_BYTES),
    ],
)
def test_how_much_may_be_written(place: tuple[int, int], length: int | None, answer: int | Abort) -> None:
    assert dictionary().room(*place, length) == answer


def test_long_values_can_be_refused_before_they_come() -> None:
    busy = dictionary(takes_bytes=lambda _: False)
    assert busy.room(TABLE, 0, 100) is Abort.DEVICE_STATE
    assert busy.room(HEARTBEAT_TIME, 0, 2) == 2


def test_a_number_of_another_length_or_beyond_its_limits_is_refused() -> None:
    assert dictionary().write(HEARTBEAT_TIME, 0, b"\1\2\3") is Abort.LENGTH
    assert dictionary().write(ERROR_HISTORY, 0, b"\1") is Abort.VALUE
    assert dictionary().write(ERROR_HISTORY, 0, b"\0") is None


def test_a_write_without_a_call_of_room_is_an_error_of_the_caller() -> None:
    with pytest.raises(InvariantError, match="`room` was not called"):
        dictionary().write(IDENTITY, 9, b"\1")
