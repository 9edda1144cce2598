"""Files of component graphs: what they mean, that they come back the same, and every way in which one is bad."""

import json
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft7Validator

from heronry_dg.findings import Findings, SpecError
from heronry_dg.yaml_source import MOST_BYTES, plain, read_tree
from heronry_pcs.graph import Graph
from heronry_pcs.graph_files import document, findings_in, load_graph, read_graph, to_json
from heronry_pcs.json_schema import graph_schema, schema_text
from heronry_tools.cli import main
from pcs.drawn_graphs import as_graph, drawn
from thoroughness import part_of

EXAMPLE = """\
pcs: 1
name: g_eav
components:
  Kc: {components: {Kc1: {ports: [a]}, Kc2: {ports: [a, b]}}}
  Kdyn: {plant: true, ports: [motion]}
  Kimu: {side: uav, ports: {motion: 0, m_posUp_ft: 9500.125}}
edges: [Kc1.a -> Kc2.a, Kdyn.motion->Kimu.motion, Kimu.motion -> Kekf.m_alt]
library: {Kekf: {image: pcstrackingfilter.dll, ports: [m_alt]}}
"""


def graph_in(text: str, file: str = "x.pcs.yaml") -> Graph:
    findings = Findings(file)
    graph = read_graph(text.encode(), file, findings)
    assert graph is not None, list(findings)
    return graph


def test_the_example_of_the_format() -> None:
    graph = graph_in(EXAMPLE)
    assert graph.name == "g_eav"
    assert list(graph.members) == ["Kc", "Kc1", "Kc2", "Kdyn", "Kimu"]
    assert list(graph.leaves) == ["Kc1", "Kc2", "Kdyn", "Kimu", "Kekf"]
    assert graph.composites["Kc"].components == {"Kc1", "Kc2"}
    assert graph.composites["Kc"].vertices == {"Kc1.a", "Kc2.a", "Kc2.b"}
    assert graph.composites["Kc"].edges == {("Kc1.a", "Kc2.a")}
    assert graph.leaves["Kimu"].ports == {"motion": 0, "m_posUp_ft": 9_500_125}
    assert (graph.leaves["Kimu"].side, graph.leaves["Kdyn"].plant) == ("uav", True)
    assert (graph.leaves["Kekf"].image, graph.leaves["Kc1"].image) == ("pcstrackingfilter.dll", "Kc1")
    assert "Kekf.m_alt" in graph.space - graph.vertices
    assert len(graph.edges) == 3


def test_components_at_any_depth_are_members() -> None:
    graph = graph_in("pcs: 1\ncomponents: {K: {components: {L: {components: {A: {ports: [a.b]}}}, B: {ports: [a]}}}}\n")
    assert list(graph.members) == ["A", "B", "K", "L"]
    assert graph.composites["K"].components == {"A", "B", "L"}
    assert graph.composites["L"].vertices == {"A.a.b"}
    assert list(graph.composites) == ["K", "L"]
    assert graph.name == "x"


@settings(max_examples=part_of(500, 10))
@given(st.integers(0, 2**32))
def test_json_comes_back_the_same(seed: int) -> None:
    graph = as_graph(drawn(Random(seed)))
    text = to_json(graph)
    assert graph_in(text, "x.pcs.json") == graph
    assert to_json(graph_in(text, "x.pcs.json")) == text


def test_keys_of_the_json_form() -> None:
    found = document(graph_in(EXAMPLE))
    assert list(found) == ["pcs", "name", "leaves", "components", "graph"]
    assert found["leaves"]["Kimu"] == {
        "ports": {"motion": 0, "m_posUp_ft": 9_500_125},
        "image": "Kimu",
        "plant": False,
        "side": "uav",
    }
    assert found["components"]["Kc"] == {
        "vertices": ["Kc1.a", "Kc2.a", "Kc2.b"],
        "edges": [["Kc1.a", "Kc2.a"]],
        "components": ["Kc1", "Kc2"],
    }


