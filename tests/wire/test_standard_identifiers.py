"""The default identifier distribution, with the corrections that its head names."""

import subprocess
import sys

from heronry_wire.canaerospace import DataType
from heronry_wire.identifiers import Use, classify
from heronry_wire.standard_identifiers import standard_identifier, standard_identifiers


def test_an_identifier_has_a_name_types_and_a_unit() -> None:
    roll_rate = standard_identifier(304)
    assert roll_rate is not None
    assert (roll_rate.name, roll_rate.unit) == ("Body roll rate", "deg/s")
    assert roll_rate.types == (DataType.FLOAT, DataType.SHORT2)
    assert roll_rate.notes == "roll right: + roll left: -"
    assert not roll_rate.byte_2_is_an_index


def test_reserved_and_unassigned_identifiers_mean_nothing() -> None:
    for can_id in (299, 340, 628, 659, 1300, 1499, 1500):
        assert standard_identifier(can_id) is None


def test_every_row_is_a_standard_identifier() -> None:
    rows = standard_identifiers()
    assert len(rows) == 504
    for can_id, row in rows.items():
        assert row.can_id == can_id
        assert classify(can_id).use is Use.STANDARD_DATA
        assert row.name
        assert row.types


def test_longitudes_have_the_types_of_latitudes() -> None:
    for latitude, longitude in ((1000, 1001), (1036, 1037), (1049, 1050), (1059, 1060)):
        east, north = standard_identifier(longitude), standard_identifier(latitude)
        assert east is not None
        assert north is not None
        assert "longitude" in east.name
        assert east.types == north.types


def test_waypoints_tyres_and_brakes_use_byte_2_as_an_index() -> None:
    indexed = [can_id for can_id, row in standard_identifiers().items() if row.byte_2_is_an_index]
    assert len(indexed) == 44
    assert {1000, 1035, 1177, 1184} <= set(indexed)


def test_an_import_does_not_read_the_file() -> None:
    program = (
        "import heronry_wire.standard_identifiers as s\n"
        "assert s.standard_identifiers.cache_info().currsize == 0\n"
        "assert s.standard_identifier(322).name == 'Standard altitude'\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
