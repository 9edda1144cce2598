"""Sound specs as the loader reads them, defaults where fields are left out, and mutilated files, which are refused."""

import copy
import re
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dg.marked_spec import RUNS, findings, spec_text
from heronry_dg import yaml_source
from heronry_dg.draft import MOST_FINDINGS
from heronry_dg.findings import Findings, SpecError
from heronry_dg.gates import And, Leaf, Or, Xor
from heronry_dg.loader import load, loads
from heronry_dg.model import (
    Bus,
    Checkpoint,
    Contingency,
    Demux,
    Device,
    Function,
    Manager,
    Mode,
    Module,
    Pe,
    Spec,
    Variable,
    When,
)
from heronry_dg.schema import spec_form
from heronry_dg.shipped import UnknownSpecError, shipped_spec_names, shipped_spec_path
from thoroughness import part_of

FIGURE_3 = shipped_spec_path("elevator_and_chute")
FIGURE_3_TEXT = FIGURE_3.read_text()
ELEVATOR = Leaf("elevator_demand", 1, 1, (0,), demux="elevator_out")
DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
FIGURE_3_TREE = yaml.safe_load(FIGURE_3_TEXT)


@pytest.mark.parametrize("name", ["big_blue", "elevator_and_chute"])
def test_shipped_specs_are_sound(name: str) -> None:
    assert name in shipped_spec_names()
    assert load(shipped_spec_path(name)).name == name


def test_a_spec_that_is_not_shipped() -> None:
    with pytest.raises(UnknownSpecError, match=r"no spec named '\.\./x' is shipped; the shipped specs are big_blue"):
        shipped_spec_path("../x")


def test_figure_3_of_the_paper() -> None:
    spec = load(FIGURE_3)
    assert spec.buses == {"can0": Bus("can0", 1_000_000)}
    assert spec.manager == Manager("can0", "keep")
    assert spec.pes["tail_pe"] == Pe("tail_pe", 94, ("can0",), 300, 16_384, 32_768)
    assert spec.devices["elevator_servo_2"] == Device("elevator_servo_2", "actuator", "tail_pe")
    assert spec.variables["altitude"] == Variable("altitude", "FLOAT", "m", 3, 322)
    branches = ("servo_driver_1", "servo_driver_2")
    assert spec.demuxes == {"elevator_out": Demux("elevator_out", "elevator_demand", branches, ELEVATOR)}
    assert list(spec.modules)[:3] == ["gps_driver", "pressure_driver", "high_quality_altitude"]
    both = And((Leaf("gps_altitude", 1, 1, (0,)), Leaf("absolute_pressure", 1, 1, (0,))))
    assert spec.modules["high_quality_altitude"] == Module(
        name="high_quality_altitude",
        image="high_quality_altitude",
        flash=12_288,
        modes={
            "fused": Mode("fused", both, {"altitude": 1}, 200, 8_192, 10_000),
            "gps_only": Mode("gps_only", Leaf("gps_altitude", 1, 1, (0,)), {"altitude": 2}, 100, 4_096, 10_000),
        },
    )
    altitudes = Xor((Leaf("altitude", 1, 2, (3, 2)), Leaf("altitude", 3, 3, (1,))))
    needs = spec.modules["chute_logic"].modes["only"].needs
    assert needs == Or(0, (altitudes, Leaf("release_command", 1, 1, (1,))))
    branches = ("servo_driver_1", "servo_driver_2")
    assert spec.functions["elevator"] == Function("elevator", "elevator_out", branches, {None: "A"}, {None: 100})
    assert spec.contingency == Contingency(2)
    assert spec.phases == {}


def test_what_counts_where_a_field_is_left_out() -> None:
    spec = loads("buses: {a: {bitrate: 125000, kind: wireless}, b: {bitrate: 250000}}\ndg: 1\n", "my-wing.dg.yaml")
    assert spec == Spec(
        name="my_wing",
        digest=spec.digest,
        buses={"a": Bus("a", 125_000, kind="wireless"), "b": Bus("b", 250_000)},
        manager=Manager("b"),
        pes={},
        devices={},
        variables={},
        demuxes={},
        shorthands={},
        modules={},
        functions={},
    )


