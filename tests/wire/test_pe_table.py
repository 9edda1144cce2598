"""PE tables: an agent reads what the manager compiles, and refuses any other text with one sentence.

Where a test changes a table, it makes the check sum anew, so that what it changed is found, and not only the wrong sum.
"""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_manager.core.tables.compilation import Compiler
from heronry_wire.pe_table import PeTable, TableError, added_in, with_check_sum
from heronry_wire.protocol_version import PROTOCOL, Version

Json = Any
Path = tuple[str | int, ...]

WRONG_NUMBERS: tuple[Json, ...] = (True, 1.5, "1", None, [1], {})


@cache
def compiled() -> tuple[PeTable, ...]:
    """Tables of all PEs of both shipped specs."""
    specs = [load(shipped_spec_path(name)) for name in shipped_spec_names()]
    return tuple(Compiler(spec).table(pe) for spec in specs for pe in spec.pes)


@cache
def small_text() -> str:
    """The shortest of them, which the tests below change."""
    return min((table.to_json() for table in compiled()), key=len)


def places(value: Json, path: Path = ()) -> Iterator[Path]:
    """Where every value of a JSON document is."""
    yield path
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in children:
        yield from places(child, (*path, key))


def content() -> Json:
    """The small table's JSON object, without its check sum."""
    document = json.loads(small_text())
    del document["sha256"]
    return document


def changed(path: Path, value: Json) -> str:
    """Text of the small table with another value at one place."""
    document = content()
    if not path:
        return with_check_sum(value) if isinstance(value, dict) else json.dumps(value)
    parent = document
    for key in path[:-1]:
        parent = parent[key]
    parent[path[-1]] = value
    return with_check_sum(document)


def refused(text: str) -> str:
    with pytest.raises(TableError) as caught:
        PeTable.from_json(text)
    sentence = str(caught.value)
    assert sentence.endswith("; write the table anew with 'heronry table'")
    assert "\n" not in sentence
    assert len(sentence) < 500
    return sentence


def test_every_table_of_the_shipped_specs_survives_its_text() -> None:
    assert len(compiled()) == 12
    for table in compiled():
        text = table.to_json()
        assert PeTable.from_json(text) == table
        assert "\n" not in text


def test_the_number_of_leaves_is_that_of_the_spec() -> None:
    spec = load(shipped_spec_path("big_blue"))
    table = Compiler(spec).table("nav")
    names = list(spec.modules)
    for (module, mode), count in table.leaf_counts().items():
        entry = spec.modules[names[module]]
        assert count == len(list(list(entry.modes.values())[mode].leaves()))


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def test_a_key_that_is_no_word_breaks_no_line() -> None:
    assert "gives.\\n holds None" in refused(changed(("modules", 0, "modes", 0, "gives"), {"\n": None}))


@given(st.data(), json_values)
def test_a_change_anywhere_gives_a_table_or_an_error(data: st.DataObject, value: Json) -> None:
    path = data.draw(st.sampled_from(list(places(content()))))
    text = changed(path, value)
    try:
        table = PeTable.from_json(text)
    except TableError:
        refused(text)
    else:
        assert PeTable.from_json(table.to_json()) == table


@given(st.data())
def test_a_key_more_or_less_anywhere_is_an_error(data: st.DataObject) -> None:
    document = content()
    path = data.draw(st.sampled_from([p for p in places(document) if p and isinstance(p[-1], str)]))
    assume(path[:-1] != ("variables",) and "gives" not in path[:-1])  # keys that are names
    parent = document
    for key in path[:-1]:
        parent = parent[key]
    parent[f"{path[-1]}_"] = parent[path[-1]]
    refused(with_check_sum(document))
    del parent[path[-1]]
    refused(with_check_sum(document))


@given(st.text())
def test_any_text_is_an_error(text: str) -> None:
    refused(text)


@given(st.data())
def test_a_table_cut_short_is_an_error(data: st.DataObject) -> None:
    refused(small_text()[: data.draw(st.integers(0, len(small_text()) - 1))])


def test_every_number_is_checked_for_its_type() -> None:
    numbers = [p for p in places(content()) if type(value_at(p)) is int]
    assert len(numbers) > 50
    for path in numbers:
        if path[-1] != "initial":  # which may be of any type a variable has
            for wrong in WRONG_NUMBERS:
                said = refused(changed(path, wrong))
                assert "holds" in said or (path[0] == "protocol" and wrong is None)


def value_at(path: Path) -> Json:
    value = json.loads(small_text())
    for key in path:
        value = value[key]
    return value