LEAF = "{A: {ports: [a]}}"
BAD_YAML = {
    "": "1:1: the file is empty",
    "- a\n": "1:1: a component graph is a map",
    "name: x\n": "1:1: the file lacks 'pcs'",
    "pcs: 2\n": "1:6: 'pcs' must be 1, not 2",
    "pcs: [1]\n": "1:6: 'pcs' must be 1, not a list",
    "pcs: 1\nedge: []\n": "2:1: the file has no field 'edge'",
    "pcs: 1\npcs: 1\n": "2:1: 'pcs' is given twice",
    "pcs: 1\nname: &a x\n": "2:7: an anchor",
    "pcs: 1\nname: 3\n": "2:7: 'name' of the file must be text, not 3",
    "pcs: 1\ncomponents: [A]\n": "2:13: components must be a map, not a list",
    "pcs: 1\ncomponents: {A: 3}\n": "2:17: component 'A' must be a map, not 3",
    "pcs: 1\ncomponents: {A: {}}\n": "2:14: component 'A' lacks 'ports'",
    "pcs: 1\ncomponents: {A: {ports: []}}\n": "2:25: component 'A' has no port",
    "pcs: 1\ncomponents: {A: {ports: x}}\n": "2:25: 'ports' of component 'A' must be a list or a map",
    "pcs: 1\ncomponents: {A: {ports: [1]}}\n": "2:26: a port of component 'A' must be a name, not 1",
    "pcs: 1\ncomponents: {A: {ports: [a, a]}}\n": "2:29: component 'A' has port 'a' twice",
    "pcs: 1\ncomponents: {A: {ports: [a b]}}\n": "2:26: 'a b' cannot be the name of a port",
    "pcs: 1\ncomponents: {A: {ports: {a b: 1}}}\n": "2:26: 'a b' cannot be the name of a port",
    "pcs: 1\ncomponents: {A: {ports: {a: -1}}}\n": "2:29: the weight of port 'a' of component 'A' must be from 0",
    "pcs: 1\ncomponents: {A: {ports: {a: 0.0001}}}\n": "2:29: the weight of port 'a' of component 'A' must not",
    "pcs: 1\ncomponents: {A: {ports: {a: [1]}}}\n": "2:29: the weight of port 'a' of component 'A' must be a number",
    "pcs: 1\ncomponents: {A: {ports: [a], plant: maybe}}\n": "2:37: 'plant' of component 'A' must be true or false",
    "pcs: 1\ncomponents: {A: {ports: [a], plnt: true}}\n": "2:30: component 'A' has no field 'plnt'",
    "pcs: 1\ncomponents: {A.b: {ports: [a]}}\n": "2:14: 'A.b' cannot be the name of a component",
    "pcs: 1\ncomponents: {K: {side: x, components: {A: {ports: [a]}}}}\n": "2:18: component 'K' has components",
    "pcs: 1\ncomponents: {K: {components: {A: {ports: [a]}}}, A: {ports: [a]}}\n": "2:50: clash:A: ",
    f"pcs: 1\ncomponents: {LEAF}\nlibrary: {LEAF}\n": "3:11: clash:A: ",
    "pcs: 1\nlibrary: {K: {components: {A: {ports: [a]}}}}\n": "2:15: component 'K' has components",
    f"pcs: 1\ncomponents: {LEAF}\nedges: x\n": "3:8: 'edges' must be a list, not 'x'",
    f"pcs: 1\ncomponents: {LEAF}\nedges: [A.a]\n": "3:9: an edge must be text with an arrow, not 'A.a'",
    f"pcs: 1\ncomponents: {LEAF}\nedges: [{{}}]\n": "3:9: an edge must be text with an arrow, not a map",
    f"pcs: 1\ncomponents: {LEAF}\nedges: [A.a -> A.a, A.a->A.a]\n": "3:21: edge 'A.a -> A.a' is given twice",
    f"pcs: 1\ncomponents: {LEAF}\nedges: [A.a -> B.b]\n": "3:9: unknown:B.b: ",
    f"pcs: 1\ncomponents: {LEAF}\nedges: [A -> A.a]\n": "3:9: unknown:A: ",
    "pcs: 1\ncomponents: {\n": "3:1: this is not YAML",
}


@pytest.mark.parametrize(("text", "expected"), BAD_YAML.items())
def test_a_bad_file_is_found_out_with_its_place(text: str, expected: str) -> None:
    found = findings_in(text.encode(), "x.pcs.yaml")
    assert [finding.code for finding in found] == ["PCS001"]
    assert f"{found[0].place.line}:{found[0].place.column}: {found[0].sentence}".startswith(expected)
    assert "dg: 1" not in found[0].hint