def test_every_field_says_what_it_says() -> None:
    text = f"""
dg: 1
name: whole
buses:
  can0: {{bitrate: 500000, max_load: 0.75, reserve: 0.05, channels: 2, heartbeat_ms: 12.5, misses: 4, rate_per_h: 1e-5}}
  air: {{bitrate: 112500, kind: wireless}}
manager: {{bus: can0, without_manager: safe_mode}}
pes:
  nav:
    {{node_id: 125, buses: [can0, air], cpu: 1.25, ram: 1MiB, flash: 2MiB,
     features: [fpu], table_bytes: 8KiB, rate_per_h: 0.5}}
devices: {{gps: {{kind: sensor, pe: nav, rate_per_h: 0}}}}
variables:
  altitude: {{type: FLOAT, unit: m, versions: 2, identifier: 322, initial: 1.5, deadline_ms: 25}}
  axes: {{type: SHORT2, initial: [1, -2]}}
  word: {{type: ACHAR4, initial: abcd}}
modules:
  m:
    image: code
    device: gps
    runs_on: [nav]
    requires: [fpu]
    flash: 1.5KiB
    partition: safe
    restarts: 5
    silent: fails
    checkpoint: {{bytes: 40, hz: 2.5, max_age_ms: 800}}
    rate_per_h: 0.25
    modes:
      best: {{gives: {{altitude: 1, axes: 1}}, {RUNS}}}
      worst: {{gives: {{altitude: 2}}, cpu: 0, ram: 0, rate_hz: 0.001}}
  n: {{needs: altitude, {RUNS}}}
functions:
  f: {{output: m, criticality: {{default: C, land: A}}, priority: {{climb: 0, default: 7}}, value: [9, 4],
       priority_range: [0, 9]}}
phases:
  climb:
  land: {{when: {{variable: altitude, below: 99.5, hold_ms: 500}}}}
  abort: {{when: {{variable: altitude, above: 9, from: [land, abort]}}}}
separate: [[m, n]]
together: [[n, m]]
contingency: {{faults: 3, phases: [land]}}
"""
    spec = loads(text, "x.dg.yaml")
    assert spec.name == "whole"
    assert spec.buses["can0"] == Bus(
        "can0", 500_000, Fraction(3, 4), Fraction(1, 20), "wired", 2, 12_500_000, 4, rate_per_h=Fraction(1, 100_000)
    )
    assert spec.manager == Manager("can0", "safe_mode")
    assert spec.pes["nav"] == Pe(
        "nav", 125, ("can0", "air"), 1250, 1 << 20, 2 << 20, frozenset({"fpu"}), 8192, rate_per_h=Fraction(1, 2)
    )
    assert spec.devices["gps"].rate_per_h == 0
    assert spec.variables == {
        "altitude": Variable("altitude", "FLOAT", "m", 2, 322, 1.5, 25_000_000),
        "axes": Variable("axes", "SHORT2", initial=(1, -2)),
        "word": Variable("word", "ACHAR4", initial="abcd"),
    }
    modes = {
        "best": Mode("best", None, {"altitude": 1, "axes": 1}, 100, 1024, 10_000),
        "worst": Mode("worst", None, {"altitude": 2}, 0, 0, 1),
    }
    pinned, kept = frozenset({"fpu"}), Checkpoint(40, 2500, 800_000_000)
    assert spec.modules["m"] == Module(
        "m", "code", modes, "gps", ("nav",), pinned, 1536, "safe", 5, "fails", kept, rate_per_h=Fraction(1, 4)
    )
    assert list(spec.modules["n"].modes) == ["only"]
    function = spec.functions["f"]
    assert (function.criticality_in("land"), function.criticality_in("climb")) == ("A", "C")
    assert (function.priority_in("land"), function.priority_in("climb")) == (7, 0)
    assert (function.value, function.priority_range) == ((9, 4), (0, 9))
    assert spec.phases["land"].when == When("altitude", None, Fraction(199, 2), 500_000_000, ("climb",))
    assert spec.phases["abort"].when == When("altitude", Fraction(9), None, 0, ("land", "abort"))
    assert (spec.separate, spec.together) == ((("m", "n"),), (("n", "m"),))
    assert spec.contingency == Contingency(3, ("land",))


def test_a_file_that_cannot_be_read_is_a_finding_like_any_other(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"missing\.dg\.yaml:1:1: DG001 error: the file cannot be read: No such"):
        load(tmp_path / "missing.dg.yaml")
    with pytest.raises(SpecError, match=r":1:1: DG001 error: the file cannot be read: Is a directory"):
        load(tmp_path)


def test_a_file_that_is_too_long_is_not_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "long.dg.yaml"
    path.write_bytes(b"#" * (yaml_source.MOST_BYTES + 1))
    with pytest.raises(SpecError, match=r"long\.dg\.yaml:1:1: DG002 error: the file has more than 4194304 bytes"):
        load(path)


def test_a_file_with_thousands_of_mistakes_is_read_no_further_and_blames_nothing_below() -> None:
    """Its one function names a module that is below the last one that was read."""
    modules = "".join(f"  m{number}: {{}}\n" for number in range(MOST_FINDINGS + 5))
    text = f"dg: 1\nname: many\nmodules:\n{modules}functions:\n  f: {{output: m{MOST_FINDINGS + 4}, criticality: A}}\n"
    with pytest.raises(SpecError) as raised:
        loads(text, "many.dg.yaml")
    *found, last = raised.value.findings
    assert {one.code for one in found} == {"DG103"}
    assert (last.code, last.place.line) == ("DG002", MOST_FINDINGS + 4)
    assert len(found) == MOST_FINDINGS


