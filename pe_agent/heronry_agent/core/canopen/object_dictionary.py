"""Serves the objects of `canopen_objects`: their values as bytes, and their access rights (CiA 301, 7.4).

The dictionary checks types, lengths and access rights. The caller gives a function for each value. The dictionary calls
this function when a client reads the value. The constructor raises InvariantError if a variable has no function, or a
function has no object. So the served objects are exactly those of `canopen_objects` and of the EDS.

An array element that does not exist at present is answered with NO_DATA. A write to an object that may be written, but
has no writer function, is answered with UNSUPPORTED. A value is written as a whole, or refused with a reason; no
request of a client raises an exception.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

from heronry_wire.canopen_objects import OBJECTS, Access, Entry, Kind, Type, Variable
from heronry_wire.sansio import require
from heronry_wire.sdo import Abort

MOST_BYTES = 1 << 20
"""Longest value that can be written."""

Value = int | str | bytes
Place = tuple[int, int]
Reader = Callable[[], Value]
Elements = Callable[[], Sequence[int | str]]
NumberWriter = Callable[[int], Abort | None]
BytesWriter = Callable[[bytes], Abort | None]

_ENTRIES = {entry.index: entry for entry in OBJECTS}


class ObjectDictionary:
    """The CANopen objects of one node: reads and writes their values."""

    def __init__(
        self,
        node: int,
        *,
        readers: Mapping[Place, Reader],
        arrays: Mapping[int, Elements],
        number_writers: Mapping[Place, NumberWriter],
        bytes_writers: Mapping[Place, BytesWriter],
        takes_bytes: Callable[[int], bool],
    ) -> None:
        """Take the functions that read and write the values; a place is (index, sub-index).

        readers: by place, a function that returns the value of a variable.
        arrays: by index of an array, a function that returns the elements of the array.
        number_writers, bytes_writers: by place, a function that writes a value, and returns None, or the reason
            why it refuses the value.
        takes_bytes: tells by index whether a value whose type has no fixed length may be written now; called when
            a write begins, before the first byte of the value comes.
        """
        self._node = node
        self._readers, self._arrays = readers, arrays
        self._number_writers, self._bytes_writers = number_writers, bytes_writers
        self._takes_bytes = takes_bytes
        given, needed = readers.keys() | arrays.keys(), set(_needed())
        require(given == needed, "objects without a value or values without an object: {}", given ^ needed)
        writers = {*number_writers, *bytes_writers}
        writable = {place for place in writers if self._right(*place) in (Access.READ_WRITE, Access.WRITE)}
        require(writers == writable, "writers for objects that are read-only: {}", writers - writable)

    def read(self, index: int, sub_index: int) -> bytes | Abort:
        """Return the bytes of an object's value, or the reason why it cannot be read."""
        variable = self._variable(index, sub_index)
        if isinstance(variable, Abort):
            return variable
        if variable.access is Access.WRITE:
            return Abort.WRITE_ONLY
        value = self._value(variable, index, sub_index)
        return value if isinstance(value, Abort) else _encode(variable.type, value)

    def room(self, index: int, sub_index: int, length: int | None) -> int | Abort:
        """Return how many bytes may be written to an object, or the reason why it cannot be written.

        length: the length that the client has announced, or None.
        """
        variable = self._variable(index, sub_index)
        if isinstance(variable, Abort):
            return variable
        if variable.access not in (Access.READ_WRITE, Access.WRITE):
            return Abort.READ_ONLY
        if (index, sub_index) not in self._number_writers and (index, sub_index) not in self._bytes_writers:
            return Abort.UNSUPPORTED
        if variable.type.length is None:
            if not self._takes_bytes(index):
                return Abort.DEVICE_STATE
            return Abort.OUT_OF_MEMORY if length is not None and length > MOST_BYTES else MOST_BYTES
        return Abort.LENGTH if length not in (None, variable.type.length) else variable.type.length

    def write(self, index: int, sub_index: int, data: bytes) -> Abort | None:
        """Write a value; returns None, or the reason why the value is refused.

        Call `room` first: it checks that the object exists and may be written.
        """
        if (index, sub_index) in self._bytes_writers:
            return self._bytes_writers[index, sub_index](data)
        variable = _ENTRIES[index].variable(sub_index)
        require(variable is not None, "{} is no variable, and `room` was not called", (index, sub_index))
        assert variable is not None
        if len(data) != variable.type.length:
            return Abort.LENGTH
        number = int.from_bytes(data, "little")
        if variable.limits is not None and not variable.limits[0] <= number <= variable.limits[1]:
            return Abort.VALUE
        return self._number_writers[index, sub_index](number)

    def _variable(self, index: int, sub_index: int) -> Variable | Abort:
        entry = _ENTRIES.get(index)
        if entry is None:
            return Abort.NO_OBJECT
        return entry.variable(sub_index) or Abort.NO_SUB_INDEX

    def _right(self, index: int, sub_index: int) -> Access | None:
        variable = self._variable(index, sub_index)
        return None if isinstance(variable, Abort) else variable.access

    def _value(self, variable: Variable, index: int, sub_index: int) -> Value | Abort:
        reader = self._readers.get((index, sub_index))
        if reader is not None:
            return reader()
        if index in self._arrays:
            elements = self._arrays[index]()[: _ENTRIES[index].most]
            if sub_index == 0:
                return len(elements)
            return elements[sub_index - 1] if sub_index <= len(elements) else Abort.NO_DATA
        assert variable.value is not None
        if variable.of_node:
            assert isinstance(variable.value, int)
            return variable.value + self._node
        return variable.value


class Locked:
    """An object dictionary that refuses to begin a write while `is_locked` returns True; reads are always allowed."""

    def __init__(self, objects: ObjectDictionary, is_locked: Callable[[], bool]) -> None:
        self.read, self.write = objects.read, objects.write  # never locked: a download that `room` admitted may end
        self._room, self._is_locked = objects.room, is_locked

    def room(self, index: int, sub_index: int, length: int | None) -> int | Abort:
        """Return what `ObjectDictionary.room` returns, but a refusal while writing is locked."""
        room = self._room(index, sub_index, length)
        return Abort.DEVICE_STATE if isinstance(room, int) and self._is_locked() else room


def _needed() -> Iterator[Place | int]:
    """Yield each object for which the constructor must be given a function that returns the object's value.

    A variable is given by its index and sub-index. An array whose number of elements changes at run time is
    given by its index.
    """
    for entry in OBJECTS:
        if _is_alive(entry):
            yield entry.index
            continue
        last = entry.most or len(entry.variables)
        for sub_index in (0,) if entry.kind in (Kind.VAR, Kind.DOMAIN) else range(1, last + 1):
            variable = entry.variable(sub_index)
            assert variable is not None
            is_fixed = variable.access is Access.CONST or variable.of_node
            if not is_fixed and variable.access is not Access.WRITE:
                yield entry.index, sub_index


def _is_alive(entry: Entry) -> bool:
    """Tell whether the number of elements of an array changes at run time."""
    return entry.kind is Kind.ARRAY and (entry.count is None or entry.count.access is not Access.CONST)


def _encode(kind: Type, value: Value) -> bytes:
    """Return a value as bytes.

    A number is little-endian; a number that is too large for its type becomes the largest number of the type.
    """
    if isinstance(value, int):
        assert kind.length is not None
        return min(value, (1 << 8 * kind.length) - 1).to_bytes(kind.length, "little")
    return value.encode("ascii", "replace") if isinstance(value, str) else value