def test_deep_nesting_is_an_error_at_every_depth() -> None:
    for depth in [*range(1, 30), *range(800, 1100), 100_000]:
        nested = "[" * depth + "]" * depth
        refused(nested)
        refused(small_text().replace('"gps_altitude":1', f'"gps_altitude":{nested}'))  # itself deep in the table


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "9" * 5000])
def test_numbers_that_are_none_are_errors(number: str) -> None:
    refused(number)
    refused(small_text().replace('"initial":null', f'"initial":{number}', 1))


@pytest.mark.parametrize("initial", [0, 1.5, "X", [1, 2], None])
def test_an_initial_value_may_be_whatever_a_variable_can_hold(initial: Json) -> None:
    name = next(iter(value_at(("variables",))))
    table = PeTable.from_json(changed(("variables", name, "initial"), initial))
    assert table.variables[name].initial == (tuple(initial) if isinstance(initial, list) else initial)


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        (("protocol",), None, "names no version of the protocol"),
        (("protocol",), "1.0", "table.protocol holds '1.0'"),
        (("node_id",), 91, "node_id 91 is not a PE's"),
        (("node_id",), 126, "node_id 126 is not a PE's"),
        (("uplink",), 1, "uplink 1 names no port; there are 1"),
        (("uplink",), -1, "uplink -1 names no port"),
        (("ports",), [], "uplink 0 names no port; there are 0"),
        (("spec_digest",), "zz" * 32, "is not a SHA-256"),
        (("spec_digest",), "ab", "spec_digest ab is not a SHA-256"),
        (("without_manager",), "panic", "table.without_manager holds 'panic'"),
        (("devices", 0, "kind"), "toaster", "table.devices[0].kind holds 'toaster'"),
        (("sources", 0, "identifier"), 200, "has identifier 200, which is not one for data"),
        (("sources", 0, "identifier"), 5000, "has identifier 5000"),
        (("modules", 0, "index"), -1, "is not number -1 of module_names"),
        (("modules", 0, "index"), 10**9, "is not number 1000000000 of module_names"),
        (("modules", 0, "modes", 0, "rate_mhz"), 0, "has the rate 0 mHz"),
        (("ports", 0, "bitrate"), 0, "has 0 bit/s"),
        (("ports", 0, "nodes"), [91], "leads to node 91"),
        (("modules", 0, "modes", 0, "cpu_millis"), -1, "takes -1 thousandths"),
        (("modules", 0, "modes", 0, "gives"), {"ghost": 1}, "names the unknown variable ghost"),
        (("modules", 0), [], "table.modules[0] holds []"),
        (
            (),
            {"protocol": {"major": 1, "minor": 0}},
            "table has missing or unknown fields (adjustable, bus_names, command_period_ns, contingencies",
        ),
        ((), [], "not a JSON object"),
    ],
)
def test_an_error_names_its_place(path: Path, value: Json, sentence: str) -> None:
    assert sentence in refused(changed(path, value))


def test_two_modules_have_two_indices() -> None:
    modules = value_at(("modules",))
    assert "two modules have the same index" in refused(changed(("modules",), [modules[0], modules[0]]))


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [("data_per_mille", 0, "must be 1 to 1000"), ("link_id", 300, "which is not one for gateways")],
)
def test_a_port_that_cannot_be_is_refused(key: str, value: int, says: str) -> None:
    assert says in refused(changed(("ports", 0, key), value))


CHECKPOINT = {
    "module": 0, "number": 3, "data_bytes": 24, "period_ns": 10, "gap_ns": 1, "max_age_ns": 5, "late_ns": None,
    "towards": [[93]], "waits_ns": [7],
}  # fmt: skip


def test_checkpoints_are_told_only_where_there_are_any() -> None:
    assert "checkpoints" not in content()
    text = changed(("checkpoints",), [CHECKPOINT])
    table = PeTable.from_json(text)
    assert (table.checkpoints[0].number, table.checkpoints[0].towards) == (3, ((93,),))
    assert table.to_json() == text


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"module": 999}, "the checkpoint of module 999 is of no module of module_names"),
        ({"number": 256}, "has number 256 and 24 bytes, which do not fit into its frames"),
        ({"number": -1}, "has number -1"),
        ({"data_bytes": 0}, "and 0 bytes, which do not fit"),
        ({"data_bytes": 1276}, "and 1276 bytes, which do not fit"),
        ({"period_ns": 0}, "has a time that is not above 0"),
        ({"gap_ns": 0}, "has a time that is not above 0"),
        ({"max_age_ns": 0}, "has a time that is not above 0"),
        ({"late_ns": -1}, "has a time that is not above 0"),
        ({"waits_ns": [-1]}, "has a time that is not above 0"),
        ({"waits_ns": []}, "goes to ports or nodes that do not exist"),
        ({"towards": []}, "goes to ports or nodes that do not exist"),
        ({"towards": [[91]]}, "goes to ports or nodes that do not exist"),
    ],
)
def test_a_checkpoint_that_cannot_be_is_refused(wrong: dict[str, Json], says: str) -> None:
    assert says in refused(changed(("checkpoints",), [{**CHECKPOINT, **wrong}]))