@pytest.mark.parametrize("field", ["name: yes", "components: {A: {ports: [a], plant: yes}}", "edges: [no]", "pcs: 0x1"])
def test_a_scalar_that_programs_read_differently_is_refused_once(field: str) -> None:
    text = field if field.startswith("pcs") else f"pcs: 1\n{field}"
    assert len(findings_in(text.encode(), "x.pcs.yaml")) == 1


def bad_json(change: Any) -> str:
    found = document(graph_in(EXAMPLE))
    change(found)
    return json.dumps(found)


BAD_JSON = {
    "{": "1:2: this is not JSON",
    "[]": "1:1: the file must be an object, not a list",
    "{}": "1:1: the file lacks 'pcs', 'leaves' and 'graph'",
    '{"pcs": NaN}': "1:1: this is not JSON of a graph: the file holds NaN",
    f'{{"pcs": {"9" * 5000}}}': (
        "1:1: this is not JSON of a graph: the file holds a number with 5000 digits; write at most 1000"
    ),
    '{"pcs": 1, "pcs": 1, "leaves": {}, "graph": {"vertices": [], "edges": [], "components": []}}': (
        "1:9: the file gives 'pcs' twice"
    ),
}
CHANGES = {
    "'pcs' must be 1, not 2": lambda found: found.update(pcs=2),
    "'pcs' must be 1, not true": lambda found: found.update(pcs=True),
    "'name' must be printable text, not ''": lambda found: found.update(name=""),
    "the file has no field 'x'": lambda found: found.update(x=1),
    "'leaves' must be an object": lambda found: found.update(leaves=[], components={}, graph=EMPTY),
    "leaf 'Kc1' must be an object": lambda found: found["leaves"].update(Kc1=1),
    "'ports' of leaf 'Kc1' must be an object": lambda found: found["leaves"]["Kc1"].update(ports=[]),
    "'A.b' cannot be the name of a component": lambda found: found["leaves"].update({"A.b": ONE}),
    r"'A\u200b' cannot be the name of a component": lambda found: found["leaves"].update({"A\u200b": ONE}),
    r"'\x1b' cannot be the name of a port": lambda found: found["leaves"]["Kdyn"]["ports"].update({"\x1b": 1}),
    "'a b' cannot be the name of a port": lambda found: found["leaves"]["Kdyn"]["ports"].update({"a b": 1}),
    "the weight of port 'motion'": lambda found: found["leaves"]["Kdyn"]["ports"].update(motion=0.5),
    "'plant' of leaf 'Kdyn' must be true": lambda found: found["leaves"]["Kdyn"].update(plant=1),
    "'side' must be printable text, not 1": lambda found: found["leaves"]["Kdyn"].update(side=1),
    "clash:Kc: ": lambda found: found["leaves"].update(Kc=ONE),
    "unknown:Z: ": lambda found: found["graph"]["components"].append("Z"),
    "unknown:Z.z: ": lambda found: found["graph"]["vertices"].append("Z.z"),
    "unknown:Y.y: ": lambda found: found["components"]["Kc"]["edges"].append(["Kc1.a", "Y.y"]),
    "'Kdyn' is given twice": lambda found: found["graph"]["components"].append("Kdyn"),
    "an edge must be a list of two": lambda found: found["graph"]["edges"].append(["Kc1.a"]),
    "the edge 'Kc1.a -> Kc2.a' is given twice": lambda found: found["graph"]["edges"].append(["Kc1.a", "Kc2.a"]),
    "'edges' must be a list, not 'x'": lambda found: found["graph"].update(edges="x"),
    "this must be a name, not 3": lambda found: found["graph"]["vertices"].append(3),
    "components Kc lacks 'edges'": lambda found: found["components"]["Kc"].pop("edges"),
}
EMPTY: dict[str, Any] = {"vertices": [], "edges": [], "components": []}
ONE: dict[str, Any] = {"ports": {"a": 0}}


@pytest.mark.parametrize(("text", "expected"), BAD_JSON.items())
def test_bad_json_is_found_out_with_its_place(text: str, expected: str) -> None:
    found = findings_in(text.encode(), "x.pcs.json")
    assert {finding.code for finding in found} == {"PCS001"}
    assert f"{found[0].place.line}:{found[0].place.column}: {found[0].sentence}".startswith(expected)


@pytest.mark.parametrize("sentence", CHANGES)
def test_a_change_that_makes_json_bad_is_found_out(sentence: str) -> None:
    found = findings_in(bad_json(CHANGES[sentence]).encode(), "x.pcs.json")
    assert any(finding.sentence.startswith(sentence) for finding in found), found
    assert all(finding.place.column > 1 for finding in found)


