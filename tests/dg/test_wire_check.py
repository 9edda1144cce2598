"""DG5xx beyond the examples of its rules: spellings of units, phases, buses behind gateways, and the shipped specs."""

import pytest

from heronry_dg.check.assess import assess
from heronry_dg.check.examples import whole_spec
from heronry_dg.check.wire import check, lacks_identifiers
from heronry_dg.findings import Finding
from heronry_dg.loader import loads
from heronry_dg.rules.wire import FAMILY, STARVED, TOO_MANY_SOURCES
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_dg.traffic import identifiers
from heronry_tools.analysis.check.registry import RULES
from heronry_wire.frame import WireError


def found_in(fragment: str) -> list[Finding]:
    return list(assess(whole_spec(fragment), "x.dg.yaml", {FAMILY.prefix: check}, FAMILY.rules).findings)


def speed_in(unit: str, identifier: int) -> list[Finding]:
    return found_in(f"variables:\n  speed: {{type: FLOAT, unit: {unit}, identifier: {identifier}}}\n")


@pytest.mark.parametrize(
    ("unit", "identifier"), [("V", 920), ("volt", 920), ("rpm", 500), ("1/min", 500), ("mbar", 326), ("°", 311)]
)
def test_another_spelling_of_the_same_unit_is_understood(unit: str, identifier: int) -> None:
    assert speed_in(unit, identifier) == []


def test_another_unit_is_an_error_that_says_how_to_convert() -> None:
    (finding,) = speed_in("ft", 322)
    assert finding.code == "DG502"
    assert finding.hint == "1 ft is 0.3048 m"
    assert (finding.place.line, finding.place.column) == (10, 24)


def test_a_unit_that_is_left_out_is_a_warning_unless_the_list_lacks_it() -> None:
    (finding,) = found_in("variables:\n  speed: {type: FLOAT, identifier: 322}\n")
    assert finding.code == "DG510"
    assert finding.hint == "write unit: m if that is what its producer gives"
    assert found_in("variables:\n  speed: {type: BLONG, unit: flags, identifier: 408}\n") == []


def test_each_type_that_the_list_allows_is_allowed() -> None:
    assert found_in("variables:\n  speed: {type: SHORT2, unit: g, identifier: 300}\n") == []
    (finding,) = found_in("variables:\n  speed: {type: USHORT, unit: g, identifier: 300}\n")
    assert finding.sentence.endswith("is FLOAT or SHORT2")


@pytest.mark.parametrize(
    ("bus", "hint"),
    [
        ("bitrate: 12345", "write 10000 or 20000, unless every controller on this bus can be set to 12345"),
        ("bitrate: 500", "write 500000, unless every controller on this bus can be set to 500"),
        ("bitrate: 12500", "write 125000, unless every controller on this bus can be set to 12500"),
        ("bitrate: 999999", "write 800000 or 1000000, unless every controller on this bus can be set to 999999"),
        ("bitrate: 83333", None),
        ("bitrate: 100000", None),
        ("bitrate: 12345, kind: wireless", None),  # 112.5 kbit/s, as that of big_blue
    ],
)
def test_a_wired_bus_with_an_unusual_bit_rate_is_told_and_a_radio_may_have_any(bus: str, hint: str | None) -> None:
    found = found_in(f"buses: {{can0: {{bitrate: 500000}}, other: {{{bus}}}}}\n")
    assert [one.hint for one in found if one.code == "DG509"] == ([] if hint is None else [hint])


@pytest.mark.parametrize(("identifier", "is_index"), [(1000, True), (1035, True), (1036, False), (1177, True)])
def test_identifiers_with_an_index_in_byte_2(identifier: int, is_index: bool) -> None:
    kind = "BLONG" if identifier == 1035 else "FLOAT"
    found = found_in(f"variables:\n  speed: {{type: {kind}, identifier: {identifier}}}\n")
    assert [finding.code for finding in found if finding.code != "DG510"] == (["DG504"] if is_index else [])


def test_a_spec_lacks_identifiers_just_where_allocation_fails() -> None:
    scarce = loads(whole_spec(TOO_MANY_SOURCES.bad).decode(), "scarce")
    enough = loads(whole_spec(TOO_MANY_SOURCES.good).decode(), "enough")
    assert lacks_identifiers(scarce)
    with pytest.raises(WireError):
        identifiers(scarce)
    assert not lacks_identifiers(enough)
    assert len(identifiers(enough)) == 221


def test_what_never_leaves_its_pe_is_not_outranked() -> None:
    """The chatter's reader moves to the PE of its giver: nothing of it is on the bus, so no datum waits for it."""
    together = STARVED.bad.replace("recorder: {kind: actuator, pe: tail}", "recorder: {kind: actuator, pe: nav}")
    assert found_in(together) == []


def test_what_matters_less_in_every_phase_is_not_asked_about() -> None:
    assert found_in(STARVED.bad.replace("criticality: A", "criticality: C")) == []
    assert found_in(STARVED.bad.replace("criticality: A", "criticality: B")) != []


def test_data_that_would_wait_too_long_for_its_equals_alone_is_not_blamed_on_lesser_data() -> None:
    """With the chatter as critical as the rest, the order of arbitration is no finding."""
    assert found_in(STARVED.bad.replace("{output: logger}", "{output: logger, criticality: A}")) == []


@pytest.mark.parametrize("name", shipped_spec_names())
def test_shipped_specs_say_what_canaerospace_says(name: str) -> None:
    data = shipped_spec_path(name).read_bytes()
    assert assess(data, name, {FAMILY.prefix: check}, RULES).findings == ()
