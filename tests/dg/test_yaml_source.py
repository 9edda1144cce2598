"""The YAML of a spec: places, what is refused, and malicious files."""

from decimal import Decimal

import pytest

from dg.marked_spec import complaint, complaints, findings, spec_text
from heronry_dg import yaml_source
from heronry_dg.findings import Findings, Place
from heronry_dg.plain_scalars import Surprise, resolve


def tree(text: str) -> yaml_source.Node:
    found = Findings("test")
    root = yaml_source.read_tree(text.encode(), found)
    assert root is not None, str(found.error())
    assert not found, str(found.error())
    return root


def test_keys_and_values_know_their_places() -> None:
    root = tree("a: 1\nb:\n  - x\n  - {c: 2.50}\n")
    assert yaml_source.plain(root) == {"a": 1, "b": ["x", {"c": Decimal("2.50")}]}
    assert yaml_source.key_place(root, "b") == Place(2, 1)
    assert yaml_source.place_at(root, ("b", 1, "c")) == Place(4, 9)
    assert yaml_source.place_at(root, ("b", 7, "c")) == Place(3, 3)


def test_columns_count_characters_not_bytes() -> None:
    assert yaml_source.key_place(tree("{é€: 1, b: 2}"), "b") == Place(1, 9)


def test_a_byte_order_mark_is_no_content() -> None:
    assert yaml_source.place_at(tree("\ufeffa: 1"), ("a",)) == Place(1, 4)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("null", None),
        ("~", None),
        ("true", True),
        ("false", False),
        ("0", 0),
        ("-12", -12),
        ("0.05", Decimal("0.05")),
        ("1e-5", Decimal("0.00001")),
        ("2.5E3", Decimal(2500)),
        ("64KiB", "64KiB"),
        ("altitude@<=2", "altitude@<=2"),
        ("m/s", "m/s"),
        ("y", "y"),
        ("-", "-"),
        ("...", "..."),
        ("1.2.3", "1.2.3"),
        ("10ms", "10ms"),
    ],
)
def test_what_a_plain_scalar_stands_for(text: str, value: object) -> None:
    resolved = resolve(text)
    assert (type(resolved), resolved) == (type(value), value)


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        *((word, "write true") for word in ("yes", "Yes", "YES", "on", "On", "ON", "True", "TRUE")),
        *((word, "write false") for word in ("no", "No", "NO", "off", "Off", "OFF", "False", "FALSE")),
        *((word, "write null") for word in ("Null", "NULL")),
        ("12:30:45", "in quotes"),
        ("190:20:30.15", "in quotes"),
        ("017", "write 15 if it is octal, 17 if it is not"),
        ("0o17", "write 15"),
        ("0x1F4", "write 500"),
        ("0b101", "write 5"),
        ("1_000", "1000"),
        ("1_000.5", "digits alone"),
        ("+5", "digits alone"),
        (".5", "0.5"),
        ("5.", "digits alone"),
        ("08", "digits alone"),
        ("00.5", "digits alone"),
        ("2024-01-31", "in quotes"),
        ("2001-12-14t21:59:43.10-05:00", "in quotes"),
        (".inf", "finite"),
        ("-.INF", "finite"),
        (".NaN", "finite"),
        ("<<", "write out"),
        ("=", "write out"),
        ("1e41", "at most 40"),
        ("1e99999999999999999999", "at most 40"),
        ("1" * 41, "at most 40 characters"),
        ("0x" + "f" * 50, "in decimal"),
    ],
)
def test_scalars_on_which_programs_disagree_are_refused_with_a_remedy(text: str, hint: str) -> None:
    resolved = resolve(text)
    assert isinstance(resolved, Surprise)
    assert hint in resolved.hint
    assert hint in complaint(spec_text(name=f"»{text}"))
    assert (
        complaints(spec_text(variables=f"{{v: {{type: FLOAT, unit: '{text[:20]}'}}}}", modules="", functions="")) == []
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "the file is empty (a spec begins with dg: 1)"),
        ("# nothing yet\n", "the file is empty"),
        ("»just text", "a spec must be a map of sections"),
        ("»- dg: 1", "a spec must be a map of sections"),
        (spec_text() + "»---\ndg: 1\n", "a second document begins here"),
        (spec_text() + "»dg: 1\n", "'dg' is given twice, first at 1:1"),
        (spec_text(devices="{gps: {kind: sensor, pe: nav, »kind: sensor}}"), "'kind' is given twice, first at 4:17"),
        (spec_text(devices="{gps: {kind: sensor, pe: nav, »pe: »[nope}}").replace("»[", "["), "this is not YAML"),
        (spec_text(name="»&anchor x"), "an anchor (&) is not allowed"),
        (spec_text(name="»!!str x"), "a tag (!) is not allowed"),
        (spec_text(name="»!mine x"), "a tag (!) is not allowed"),
        (spec_text(contingency="»*other"), "an alias (*) is not allowed"),
        (spec_text(contingency="{»<<: {faults: 2}}"), "'<<' is a special key of YAML 1.1"),
        (spec_text(contingency="{»on: 1}"), "some programs read 'on' as true"),
        (spec_text(contingency="{»1: 1}"), "the key '1' is not text (put it in quotes)"),
        (spec_text(contingency="{»null: 1}"), "the key 'null' is not text"),
        (spec_text(contingency="{»[a]: 1}"), "the key of an entry must be text"),
        ("»%YAML 1.1\n---\n" + spec_text(), "a YAML directive (%...) is not allowed"),
    ],
)
def test_what_is_not_plain_yaml_is_refused(text: str, sentence: str) -> None:
    if not text.replace("# nothing yet\n", ""):
        text = "»" + text
    if "not YAML" in sentence:
        (finding,) = findings(text.replace("»", ""))
        assert sentence in finding.sentence
        assert finding.place.line == 4
    else:
        assert sentence in complaint(text)


