"""The place of a finding is where the mistake must be fixed, and not where the parser noticed it."""

import pytest

from dg.marked_spec import complaints, findings, spec_text
from heronry_dg.findings import Place


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("devices:\n  gps: »{kind: sensor, pe: nav\n  imu: {kind: sensor, pe: nav}\n", "the { here is not closed"),
        ("separate: »[[a, b]\nname: x\n", "the [ here is not closed"),
        ('name: »"x\ndg: 1\n', 'the " here is not closed'),
        ("»dg 1\nbuses: {can0: {bitrate: 1}}\n", "there is no key on this line"),
        ("»dg:1\nbuses: {can0: {bitrate: 1}}\n", "there is no key on this line"),
        ("devices:\n      »gps: {kind: sensor}\n  imu: {}\n  lamp: {}\n", "the line is indented unlike line 3"),
        (" »dg: 1\nname: x\nbuses: {}\n", "the line is indented unlike line 2"),
        ("dg: 1\n  »buses: {}\n", "mapping values are not allowed"),
        ("dg: 1\n»\tname: x\n", "found a tab character"),
        ("devices:\n  gps: {}\n»\timu: {}\n", "found a tab character"),
        ("dg: 1\nname: »`x`\n", "no value begins with `"),
        ("dg: 1\nname: [x]»]\n", "did not find expected"),
        ("dg: 1\n»name\n", "':' is missing between here and"),
    ],
)  # fmt: skip
def test_text_that_is_no_yaml_is_reported_where_it_went_wrong(text: str, sentence: str) -> None:
    (finding,) = findings(text.replace("»", ""))
    line = next(number for number, line in enumerate(text.split("\n"), 1) if "»" in line)
    assert finding.place.line == line
    assert finding.code == "DG005"
    assert f"this is not YAML: {sentence}" in finding.sentence


@pytest.mark.parametrize("line_break", ["\r", "\r\n", "\x85", "\u2028"])
def test_places_are_those_of_yaml_whatever_ends_a_line(line_break: str) -> None:
    text = "dg: 1\nname: x\ndevices:\n      gps: {kind: sensor}\n  imu: {}\n  lamp: {}\n".replace("\n", line_break)
    assert [finding.place for finding in findings(text)] == [Place(4, 7)]
    assert [finding.place for finding in findings(f"dg: 1{line_break}name: \x07")] == [Place(2, 7)]


def test_a_name_misspelt_where_it_is_declared_is_one_finding_there() -> None:
    body = "cpu: 0.1, ram: 1KiB, rate_hz: 1"
    modules = (
        f"{{a: {{gives: {{altitude: 1}}, {body}}}, b: {{needs: altitude, {body}}}, c: {{needs: 'altitude@2', {body}}}}}"
    )
    said = complaints(spec_text(variables="{»altitde: {type: FLOAT}}", modules=modules, functions="{}", devices="{}"))
    (only,) = said
    assert only.startswith("nothing uses 'altitde', and 'altitude', which does not exist, is used 3 times (rename")


def test_a_name_that_is_used_once_may_be_misspelt_there() -> None:
    said = complaints(
        spec_text(
            devices="{gsp: {kind: sensor, pe: nav}}", modules="{driver: {device: »gps, cpu: 0.1, ram: 1, rate_hz: 1}}"
        )
    )
    assert said == ["no device is named 'gps' (did you mean 'gsp'?)"]


def test_a_name_that_is_used_twice_and_declared_nowhere_is_missing_from_its_section() -> None:
    body = "cpu: 0.1, ram: 1KiB, rate_hz: 1"
    modules = f"{{driver: {{device: gps, gives: {{wind: 1}}, {body}}}, b: {{needs: wind, {body}}}}}"
    text = spec_text(modules=modules).replace("variables:", "»variables:")
    (said,) = complaints(text)
    assert said == "'variables' has no 'wind', which is used 2 times (declare it here, or fix line 6)"


def test_two_names_that_are_merely_alike_are_not_one_misspelt() -> None:
    body = "cpu: 0.1, ram: 1KiB, rate_hz: 1"
    modules = (
        f"{{driver: {{device: gps, gives: {{gps_altitude: 1, altitude: 1}}, {body}}},\n"
        f" b: {{needs: {{and: [gps_altitude, altitude]}}, {body}}}}}"
    )
    text = spec_text(variables="{altitude: {type: FLOAT}}", modules=modules).replace("variables:", "»variables:")
    (said,) = complaints(text)
    assert said.startswith("'variables' has no 'gps_altitude', which is used 2 times (declare it here, or fix lines")
    assert said.endswith("lines 6 and 7: did you mean 'altitude'?)")


def test_of_a_pair_used_once_the_one_whose_words_are_known_is_right() -> None:
    body = "cpu: 0.1, ram: 1KiB, rate_hz: 1"
    said = complaints(
        spec_text(
            devices="{»gsp: {kind: sensor, pe: nav}}",
            variables="{gps_altitude: {type: FLOAT}}",
            modules=f"{{driver: {{device: gps, gives: {{gps_altitude: 1}}, {body}}}}}",
        )
    )
    assert said == [
        "nothing uses 'gsp', and 'gps', which does not exist, is used once (rename it to gps, or fix line 6)"
    ]


def test_a_branch_whose_needs_are_misspelt_is_not_missed_by_its_demux() -> None:
    body = "cpu: 0.1, ram: 1KiB, rate_hz: 1"
    (said,) = complaints(
        spec_text(
            gates="{out: {demux: altitude}}",
            modules=f"{{driver: {{device: gps, gives: {{altitude: 1}}, {body}}}, a: {{needs: out, {body}}}, "
            f"b: {{»neds: out, {body}}}}}",
        )
    )
    assert said == "module 'b' has no field 'neds' (did you mean 'needs'?)"


def test_a_declared_name_that_is_used_is_not_to_blame() -> None:
    body = "cpu: 0.1, ram: 1KiB, rate_hz: 1"
    modules = (
        f"{{a: {{gives: {{altitde: 1}}, {body}}}, b: {{needs: »altitude, {body}}}, c: {{needs: »altitude, {body}}}}}"
    )
    assert (
        len(complaints(spec_text(variables="{altitde: {type: FLOAT}}", modules=modules, functions="{}", devices="{}")))
        == 2
    )
