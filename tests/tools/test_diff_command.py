"""`heronry diff` as a reviewer sees it: what changed, and what follows, phase by phase."""

import json
import os
import random
import re
import subprocess
import sys
from io import BytesIO, TextIOWrapper
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.loader import load
from heronry_dg.model import Function, Spec
from heronry_dg.plan import Plan
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, elements
from heronry_manager.planner.exact import plan
from heronry_tools.analysis.diff.consequences import Consequences
from heronry_tools.analysis.diff.elements import element_changes
from heronry_tools.cli import main
from planner.random_specs import random_spec
from thoroughness import part_of

ELEVATOR_AND_CHUTE = shipped_spec_path("elevator_and_chute").read_text()


def changed(tmp_path: Path, *replacements: tuple[str, str]) -> str:
    """Write elevator_and_chute with some texts replaced, each of which stands in it once."""
    text = ELEVATOR_AND_CHUTE
    for before, after in replacements:
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    file = tmp_path / "changed.dg.yaml"
    file.write_text(text)
    return str(file)


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    code = main(["diff", *arguments])
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    return out


THIRD_SERVO = (
    (
        "  chute_solenoid: {",
        "  elevator_servo_3: {kind: actuator, pe: control_pe}\n  chute_solenoid: {",
    ),
    (
        "  angle_driver: {",
        (
            "  servo_driver_3: {image: servo_driver_1, needs: elevator_out, device: elevator_servo_3, cpu: 0.03,"
            " ram: 1KiB, flash: 2KiB, rate_hz: 40}\n  angle_driver: {"
        ),
    ),
)