def test_a_document_may_begin_with_three_dashes() -> None:
    assert complaints("---\n" + spec_text()) == []


def test_a_refused_part_has_no_echo_elsewhere() -> None:
    """The list of buses, the worth, the initial value cannot be checked: only the refused scalar is reported."""
    said = complaints(
        spec_text(
            pes="{nav: {node_id: 92, buses: [»yes], cpu: »1_0, ram: 64KiB, flash: »*size}}",
            variables="{altitude: {type: FLOAT, versions: 3}, axes: {type: SHORT2, initial: [»017, 2]},"
            " map: {type: FLOAT, initial: {x: »off}}}",
            modules="{driver: {needs: {var: altitude, worth: [»0x3, 2, 1]}, cpu: 1, ram: 1, rate_hz: »+1}}",
        )
    )
    assert len(said) == 7


@pytest.mark.parametrize(
    ("data", "place", "sentence"),
    [
        (b"dg: 1\nname: \xff\n", Place(2, 7), "byte 0xff is not UTF-8"),
        ("dg: 1\nname: é".encode("latin-1"), Place(2, 7), "byte 0xe9 is not UTF-8"),
        ("é: ".encode() + b"\x80", Place(1, 4), "byte 0x80 is not UTF-8"),
        ("dg: 1".encode("utf-16"), Place(1, 1), "byte 0xff is not UTF-8"),
        (b"dg: 1\n\x00", Place(2, 1), "character U+0000 is not allowed"),
        (b"dg: 1\nname: a\x07b", Place(2, 8), "character U+0007 is not allowed"),
        (b"dg:\t\x1b[31m", Place(1, 5), "character U+001B is not allowed"),
    ],
)
def test_bytes_that_are_no_text_are_refused_at_their_place(data: bytes, place: Place, sentence: str) -> None:
    found = Findings("test")
    assert yaml_source.read_tree(data, found) is None
    (finding,) = found.error().findings
    assert (finding.place, finding.sentence) == (place, sentence)