def test_two_checkpoints_do_not_share_a_number() -> None:
    assert "two checkpoints have the same number" in refused(changed(("checkpoints",), [CHECKPOINT, CHECKPOINT]))


# Check sum, and growth


def test_a_flipped_bit_anywhere_is_refused_or_changes_nothing() -> None:
    text = small_text().encode()
    table = PeTable.from_json(small_text())
    outcomes = [_read(flipped, table) for flipped in _flipped(text, range(0, 8 * len(text), 7))]
    assert all("\n" not in outcome for outcome in outcomes if outcome is not None)


def _flipped(text: bytes, bits: Iterable[int]) -> Iterator[bytes]:
    for bit in bits:
        flipped = bytearray(text)
        flipped[bit // 8] ^= 1 << bit % 8
        yield bytes(flipped)


def _read(text: bytes, table: PeTable) -> str | None:
    """The sentence with which a text is refused; None for text that gives this table, as all others must not."""
    try:
        found = PeTable.from_json(text.decode())
    except (TableError, UnicodeDecodeError) as error:  # an agent refuses what is no UTF-8 before it reads a table
        return str(error)
    assert found == table
    return None


def test_a_table_without_its_check_sum_is_refused() -> None:
    assert "lacks its check sum" in refused(json.dumps(content()))


def test_a_table_of_another_major_is_refused_with_both_versions() -> None:
    other = Version(PROTOCOL.major + 1, 7)
    with pytest.raises(TableError, match=f"is of protocol {other}, and this agent speaks {PROTOCOL}: install the same"):
        PeTable.from_json(changed(("protocol",), {"major": other.major, "minor": other.minor}))


@pytest.mark.parametrize(("path", "place"), [(("later",), "table"), (("ports", 0, "later"), "table.ports[0]")])
def test_what_a_later_minor_added_is_skipped_and_changes_no_digest(path: Path, place: str) -> None:
    later = json.loads(changed(path, 5))
    del later["sha256"]
    assert f"{place} has missing or unknown fields (later)" in refused(with_check_sum(later))
    later["protocol"]["minor"] = PROTOCOL.minor + 1
    table = PeTable.from_json(with_check_sum(later))
    assert table.protocol == Version(PROTOCOL.major, PROTOCOL.minor + 1)
    assert table.identity == PeTable.from_json(small_text()).identity


@dataclass(frozen=True)
class LaterTable(PeTable):
    """A table as the next minor of the protocol may have it."""

    later: int = added_in(PROTOCOL.minor + 1, 9)


def test_a_table_of_an_earlier_minor_is_read_with_the_default_of_what_came_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("heronry_wire.pe_table.PROTOCOL", Version(PROTOCOL.major, PROTOCOL.minor + 1))
    table = LaterTable.from_json(small_text())
    assert (table.later, table.identity) == (9, PeTable.from_json(small_text()).identity)
    refused(changed(("later",), "ten"))


def test_the_identity_is_that_of_the_wiring_and_not_of_the_pace_or_the_contingencies() -> None:
    table = PeTable.from_json(small_text())
    for path, value in (
        (("ports", 0, "heartbeat_ns"), 77),
        (("command_period_ns",), 77),
        (("contingencies",), "AAAA"),
    ):
        assert PeTable.from_json(changed(path, value)).identity == table.identity
    for path, value in (
        (("spec_digest",), "ab" * 32),
        (("sources", 0, "identifier"), 1001),
        (("modules", 0, "image"), "another"),
        (("ports", 0, "misses"), 4),
    ):
        assert PeTable.from_json(changed(path, value)).identity != table.identity
    major = replace(table, protocol=Version(PROTOCOL.major + 1, 0))
    assert major.identity != table.identity
    assert replace(table, protocol=Version(PROTOCOL.major, 7)).identity == table.identity


def test_a_node_may_part_its_modules_further_and_its_table_is_still_the_same() -> None:
    table = PeTable.from_json(small_text())
    module = table.modules[0]
    parted = table.with_partitions({module.index: "of its own"})
    assert parted.modules[0] == replace(module, partition="of its own")
    assert parted.modules[1:] == table.modules[1:]
    assert (parted.identity, parted.to_json()) == (table.identity, table.to_json())