def test_a_servo_on_another_pe_ends_a_single_point_of_failure(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    title, digest, *rest = said(capsys, "elevator_and_chute", changed(tmp_path, *THIRD_SERVO)).splitlines()
    assert title == "elevator_and_chute: 2 added, 1 changed"
    assert " -> " in digest
    assert rest == [
        "",
        "~ demux:elevator_out",
        "    branches: [servo_driver_1, servo_driver_2] -> [servo_driver_1, servo_driver_2, servo_driver_3]",
        "+ device:elevator_servo_3  kind actuator; pe control_pe",
        (
            "+ module:servo_driver_3  image servo_driver_1; device elevator_servo_3; flash 2KiB; restarts 2; "
            "silent told; needs elevator_out; cpu 0.03; ram 1KiB; rate_hz 40"
        ),
        "",
        "consequences:",
        (
            "  elevator (A) no longer depends on pe:tail_pe; still on module:state_estimator, module:elevator_control, "
            "bus:can0"
        ),
        "",
        "changed in flight: 11 of 11 modules go on untouched",
        "",
        "check no longer says:",
        "  DG401 warning, line 8: the loss of pe 'tail_pe' alone costs 'elevator' (A)",
        "  DG410 warning, line 28: all branches of DEMUX 'elevator_out' are lost with pe 'tail_pe'",
    ]


def test_what_a_change_would_do_in_flight(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    new = changed(
        tmp_path,
        ("  angle_driver: {", "  angle_reader: {image: angle_driver, "),
        ("gives: {servo_failure: 1}, cpu: 0.03", "gives: {servo_failure: 1}, cpu: 0.04"),
    )
    out = said(capsys, "elevator_and_chute", new)
    assert "changed in flight: 8 of 12 modules go on untouched\n" in out
    assert "  angle_reader starts on tail_pe\n  angle_driver stops on tail_pe\n" in out
    assert "  state_estimator moves from tail_pe to control_pe\n" in out  # servo_monitor leaves it no room
    assert "  servo_monitor changes (cpu)\n" in out
    assert "  identifier 308 passes from angle_driver.elevator_angle to angle_reader.elevator_angle\n" in out
    in_flight = json.loads(said(capsys, "elevator_and_chute", new, "--json"))["in_flight"]
    assert [one["module"] for one in in_flight["modules"]["changed"]] == ["servo_monitor"]
    assert in_flight["modules"]["stopped"][0]["before"] == {"pe": "tail_pe", "mode": "only"}
    assert in_flight["hardware"] == {"joins": [], "leaves": [], "changes": []}
    (passing,) = in_flight["identifiers"]
    assert (passing["identifier"], passing["is_driven"]) == (308, True)


def test_the_way_back_makes_it_one_again(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = said(capsys, changed(tmp_path, *THIRD_SERVO), "elevator_and_chute")
    assert "- device:elevator_servo_3  kind actuator; pe control_pe" in out
    assert "  elevator (A) now depends on pe:tail_pe" in out


def test_the_same_change_for_a_program(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = said(capsys, "elevator_and_chute", changed(tmp_path, *THIRD_SERVO), "--format", "json")
    document = json.loads(out)
    assert [(one["element"], one["change"]) for one in document["elements"]] == [
        ("demux:elevator_out", "changed"),
        ("device:elevator_servo_3", "added"),
        ("module:servo_driver_3", "added"),
    ]
    (phase,) = document["phases"]
    assert phase == {
        "phase": None,
        "against": None,
        "functions": {},
        "single_points_of_failure": {
            "elevator": {
                "gone": ["pe:tail_pe"],
                "new": [],
                "left": ["module:state_estimator", "module:elevator_control", "bus:can0"],
            }
        },
        "bus_bits_per_s": {},
        "cpu_millis": phase["cpu_millis"],
    }
    assert phase["cpu_millis"]["old"] == phase["cpu_millis"]["new"]


def test_the_same_change_as_a_picture(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = said(capsys, "elevator_and_chute", changed(tmp_path, *THIRD_SERVO), "--format", "mermaid")
    nodes = dict(re.findall(r'^  (n\d+)\W+"(?:DEMUX<br/>)?(\w+)', out, re.MULTILINE))
    assert sorted(nodes.values()) == [
        "elevator_demand",
        "elevator_out",
        "elevator_servo_3",
        "servo_driver_1",
        "servo_driver_2",
        "servo_driver_3",
    ]
    arrows = {(nodes[a], arrow, nodes[b]) for a, arrow, b in re.findall(r"^  (n\d+) (\S+) (n\d+)$", out, re.MULTILINE)}
    assert arrows == {
        ("elevator_demand", "-->", "elevator_out"),
        ("elevator_out", "-->", "servo_driver_1"),
        ("elevator_out", "-->", "servo_driver_2"),
        ("elevator_out", "==>", "servo_driver_3"),
        ("servo_driver_3", "==>", "elevator_servo_3"),
    }
    marked = {nodes[node]: mark for node, mark in re.findall(r"^  (n\d+).*:::(\w+)$", out, re.MULTILINE)}
    assert marked == {"elevator_out": "changed", "elevator_servo_3": "added", "servo_driver_3": "added"}


def test_nothing_changed_says_so(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    same = changed(tmp_path, ("dg: 1\n", "dg: 1  # a comment\n"))
    title, digest = said(capsys, "elevator_and_chute", same).splitlines()
    assert title == "elevator_and_chute: nothing changed"
    assert digest.endswith(" as before: the tables, contingencies and journal of the old spec are taken")
    assert json.loads(said(capsys, "elevator_and_chute", same, "--json"))["same_digest"] is True
    assert "no change in the graph" in said(capsys, "elevator_and_chute", same, "--format", "mermaid")


def test_a_function_that_is_lost_and_what_that_saves(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    dear = changed(tmp_path, ("device: chute_solenoid, cpu: 0.01", "device: chute_solenoid, cpu: 0.51"))
    lines = said(capsys, "elevator_and_chute", dear).splitlines()
    assert "    cpu: 0.01 -> 0.51" in lines
    assert "  parachute (B): chute_driver -> NOT SERVED" in lines
    assert any(re.fullmatch(r"  bus can0: \d+ bit/s \([\d.]+%\) -> \d+ bit/s \([\d.]+%\)", line) for line in lines)
    assert any(re.fullmatch(r"  CPU: [\d.]+ -> [\d.]+", line) for line in lines)
    assert not any("parachute" in line and "hangs" in line for line in lines)


@pytest.mark.parametrize(
    ("before", "after", "element", "field", "old", "new"),
    [
        ("bitrate: 1000000", "bitrate: 500000", "bus:can0", "bitrate", "1000000", "500000"),
        ("ram: 16KiB, flash: 32KiB", "ram: 1MiB, flash: 32KiB", "pe:tail_pe", "ram", "16KiB", "1MiB"),
        ("identifier: 326", "identifier: 326, deadline_ms: 12.5", "variable:absolute_pressure", "deadline_ms", None,
         "12.5"),
        ("gives: {altitude: 2}", "gives: {altitude: 1}", "module:high_quality_altitude", "modes.gps_only.gives",
         "altitude: 2", "altitude: 1"),
        ('"altitude@<=2", "altitude@3"', 'altitude@1, "altitude@3"', "module:chute_logic", "needs",
         "0 of (xor(altitude@<=2, altitude@3), release_command)",
         "0 of (xor(altitude@1, altitude@3), release_command)"),
        ('["altitude@<=2",', '[{var: "altitude@<=2", worth: [9, 1]},', "module:chute_logic", "worth",
         "altitude [3, 2]", "altitude [9, 1]"),
        ("criticality: B, priority: 80", "criticality: B, priority: 81", "function:parachute", "priority", "80", "81"),
        ("faults: 2", "faults: 1", "contingency", "faults", "2", "1"),
        ("bitrate: 1000000", "bitrate: 1000000, foreign: [{range: [1800, 1815], bytes: 8, period_ms: 12.5}]",
         "bus:can0", "foreign", None, "[{range: [1800, 1815], extended: false, bytes: 8, period_ms: 12.5}]"),
        ("contingency:", "together: [[gps_driver, pressure_driver]]\ncontingency:", "spec", "together", None,
         "[[gps_driver, pressure_driver]]"),
    ],
)  # fmt: skip
def test_a_field_is_reported_with_the_key_of_the_spec(  # noqa: PLR0917 - a row of the table above
    tmp_path: Path, before: str, after: str, element: str, field: str, old: str | None, new: str | None
) -> None:
    changes = element_changes(load(shipped_spec_path("elevator_and_chute")), load(changed(tmp_path, (before, after))))
    assert [(one.element, change.field, change.old, change.new) for one in changes for change in one.fields] == [
        (element, field, old, new)
    ]


def planned_for_each(spec: Spec, healthy: Plan) -> dict[str, tuple[str, ...]]:
    """Single points of failure of what a healthy system serves, with a plan for every element there is."""
    phase = healthy.now.phase
    plans = {one: plan(spec, Situation(frozenset({one}), phase=phase)) for one in elements(spec)}
    return {
        function.name: tuple(one for one, found in plans.items() if not found.functions[function.name].served)
        for function in wanted(spec, phase)
        if healthy.functions[function.name].served
    }


def wanted(spec: Spec, phase: str | None) -> list[Function]:
    return [f for f in spec.functions.values() if f.criticality_in(phase) != "E" and f.priority_in(phase) > 0]


def test_points_of_failure_are_those_that_a_plan_for_every_element_finds() -> None:
    spec = load(shipped_spec_path("elevator_and_chute"))
    expected = planned_for_each(spec, plan(spec, Situation()))
    assert expected["elevator"] == ("pe:tail_pe", "module:state_estimator", "module:elevator_control", "bus:can0")
    assert Consequences().of(spec)[None].hangs_on == expected


@settings(max_examples=part_of(50))
@given(st.randoms(use_true_random=False))
def test_so_they_are_in_random_specs(rng: random.Random) -> None:
    spec = random_spec(rng, modules=5)
    found = Consequences().of(spec)
    for phase in found:
        healthy = plan(spec, Situation(phase=phase))
        if all(healthy.functions[function.name].served for function in wanted(spec, phase)):  # else ties are possible
            assert found[phase].hangs_on == planned_for_each(spec, healthy)


PHASES = ("contingency:", "phases: {climb: {}, glide: {}}\ncontingency:")
NO_CHUTE_IN_GLIDE = ("criticality: B, priority: 80", "criticality: B, priority: {default: 80, glide: 0}")


def test_a_new_phase_is_held_against_what_there_was(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    lines = said(capsys, "elevator_and_chute", changed(tmp_path, PHASES, NO_CHUTE_IN_GLIDE)).splitlines()
    assert "    phases: (none) -> [climb, glide]" in lines
    assert "+ phase:glide" in lines
    assert "consequences in phase climb, against no phases before: none" in lines
    glide = lines[lines.index("consequences in phase glide, against no phases before:") :]
    assert "  parachute (B): chute_driver -> not wanted" in glide
    assert not any("NOT SERVED" in line for line in lines)


def test_a_phase_that_is_gone_follows_from_nothing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    lines = said(capsys, changed(tmp_path, PHASES, NO_CHUTE_IN_GLIDE), "elevator_and_chute").splitlines()
    assert "- phase:glide" in lines
    assert "consequences, against phase climb before: none" in lines


@pytest.mark.parametrize("arguments", [("elevator_and_chute", "missing.dg.yaml"), ("big_blu", "big_blue")])
def test_bad_input_gets_one_sentence(capsys: pytest.CaptureFixture[str], arguments: tuple[str, str]) -> None:
    assert main(["diff", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("heronry: ")
    assert "Traceback" not in err


def test_the_output_in_the_documentation_is_current(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    servo = "elevator_servo_2: {kind: actuator, pe: "
    moved = changed(tmp_path, (f"{servo}tail_pe", f"{servo}sensor_pe"))
    assert f"```text\n{said(capsys, 'elevator_and_chute', moved)}```\n" in Path("docs/render.md").read_text()


FUSES = "absolute_pressure]}, gives: {altitude: 1}, cpu: "
TOO_BIG = (f"{FUSES}0.20", f"{FUSES}0.60")


def test_a_mode_that_has_become_too_big_for_every_pe_is_said(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    lines = said(capsys, "elevator_and_chute", changed(tmp_path, TOO_BIG)).splitlines()
    assert "    modes.fused.cpu: 0.2 -> 0.6" in lines
    found = lines[lines.index("check says newly:") + 1 :]
    assert found[0].startswith("  DG302 error, line 35: mode 'fused' of module 'high_quality_altitude' fits no PE: ")


def test_the_findings_of_check_are_in_json_as_check_writes_them(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = changed(tmp_path, TOO_BIG)
    change = json.loads(said(capsys, "elevator_and_chute", file, "--json"))["check"]
    assert change["gone"] == []
    assert main(["check", file, "--json"]) == 1
    every = json.loads(capsys.readouterr().out)
    assert [one["code"] for one in change["new"]][:1] == ["DG302"]
    assert all(one in every for one in change["new"])


def test_a_comment_changes_what_check_says_and_nothing_else(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    solenoid = "  chute_solenoid: {"
    file = changed(tmp_path, (solenoid, f"  # dg: ignore[DG401] one is enough\n{solenoid}"))
    title, digest, *rest = said(capsys, "elevator_and_chute", file).splitlines()
    assert title == "elevator_and_chute: nothing changed"
    assert "as before" in digest
    assert rest == [
        "",
        "check no longer says:",
        "  DG401 warning, line 15: the loss of device 'chute_solenoid' alone costs 'parachute' (B)",
    ]


def test_a_failure_rate_changes_no_digest_and_what_flies_does(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rate = changed(tmp_path, ("kind: sensor, pe: tail_pe}", "kind: sensor, pe: tail_pe, rate_per_h: 0.5}"))
    assert "\ndigest " in said(capsys, "elevator_and_chute", rate)
    assert " as before: the tables" in said(capsys, "elevator_and_chute", rate)
    cpu = changed(tmp_path, ("cpu: 0.20, ram: 8KiB", "cpu: 0.21, ram: 8KiB"))
    assert ": PEs need new tables, " in said(capsys, "elevator_and_chute", cpu)


def test_elements_that_only_changed_places_are_a_difference(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    lines = ELEVATOR_AND_CHUTE.splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if line.startswith("  gps: "))
    swapped = changed(tmp_path, ("".join(lines[at : at + 2]), "".join(reversed(lines[at : at + 2]))))
    title, digest = said(capsys, "elevator_and_chute", swapped).splitlines()[:2]
    assert title == "elevator_and_chute: only the order of elements changed"
    assert " -> " in digest
    assert main(["diff", "elevator_and_chute", swapped, "--exit-code"]) == 1


def test_findings_that_stay_are_counted(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = said(capsys, "elevator_and_chute", changed(tmp_path, ("cpu: 0.20, ram: 8KiB", "cpu: 0.21, ram: 8KiB")))
    assert out.endswith("\n\ncheck: as before, 15 findings\n")


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with one version committed, a second one staged, and a third one in the folder."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "specs" / "wing.dg.yaml"
    file.parent.mkdir()
    author = ("-c", "user.name=author", "-c", "user.email=author@localhost")
    file.write_text(ELEVATOR_AND_CHUTE)
    for words in (["init", "-q"], ["add", "."], [*author, "commit", "-qm", "first"]):
        subprocess.run(["git", *words], check=True)
    file.write_text(ELEVATOR_AND_CHUTE.replace("priority: 80", "priority: 81"))
    subprocess.run(["git", "add", "."], check=True)
    file.write_text(ELEVATOR_AND_CHUTE.replace("priority: 80", "priority: 82"))
    return file


@pytest.mark.parametrize(
    ("arguments", "priority"),
    [
        (("HEAD:specs/wing.dg.yaml", "specs/wing.dg.yaml"), "    priority: 80 -> 82\n"),
        (("HEAD:specs/wing.dg.yaml", ":specs/wing.dg.yaml"), "    priority: 80 -> 81\n"),
        ((":specs/wing.dg.yaml", "-"), "    priority: 81 -> 82\n"),
        (("elevator_and_chute", "HEAD:./specs/wing.dg.yaml"), "elevator_and_chute: nothing changed\n"),
    ],
)
def test_a_revision_what_is_staged_and_standard_input_can_be_compared(
    repository: Path,
    arguments: tuple[str, str],
    priority: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stdin", TextIOWrapper(BytesIO(repository.read_bytes())))
    assert priority in said(capsys, *arguments)


def test_a_pipe_can_be_compared(capsys: pytest.CaptureFixture[str]) -> None:
    """As a shell's <(...) gives one."""
    reading, writing = os.pipe()
    os.write(writing, ELEVATOR_AND_CHUTE.replace("priority: 80", "priority: 82").encode())
    os.close(writing)
    assert "    priority: 80 -> 82\n" in said(capsys, "elevator_and_chute", f"/dev/fd/{reading}")
    os.close(reading)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("HEAD:nosuch.dg.yaml", "elevator_and_chute", "heronry: HEAD:nosuch.dg.yaml: git says: path "),
        ("nosuch:specs/wing.dg.yaml", "elevator_and_chute", "heronry: nosuch:specs/wing.dg.yaml: "),
        ("-", "-", "heronry: only one of OLD and NEW can be standard input; name a file for the other"),
    ],
)
@pytest.mark.usefixtures("repository")
def test_what_git_does_not_have_is_one_sentence(
    capsys: pytest.CaptureFixture[str], old: str, new: str, sentence: str
) -> None:
    assert main(["diff", old, new]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith(sentence)


def test_without_git_a_revision_is_one_sentence(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    assert main(["diff", "HEAD:wing.dg.yaml", "big_blue"]) == 2
    assert "REV:PATH needs git, which is not installed" in capsys.readouterr().err


def test_a_spec_that_is_read_again_must_be_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("sim", "exhaust", "demo"):
        assert main([command, "-"]) == 2
        assert "-: this command reads the spec more than once; save it as a *.dg.yaml file" in capsys.readouterr().err


FUSED = "fused:    {needs: {and: [gps_altitude, absolute_pressure]}, gives: {altitude: 1}, cpu: 0.20"
GPS_ONLY = "      gps_only: {needs: gps_altitude, gives: {altitude: 2}, cpu: 0.10, ram: 4KiB, rate_hz: 10}\n"


def removed_and_added(out: str) -> tuple[list[str], list[str]]:
    """What is said on arrows that are gone, and on new ones."""
    return re.findall(r'-\.->\|"(.*)"\|', out), re.findall(r'==>\|"(.*)"\|', out)


def test_modes_that_become_one_are_a_picture(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    one = changed(
        tmp_path,
        (GPS_ONLY, ""),
        ("    flash: 12KiB\n    modes:\n      fused:    {needs", "    {flash: 12KiB, needs"),
    )
    out = said(capsys, "elevator_and_chute", one, "--format", "mermaid")
    assert removed_and_added(out) == (["V1", "V1; 1", "V2", "V2; 2"], ["1"])
    out = said(capsys, one, "elevator_and_chute", "--format", "mermaid")
    assert removed_and_added(out) == (["1"], ["V1", "V1; 1", "V2", "V2; 2"])


def test_a_mode_in_the_place_of_another_one_is_another_arrow(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    renamed = changed(tmp_path, (FUSED, FUSED.replace("fused:", "mixed:")))
    out = said(capsys, "elevator_and_chute", renamed, "--format", "mermaid")
    assert removed_and_added(out) == (["V1", "V1; 1"], ["V1", "V1; 1"])


def test_the_exit_code_tells_a_change_to_ci_only_when_it_is_asked_to(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = changed(tmp_path, ("priority: 20", "priority: 21"))
    for form in ("text", "json", "mermaid"):
        for words, code in (([file], 0), ([file, "--exit-code"], 1), (["elevator_and_chute", "--exit-code"], 0)):
            assert main(["diff", "elevator_and_chute", *words, "--format", form]) == code
    capsys.readouterr()