MIB = 1 << 20


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a" * (4 * MIB + 1), "the file has more than 4194304 bytes"),
        ("[" * MIB, "nested deeper than 64 levels"),
        ("{a: " * (MIB // 4), "nested deeper than 64 levels"),
        ("- " * 400_000, "nested deeper than 64 levels"),
        ("? " * (MIB // 2), "nested deeper than 64 levels"),
        ("x: [" + "1," * 500_000 + "1]", "more than 500000 values"),
        ("---\n" * (MIB // 4), "a second document begins here"),
        ("'" * (MIB - 1), "this is not YAML"),
        ("\t" * MIB, "this is not YAML"),
        (":" * 400_000, "this is not YAML"),
        ("," * 400_000, "this is not YAML"),
        ("\n" * MIB, "the file is empty"),
    ],
    ids=[
        "bytes",
        "lists",
        "maps",
        "dashes",
        "keys",
        "values",
        "documents",
        "quotes",
        "tabs",
        "colons",
        "commas",
        "lines",
    ],
)
def test_hostile_files_end_in_one_sentence(text: str, sentence: str) -> None:
    (finding,) = findings(text)
    assert sentence in finding.sentence


@pytest.mark.parametrize("text", ["k: 1\n" * 400_000, "? k\n" * 1_000_000, "{" + "k: ," * 200_000 + "}"])
def test_a_file_of_repeated_keys_is_not_read_to_its_end(text: str) -> None:
    found = findings(text)
    assert len([finding for finding in found if finding.code == "DG015"]) == 100
    assert "more than 100 repeated keys" in found[-1].sentence


def test_a_file_of_more_keys_than_any_spec_has_is_not_parsed_at_all() -> None:
    (finding,) = findings("k:\n" * 1_000_000)
    assert finding.sentence == "the file has more than 500000 values"


def test_laughing_a_billion_times_is_an_anchor_that_is_not_allowed() -> None:
    laughs = "".join(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]\n" for i in range(1, 10))
    found = findings("dg: 1\nl0: &l0 [ha]\n" + laughs)
    assert {f.sentence for f in found if "gives" not in f.sentence} >= {
        "an anchor (&) is not allowed",
        "an alias (*) is not allowed",
    }


def test_a_flood_of_unknown_names_is_answered_without_searching_for_each() -> None:
    names = "".join(f"  v{i}: {{type: FLOAT}}\n" for i in range(8000))
    lists = ", ".join(f"w{i}" for i in range(20_000))
    found = findings(f"dg: 1\nbuses: {{can0: {{bitrate: 1000}}}}\nvariables:\n{names}separate: [[{lists}]]\n")
    assert len(found) == 20_000


def test_a_long_name_is_cut_in_the_message() -> None:
    assert len(complaint(spec_text(name="»" + "x" * 100_000))) < 300


def test_control_characters_in_a_name_are_escaped_in_the_message() -> None:
    said = complaint(spec_text(functions='{f: {output: »"a\\e[31mb"}}'))
    assert "no module or DEMUX is named 'a\\x1b[31mb'" in said


def test_a_ring_of_two_thousand_modules_is_refused_with_a_short_sentence() -> None:
    ring = 2000
    variables = "".join(f"  v{i}: {{type: FLOAT}}\n" for i in range(ring))
    body = "cpu: 0.1, ram: 1, rate_hz: 1"
    modules = "".join(f"  m{i}: {{needs: v{i}, gives: {{v{(i + 1) % ring}: 1}}, {body}}}\n" for i in range(ring))
    (finding,) = findings(f"dg: 1\nbuses: {{can0: {{bitrate: 1000}}}}\nvariables:\n{variables}modules:\n{modules}")
    assert "nothing can start this cycle: m0 -> v1 -> m1" in finding.sentence
    assert len(str(finding)) < 600


def test_text_that_is_no_unicode_is_refused() -> None:
    assert "is not UTF-8" in findings("name: \ud800")[0].sentence
