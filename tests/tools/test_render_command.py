"""`heronry render` as a user sees it: one symbol for each element, crossed out if dead, bold if chosen; as text."""

import json
import re
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from heronry_dg.gates import Expression, Leaf
from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main

SVG = "{http://www.w3.org/2000/svg}"

MICRO = """
dg: 1
name: micro
buses: {can0: {bitrate: 125000}}
pes:
  one: {node_id: 92, buses: [can0], cpu: 1, ram: 10KiB, flash: 10KiB}
  two: {node_id: 93, buses: [can0], cpu: 1, ram: 10KiB, flash: 10KiB}
devices:
  eye: {kind: sensor, pe: one}
  arm: {kind: actuator, pe: one}
  leg: {kind: actuator, pe: two}
variables: {sight: {type: FLOAT, versions: 2}, hint: {type: FLOAT}, move: {type: FLOAT, versions: 2}}
gates: {limb: {demux: move}}
modules:
  look: {device: eye, gives: {sight: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  guess: {gives: {sight: 2, hint: 1}, runs_on: [two], cpu: 0.1, ram: 1KiB, rate_hz: 10}
  think:
    modes:
      deep: {needs: {and: [sight@1, {or: {k: 0, of: [hint]}}]}, gives: {move: 1}, cpu: 0.2, ram: 1KiB, rate_hz: 10}
      dull: {needs: {xor: [sight@2, hint]}, gives: {move: 2}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  arm_driver: {device: arm, needs: limb, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  leg_driver: {device: leg, needs: limb, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions: {moving: {output: limb, criticality: A}}
"""


@pytest.fixture
def micro(tmp_path: Path) -> str:
    file = tmp_path / "micro.dg.yaml"
    file.write_text(MICRO)
    return str(file)