def test_bytes_that_are_no_text_and_too_many_of_them() -> None:
    assert "is not UTF-8" in findings_in(b'{"pcs": "\xff"}', "x.pcs.json")[0].sentence
    assert "more than" in findings_in(b" " * (MOST_BYTES + 1), "x.pcs.json")[0].sentence
    assert "are nested too deeply" in findings_in(b"[" * 100_000, "x.pcs.json")[0].sentence
    half = bad_json(lambda found: found["leaves"].update({"\ud800": ONE}))
    assert r"'\ud800' cannot be the name" in findings_in(half.encode(), "x.pcs.json")[0].sentence
    assert findings_in(b'{\t"pcs": 2}', "x.pcs.json")[0].place == (1, 1), "YAML has no such tabs, so no place is known"


def test_a_file_is_loaded_or_refused(tmp_path: Path) -> None:
    file = tmp_path / "good.pcs.yaml"
    file.write_text(EXAMPLE)
    assert load_graph(file) == graph_in(EXAMPLE)
    with pytest.raises(SpecError, match="PCS001 error: the file cannot be read"):
        load_graph(tmp_path / "none.pcs.yaml")
    file.write_text("pcs: 2\n")
    with pytest.raises(SpecError, match=r"good\.pcs\.yaml:1:6: PCS001 error"):
        load_graph(file)


def test_heronry_check_takes_graphs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "good.pcs.yaml").write_text(EXAMPLE)
    assert main(["check", "--fast", str(tmp_path)]) == 0
    (tmp_path / "bad.pcs.json").write_text("{}")
    assert main(["check", "--fast", "--select", "DG4", str(tmp_path)]) == 1
    assert "PCS001" in capsys.readouterr().out
    for form in ("json", "sarif", "github", "junit"):
        assert main(["check", "--format", form, str(tmp_path)]) == 1
        assert "PCS001" in capsys.readouterr().out
    assert main(["explain", "PCS001"]) == 0
    assert capsys.readouterr().out.startswith("PCS001 ")


VALIDATOR = Draft7Validator(graph_schema())
SEEN_BY_THE_SCHEMA = [
    text
    for text, expected in BAD_YAML.items()
    if not any(word in expected for word in ("empty", "twice", "clash", "unknown:", "YAML", "anchor", "must not"))
]


def as_json(text: str) -> Any:
    tree = read_tree(text.encode(), Findings("x"))
    assert tree is not None
    return json.loads(json.dumps(plain(tree), default=float))


def test_the_schema_accepts_what_the_reader_accepts() -> None:
    Draft7Validator.check_schema(graph_schema())
    assert [error.message for error in VALIDATOR.iter_errors(as_json(EXAMPLE))] == []
    empty = "pcs: 1\nname:\ncomponents: {A: {ports: {a: }, side: }}\nlibrary:\nedges:\n"
    assert findings_in(empty.encode(), "x.pcs.yaml") == ()
    assert [error.message for error in VALIDATOR.iter_errors(as_json(empty))] == []


@pytest.mark.parametrize("text", SEEN_BY_THE_SCHEMA)
def test_the_schema_marks_what_can_be_seen_without_names(text: str) -> None:
    assert not VALIDATOR.is_valid(as_json(text))


def test_the_schema_beside_the_graphs_is_up_to_date(capsys: pytest.CaptureFixture[str]) -> None:
    assert Path("dg_specs/pcs.schema.json").read_text() == schema_text()
    assert main(["schema", "pcs"]) == 0
    assert capsys.readouterr().out == schema_text()


@settings(max_examples=part_of(2000, 20))
@given(st.integers(0, 2**32))
def test_no_damage_to_a_file_makes_the_reader_fail(seed: int) -> None:
    rng = Random(seed)
    for text, file in ((EXAMPLE, "x.pcs.yaml"), (to_json(graph_in(EXAMPLE)), "x.pcs.json")):
        data = bytearray(text.encode())
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(len(data))
            data[at : at + rng.randint(0, 3)] = rng.choice([b"", b"{", b"]", b'"', b"\xff", b"1", b": ", b"null", b"-"])
        found = Findings(file)
        graph = read_graph(bytes(data), file, found)
        assert (graph is None) == bool(len(found))
        assert {finding.code for finding in found} <= {"PCS001"}
