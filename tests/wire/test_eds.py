"""The EDS agrees with the table of objects, and CANopen tools read it."""

import io
from pathlib import Path

import canopen
import pytest
from canopen.objectdictionary import ODArray, ODRecord, ODVariable

from heronry_wire.canopen_objects import OBJECTS, Kind
from heronry_wire.eds import FILE_NAME, eds_text


@pytest.fixture(scope="module")
def read() -> canopen.ObjectDictionary:
    file = io.StringIO(eds_text())
    file.name = FILE_NAME
    return canopen.import_od(file, 92)


def test_the_shipped_eds_is_the_one_that_the_table_gives() -> None:
    shipped = Path(f"dbc/{FILE_NAME}").read_text(encoding="ascii")
    assert shipped == eds_text(), f"write it anew: heronry eds -o dbc/{FILE_NAME}"


def test_every_object_is_read_back_as_it_is(read: canopen.ObjectDictionary) -> None:
    assert list(read) == [entry.index for entry in OBJECTS]
    kinds = {Kind.VAR: ODVariable, Kind.DOMAIN: ODVariable, Kind.ARRAY: ODArray, Kind.RECORD: ODRecord}
    for entry in OBJECTS:
        found = read[entry.index]
        assert type(found) is kinds[entry.kind]
        assert found.name == entry.name
        highest = entry.most or len(entry.variables)
        for sub_index in (0,) if isinstance(found, ODVariable) else range(highest + 1):
            wanted = entry.variable(sub_index)
            got = found if isinstance(found, ODVariable) else found[sub_index]
            assert wanted is not None
            assert got.data_type == wanted.type.code
            if sub_index or entry.most != 254:  # the count of a compact array has no section of its own
                assert got.access_type == wanted.access.value
            if isinstance(wanted.value, int) and got.default is not None:
                assert got.default == wanted.value + 92 * wanted.of_node


def test_what_every_node_must_have_is_there(read: canopen.ObjectDictionary) -> None:
    assert {0x1000, 0x1001, 0x1018} <= set(read)
    assert read.device_information.nr_of_TXPDO == read.device_information.nr_of_RXPDO == 0
    assert read.device_information.LSS_supported is False
    assert 1_000_000 in read.device_information.allowed_baudrates


def test_a_sub_index_that_an_object_does_not_have_is_none() -> None:
    for entry in OBJECTS:
        highest = 0 if entry.kind in (Kind.VAR, Kind.DOMAIN) else entry.most or len(entry.variables)
        assert entry.variable(highest) is not None
        assert entry.variable(highest + 1) is None


def test_names_are_plain_and_told_from_each_other() -> None:
    names = [entry.name for entry in OBJECTS]
    assert len(set(names)) == len(names)
    assert eds_text().isascii()