def rendered(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    code = main(["render", *arguments])
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    return out


def symbols(text: str) -> dict[str, ET.Element]:
    """Symbols of an SVG by key; each key once."""
    groups = [group for group in ET.fromstring(text).iter(f"{SVG}g") if "data-key" in group.attrib]
    assert [key for key, count in Counter(group.attrib["data-key"] for group in groups).items() if count > 1] == []
    return {group.attrib["data-key"]: group for group in groups}


def with_mark(text: str, mark: str) -> set[str]:
    return {key for key, group in symbols(text).items() if mark in group.attrib["class"].split()}


def bold_edges(text: str) -> set[tuple[str, str]]:
    paths = ET.fromstring(text).iter(f"{SVG}path")
    return {
        (path.attrib["data-from"], path.attrib["data-to"])
        for path in paths
        if path.attrib.get("class") == "edge chosen" and "data-to" in path.attrib
    }


def gates(needs: Expression | None) -> int:
    if needs is None or isinstance(needs, Leaf):
        return 0
    return 1 + sum(map(gates, needs.inputs))


def everything(spec: Spec) -> set[str]:
    named = [("module", spec.modules), ("variable", spec.variables), ("device", spec.devices), ("demux", spec.demuxes)]
    return {f"{kind}:{name}" for kind, names in named for name in names}


@pytest.mark.parametrize("name", ["elevator_and_chute", "big_blue"])
def test_a_picture_shows_everything_once(capsys: pytest.CaptureFixture[str], name: str) -> None:
    spec = load(shipped_spec_path(name))
    shown = symbols(rendered(capsys, name))
    assert {key for key in shown if not key.startswith("gate:")} == everything(spec)
    expected = sum(gates(mode.needs) for module in spec.modules.values() for mode in module.modes.values())
    assert sum(key.startswith("gate:") for key in shown) == expected
    for module in spec.modules.values():
        cells = [rect for rect in shown[f"module:{module.name}"].iter(f"{SVG}rect") if "cell" in rect.attrib["class"]]
        assert len(cells) == (len(module.modes) if len(module.modes) > 1 else 0)


@pytest.mark.parametrize("name", ["elevator_and_chute", "big_blue"])
@pytest.mark.parametrize("form", ["svg", "mermaid", "dot"])
def test_the_same_spec_gives_the_same_bytes(capsys: pytest.CaptureFixture[str], name: str, form: str) -> None:
    assert rendered(capsys, name, "--format", form) == rendered(capsys, name, "--format", form)


def test_the_picture_in_the_documentation_is_current(capsys: pytest.CaptureFixture[str]) -> None:
    remedy = "run: heronry render elevator_and_chute -o docs/elevator_and_chute.svg"
    assert Path("docs/elevator_and_chute.svg").read_text() == rendered(capsys, "elevator_and_chute"), remedy


def test_what_cannot_run_is_crossed_out(capsys: pytest.CaptureFixture[str]) -> None:
    text = rendered(capsys, "elevator_and_chute", "--down", "device:gps")
    assert with_mark(text, "dead") == {
        "device:gps",
        "module:gps_driver",
        "variable:gps_altitude",
        "gate:high_quality_altitude/fused/",
        "module:high_quality_altitude",
    }
    crossed = {key for key, group in symbols(text).items() if group.find(f"{SVG}path[@class='crossed']") is not None}
    assert crossed == with_mark(text, "dead")


def test_one_mode_may_be_dead_where_its_module_lives(micro: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = rendered(capsys, micro, "--down", "device:eye")
    think = symbols(text)["module:think"]
    assert "dead" not in think.attrib["class"]
    assert [rect.attrib["class"] for rect in think.iter(f"{SVG}rect")] == ["body", "cell dead", "cell"]


def test_what_a_plan_chose_is_bold(micro: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["plan", micro, "--json"]) == 0
    plan = tmp_path / "plan.json"
    plan.write_text(capsys.readouterr().out)
    running = set(json.loads(plan.read_text())["modules"])
    text = rendered(capsys, micro, "--plan", str(plan))
    assert {key for key in with_mark(text, "chosen") if key.startswith("module:")} == {f"module:{m}" for m in running}
    think = symbols(text)["module:think"]
    assert [rect.attrib["class"] for rect in think.iter(f"{SVG}rect")] == ["body", "cell chosen", "cell"]
    assert {
        ("variable:sight", "gate:think/deep/"),
        ("gate:think/deep/", "module:think"),
        ("demux:limb", "module:arm_driver"),
        ("module:arm_driver", "device:arm"),
    } <= bold_edges(text)
    assert ("demux:limb", "module:leg_driver") not in bold_edges(text)
    assert "gate:think/dull/" not in with_mark(text, "chosen")


def test_what_is_down_in_a_plan_is_crossed_out_unless_the_command_line_says_otherwise(
    micro: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["plan", micro, "--json", "--down", "device:arm"]) == 0
    plan = tmp_path / "plan.json"
    plan.write_text(capsys.readouterr().out)
    assert "device:arm" in with_mark(rendered(capsys, micro, "--plan", str(plan)), "dead")
    other = rendered(capsys, micro, "--plan", str(plan), "--down", "device:eye")
    assert "device:eye" in with_mark(other, "dead")
    assert "device:arm" not in with_mark(other, "dead")


def test_one_function_shows_what_contributes_to_it(capsys: pytest.CaptureFixture[str]) -> None:
    shown = symbols(rendered(capsys, "elevator_and_chute", "--function", "elevator"))
    assert set(shown) == {
        "module:state_estimator",
        "variable:state_info",
        "module:elevator_control",
        "variable:elevator_demand",
        "demux:elevator_out",
        "module:servo_driver_1",
        "module:servo_driver_2",
        "device:elevator_servo_1",
        "device:elevator_servo_2",
    }


MERMAID = r"""flowchart LR
  n0(("sight<br/>m = 2"))
  n1(("hint<br/>m = 1"))
  n2(("move<br/>m = 2"))
  n3{"DEMUX<br/>limb<br/>serves moving"}
  n4[\"eye<br/>on one"/]:::dead
  n5[/"arm<br/>on one"\]
  n6[/"leg<br/>on two"\]
  n7["look"]:::dead
  n8["guess"]
  n9["think<br/><s>V1 deep</s><br/>V2 dull"]
  n10{{"AND"}}:::dead
  n11{{"0/1"}}
  n12{{"XOR"}}
  n13["arm_driver"]
  n14["leg_driver"]
  n2 --> n3
  n7 -.->|"1"| n0
  n4 -.-> n7
  n8 -->|"2"| n0
  n8 --> n1
  n0 -.->|"@1"| n10
  n1 -.-> n11
  n11 -.-> n10
  n10 -.->|"V1"| n9
  n9 -.->|"V1; 1"| n2
  n0 -->|"@2"| n12
  n1 --> n12
  n12 -->|"V2"| n9
  n9 -->|"V2; 2"| n2
  n3 --> n13
  n13 --> n5
  n3 --> n14
  n14 --> n6
  classDef dead stroke-dasharray:4,color:#999,stroke:#999,text-decoration:line-through
  classDef chosen stroke-width:3px
"""


def test_mermaid(micro: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert rendered(capsys, micro, "--format", "mermaid", "--down", "device:eye") == MERMAID


DOT = r"""digraph "micro" {
  rankdir=LR;
  node [fontname="sans-serif", fontsize=10];
  edge [fontname="sans-serif", fontsize=9];
"""


def test_dot(micro: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = rendered(capsys, micro, "--format", "dot")
    assert text.startswith(DOT)
    lines = text.splitlines()
    assert '  "variable:sight" [shape=circle, label="sight\\nm = 2"];' in lines
    assert '  "demux:limb" [shape=trapezium, orientation=90, label="DEMUX\\nlimb\\nserves moving"];' in lines
    assert '  "module:think" [shape=record, label="think|<v1> V1 deep|<v2> V2 dull"];' in lines
    assert '  "variable:sight" -> "gate:think/deep/" [label="@1"];' in lines
    assert '  "gate:think/dull/" -> "module:think":v2;' in lines
    assert '  "module:think":v1 -> "variable:move" [label="1"];' in lines
    assert lines[-1] == "}"
    assert len(re.findall(r"^  \"[^\"]+\" \[", text, re.MULTILINE)) == 15


def test_a_file_is_written_where_it_is_wanted(micro: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert rendered(capsys, micro, "-o", str(tmp_path / "graph.svg")) == ""
    assert (tmp_path / "graph.svg").read_text() == rendered(capsys, micro)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--function", "flying"), "micro has no function 'flying'; it has moving"),
        (("--down", "device:ear"), "'ear'"),
        (("--plan", "missing.json"), "missing.json: No such file or directory"),
    ],
)
def test_a_mistake_gets_one_sentence(
    micro: str, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], sentence: str
) -> None:
    assert main(["render", micro, *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert sentence in err
    assert err.count("\n") == 1


def test_a_demux_over_paths_names_its_ends(capsys: pytest.CaptureFixture[str]) -> None:
    text = rendered(capsys, "dg_specs/examples/demux_paths.dg.yaml", "--format", "mermaid")
    assert "to limited_servo_1, limited_servo_2, limited_servo_3" in text