def test_the_parser_without_libyaml_reads_the_same_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    data = FIGURE_3.read_bytes()
    fast = yaml_source.read_tree(data, Findings("fast"))
    monkeypatch.setattr(yaml_source, "_PARSER", yaml.SafeLoader)
    assert yaml_source.read_tree(data, Findings("slow")) == fast


def test_loading_needs_no_solver() -> None:
    program = "import sys, heronry_dg.loader, heronry_dg.shipped; sys.exit('ortools' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_every_field_is_documented_where_it_is_read() -> None:
    definitions = spec_form().model_json_schema()["$defs"]
    fields = {
        f"{form}.{name}": field for form, body in definitions.items() for name, field in body["properties"].items()
    }
    assert len(fields) > 60
    assert [name for name, field in fields.items() if not field.get("description")] == []
    assert fields["BusForm.max_load"]["default"] == 0.8
    assert fields["BusForm.heartbeat_ms"]["default"] == 20


# Mutilated files. Whatever happens to a spec, it loads or is refused in sentences.

SCALARS = st.sampled_from(
    [
        None,
        True,
        0,
        -1,
        1,
        3,
        10**30,
        0.5,
        1e300,
        "",
        "x",
        "altitude",
        "altitude@2",
        "altitude@<=9",
        "elevator_out",
        "64KiB",
        "on",
    ]
)
VALUES = st.one_of(
    SCALARS,
    st.lists(SCALARS, max_size=3),
    st.dictionaries(
        st.sampled_from(["k", "of", "var", "worth", "and", "or", "xor", "demux", "default"]), SCALARS, max_size=3
    ),
)
Path_ = tuple[str | int, ...]


def paths(node: Any, path: Path_ = ()) -> list[Path_]:
    """Every path of a plain tree but that of its root."""
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [found for key, child in children for found in [(*path, key), *paths(child, (*path, key))]]


def parent_of(node: Any, path: Path_) -> Any:
    for step in path[:-1]:
        node = node[step]
    return node


@st.composite
def mutilated(draw: st.DrawFn) -> str:
    """Figure 3 with a few fields dropped, renamed, moved, or given another value."""
    tree = copy.deepcopy(FIGURE_3_TREE)
    for _ in range(draw(st.integers(1, 4))):
        path = draw(st.sampled_from(paths(tree)))
        parent, key = parent_of(tree, path), path[-1]
        match draw(st.sampled_from(["drop", "rename", "retype", "copy"])):
            case "drop":
                del parent[key]
            case "rename" if isinstance(parent, dict):
                parent[draw(st.sampled_from(["needs", "modes", "gps", "x-y", "on", f"{key}_"]))] = parent.pop(key)
            case "copy":
                other = draw(st.sampled_from(paths(tree)))
                parent[key] = copy.deepcopy(parent_of(tree, other)[other[-1]])
            case _:
                parent[key] = draw(VALUES)
        if not paths(tree):
            break
    style = draw(st.sampled_from([None, True, False]))
    return str(yaml.dump(tree, Dumper=DUMPER, sort_keys=False, default_flow_style=style))


@st.composite
def scribbled(draw: st.DrawFn) -> str:
    """Figure 3 with pieces of its text cut out, doubled, or scribbled over."""
    text = FIGURE_3_TEXT
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 40)))
        scribble = draw(
            st.one_of(st.just(""), st.just(text[start:end] * 2), st.text("{}[]:,&*!|>'\"%@`#-? \n\tab1._", max_size=6))
        )
        text = text[:start] + scribble + text[end:]
    return text


def assert_loads_or_is_refused_in_sentences(text: str) -> None:
    lines = len(re.findall("\r\n|[\n\r\x85\u2028\u2029]", text)) + 1  # as YAML breaks them
    for finding in findings(text):
        assert 1 <= finding.place.line <= lines + 1
        assert finding.place.column >= 1
        said = str(finding)
        assert "\n" not in said
        assert len(said) < 600
        assert not any(
            word in said for word in ("Input should", "Value error", "something else", "object at", "Refused")
        )


@settings(max_examples=part_of(300))
@given(mutilated())
def test_a_mutilated_spec_loads_or_is_refused_in_sentences(text: str) -> None:
    assert_loads_or_is_refused_in_sentences(text)


@settings(max_examples=part_of(200))
@given(scribbled())
def test_a_scribbled_spec_loads_or_is_refused_in_sentences(text: str) -> None:
    assert_loads_or_is_refused_in_sentences(text)


@example("\r\r0")
@given(st.text())
def test_any_text_loads_or_is_refused_in_sentences(text: str) -> None:
    assert_loads_or_is_refused_in_sentences(text)


@given(st.binary())
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    found = Findings("bytes")
    assert (yaml_source.read_tree(data, found) is not None) or len(found) == 1


def test_the_sound_spec_of_these_tests_is_sound() -> None:
    assert loads(spec_text(), "test.dg.yaml").modules["driver"].device == "gps"
