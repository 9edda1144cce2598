"""`heronry pcs`: JSON keys, exit codes, and what a user is told."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from heronry_pcs.graph_files import load_graph
from heronry_tools.cli import main
from heronry_tools.reports.control import cut_text

FLAT = """\
pcs: 1
name: flat
components:
  A: {side: left, ports: {p: 2.5}}
  B: {ports: {p: 1}}
  C: {plant: true, ports: [p]}
  D: {side: right, ports: [p]}
edges: [A.p -> B.p, B.p -> D.p, B.p -> C.p, C.p -> A.p]
library: {Z: {image: z.dll, ports: [p]}}
"""
WITH_PLANT = """\
plants:
  elevator: {moved_by: [elevator_servo_1, elevator_servo_2], seen_by: [elevator_angle_sensor], criticality: A}
"""
ELEVATOR = Path("dg_specs/elevator_and_chute.dg.yaml")


@pytest.fixture
def flat(tmp_path: Path) -> str:
    file = tmp_path / "flat.pcs.yaml"
    file.write_text(FLAT)
    return str(file)


@pytest.fixture
def spec(tmp_path: Path) -> str:
    """A spec whose elevator is seen and moved, and not fed back: its control reads no angle."""
    file = tmp_path / "elevator.dg.yaml"
    file.write_text(ELEVATOR.read_text() + WITH_PLANT)
    return str(file)


class Said:
    """What a command wrote, and how it ended."""

    def __init__(self, capsys: pytest.CaptureFixture[str], *arguments: str) -> None:
        self.code = main(["pcs", *arguments])
        self.out, self.err = capsys.readouterr()

    @property
    def json(self) -> Any:
        return json.loads(self.out)


def test_check_of_a_file(flat: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = Said(capsys, "check", flat, "--json", "--path", "A,C")
    assert said.code == 0
    assert list(said.json) == [
        "component_graph", "edge_contained", "whole", "nested", "disjoint", "pruned", "component_connected",
        "configuration", "broken", "longest_cycle", "cycle_bound", "control_path", "components",
    ]  # fmt: skip
    assert said.json["longest_cycle"] == [3, 3]
    assert (said.json["cycle_bound"], said.json["control_path"], said.json["broken"]) == (False, True, {})
    assert said.json["components"]["C"] == {
        "neighbors": ["A", "B"], "subsumes": [], "controllable": "possible", "observable": "possible",
        "on_loop": True, "on_path": True,
    }  # fmt: skip
    assert "on_path" not in said.json["components"]["A"]
    assert said.json["components"]["D"]["observable"] == "excluded"


def test_what_is_required_decides_the_exit_code(flat: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert Said(capsys, "check", flat, "--require", "cycle_bound").code == 1
    assert Said(capsys, "check", flat, "--require", "nested,on_path").code == 0
    assert Said(capsys, "check", flat, "--require", "control_path", "--path", "A,D").code == 1
    assert Said(capsys, "check", flat, "--require", "control_path", "--path", "A,C").code == 0
    for bad in (["--require", "sound"], ["--require", "control_path"]):
        said = Said(capsys, "check", flat, *bad)
        assert said.code == 2
        assert said.err.startswith("heronry: --require")


def test_the_conditions_are_always_labelled(flat: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = Said(capsys, "check", flat)
    assert "not observable: D (necessary, not sufficient)" in said.out
    assert "not controllable: none excluded (necessary, not sufficient)" in said.out


def test_a_view_that_is_none_and_a_name_that_is_unknown(flat: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = Said(capsys, "check", flat, "--at", "A,B", "--json")
    assert (said.code, said.json) == (1, {"error": "view"})
    assert Said(capsys, "check", flat, "--path", "A,Y", "--json").json == {"error": "unknown:Y"}
    said = Said(capsys, "check", flat, "--at", "A,Y")
    assert (said.code, said.out) == (2, "")
    assert said.err == "heronry: there is no 'Y' here; there is A, B, C, D\n"


def test_a_file_that_is_no_spec_is_told_in_one_line_and_a_bad_spec_in_a_few(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "plan.json"
    assert main(["plan", "elevator_and_chute", "-o", str(file)]) == 0
    said = Said(capsys, "check", str(file))
    assert (said.code, said.out) == (2, "")
    assert len(said.err.splitlines()) == 1
    assert "plan" in said.err
    spec = tmp_path / "bad.dg.yaml"
    spec.write_text("dg: 1\n" + "".join(f"unknown_{number}: 1\n" for number in range(9)))
    *first, last = Said(capsys, "check", str(spec)).err.splitlines()
    assert len(first) == 5
    assert re.fullmatch(rf"and \d+ more; is this the right file\? 'heronry check {spec}' lists all", last)


def test_every_shipped_spec_is_known(capsys: pytest.CaptureFixture[str]) -> None:
    assert "plant plant:speed: on a control path" in Said(capsys, "check", "eav").out


def test_an_edit_of_a_view_works_on_the_view_as_a_graph(capsys: pytest.CaptureFixture[str]) -> None:
    view, command = ("--at", "Kfms,Kc,Km,Kuav", "--json"), "Km.surfaces->Kdyn.surfaces"
    said = Said(capsys, "edit", "g_eav", "removal", command, *view)
    assert said.code == 0
    left = json.loads(said.out)
    assert set(left["check"]["components"]) >= {"Kfms", "Kc", "Km", "Kuav"}
    assert command not in Said(capsys, "edit", "g_eav", "removal", command, *view[:-1]).out.replace(" ", "")


def test_a_spec_without_plants_is_told_as_that(capsys: pytest.CaptureFixture[str]) -> None:
    said = Said(capsys, "check", "elevator_and_chute")
    assert "no member is a plant, so no control path is checked" in said.out
    assert said.out.endswith("'on_path' required nothing: name another predicate with --require\n")
    assert "no member is a plant" not in Said(capsys, "check", "g_star").out


def test_a_misspelt_member_is_answered_with_the_one_that_is_meant(capsys: pytest.CaptureFixture[str]) -> None:
    said = Said(capsys, "check", "g_star", "--at", "Kimuu")
    assert (said.code, said.out) == (2, "")
    assert "there is no 'Kimuu' here; did you mean 'Kimu'?" in said.err


def edited(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    said = Said(capsys, "edit", *arguments, "--json")
    assert said.code == (2 if said.json.get("error", "").startswith("unknown:") else "error" in said.json)
    return said.json


def test_edits(flat: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert edited(capsys, flat, "cprune")["graph"]["graph"]["components"] == ["A", "B", "C", "D"]
    less = edited(capsys, flat, "removal", "B.p->D.p", "B.p -> C.p", "A.p->B.p")
    assert less["graph"]["graph"]["components"] == ["A", "C"]
    assert less["check"]["configuration"] is True
    assert edited(capsys, flat, "removal", "B.p->C.p", "B.p->Y.p") == {"error": "unknown:Y.p"}
    assert edited(capsys, flat, "addition", "D.p->Z.p") == {"error": "edge_outside"}
    assert edited(capsys, flat, "addition", "D.p->Y.p") == {"error": "unknown:Y.p"}
    assert ["D.p", "A.p"] in edited(capsys, flat, "addition", "D.p->A.p")["graph"]["graph"]["edges"]
    assert "Z" in edited(capsys, flat, "addEdge", "D.p->Z.p")["graph"]["graph"]["components"]
    other = tmp_path / "other.pcs.yaml"
    other.write_text("pcs: 1\ncomponents: {Q: {ports: [p]}}\n")
    both = edited(capsys, flat, "combine", str(other), "A.p->Q.p")
    assert (both["graph"]["name"], both["check"]["configuration"]) == ("flat", True)
    assert edited(capsys, flat, "combine", str(other))["check"]["configuration"] is False


def test_contraction_and_expansion(flat: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "contracted.pcs.json"
    made = edited(capsys, flat, "contract", "K", "--of", "A,B", "--write", str(file))
    assert made["graph"]["components"]["K"] == {
        "vertices": ["A.p", "B.p"], "edges": [["A.p", "B.p"]], "components": ["A", "B"]
    }  # fmt: skip
    assert sorted(made["check"]["components"]) == ["C", "D", "K"]
    assert json.loads(file.read_text()) == made["graph"]
    opened = edited(capsys, str(file), "expand", "K", "--at", "C,D,K")
    assert sorted(opened["check"]["components"]) == ["A", "B", "C", "D"]
    assert opened["graph"] == made["graph"]
    assert edited(capsys, str(file), "contract", "K", "--at", "C,D,K") == {"error": "contracted"}
    assert edited(capsys, str(file), "contract", "K", "--at", "A,B,C,D")["graph"] == made["graph"]
    assert edited(capsys, str(file), "expand", "K") == {"error": "view"}, "without --at, the view is all members"
    said = Said(capsys, "edit", flat, "contract", "K.1", "--of", "A,B")
    assert (said.code, said.out) == (2, "")
    assert "'K.1' cannot be the name of a component: use at most 128 letters" in said.err


@pytest.mark.parametrize(
    "arguments",
    [["cprune", "A"], ["addition"], ["removal"], ["addition", "A.p"], ["combine"], ["contract", "A", "B"]],
)
def test_an_edit_with_other_arguments(flat: str, arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    said = Said(capsys, "edit", flat, *arguments)
    assert said.code == 2
    assert said.err.startswith("heronry: ")


def test_scripts_of_graphs(flat: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    after = tmp_path / "after.pcs.json"
    assert Said(capsys, "edit", flat, "addEdge", "D.p->Z.p", "--write", str(after)).code == 0
    script = Said(capsys, "script", flat, str(after))
    assert script.out.splitlines() == [
        "define Z;",
        'Z = G.CreateComponent ( "z.dll" );',
        'G.CreateEdge ( "D.p", "Z.p" );',
    ]
    assert Said(capsys, "script", flat, str(after), "--json").json == {"script": script.out}
    file = tmp_path / "there.pcs.script"
    file.write_text(script.out)
    there = tmp_path / "there.pcs.json"
    said = Said(capsys, "apply", str(file), flat, "--json", "--write", str(there))
    assert said.code == 0
    assert list(said.json) == ["statements", "errors", "before", "after"]
    assert (said.json["statements"], said.json["errors"]) == (3, [])
    assert load_graph(there).own == load_graph(after).own
    assert Said(capsys, "script", str(after), "g_eav", "--json").code == 0


def test_a_script_with_errors_does_nothing(flat: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "bad.pcs.script"
    file.write_text("G.DeleteComponent ( A );\nG.DeleteComponent ( A );\nG.Explode ();\n")
    said = Said(capsys, "apply", str(file), flat, "--json", "--write", str(tmp_path / "x.pcs.json"))
    assert said.code == 1
    assert said.json["statements"] == 2
    assert said.json["before"] == said.json["after"]
    assert said.json["errors"] == [
        {"line": 2, "column": 0, "code": "PCS207", "sentence": "component 'A' was deleted on line 1"},
        {"line": 3, "column": 3, "code": "PCS102", "sentence": said.json["errors"][1]["sentence"]},
    ]
    assert not (tmp_path / "x.pcs.json").exists()
    text = Said(capsys, "apply", str(file), flat).out
    assert f"{file}:2: PCS207 error: component 'A' was deleted on line 1\n" in text
    file.write_text('G.DeleteComponent ( "\x1b[31m" );\n')
    assert r"'\x1b[31m' does not exist" in Said(capsys, "apply", str(file), flat).out
    assert text.endswith("2 statements read, 2 errors: nothing is done\n")


def test_graphs_without_a_script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "part.pcs.json"
    leaf = {"ports": {"p": 0, "q": 0}}
    part = {"vertices": ["A.p"], "edges": [], "components": []}
    file.write_text(json.dumps({"pcs": 1, "leaves": {"A": leaf}, "graph": part}))
    said = Said(capsys, "script", str(file), str(file), "--json")
    assert (said.code, said.json) == (1, {"error": "needs:whole"})


def test_the_graph_of_a_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "elevator_and_chute", "--json"]) == 0
    plan = tmp_path / "plan.json"
    plan.write_text(capsys.readouterr().out)
    whole = Said(capsys, "graph", "elevator_and_chute", "--json").json
    assert Said(capsys, "graph", "elevator_and_chute", "--plan", str(plan), "--json").json == whole
    by_pe = Said(capsys, "graph", "elevator_and_chute", "--level", "pe", "--json").json
    assert by_pe["graph"]["components"] == ["pe:control_pe", "pe:sensor_pe", "pe:tail_pe"]
    file = tmp_path / "plan.pcs.json"
    said = Said(capsys, "graph", "elevator_and_chute", "-o", str(file))
    assert (said.code, said.out) == (0, "")
    assert json.loads(file.read_text()) == whole
    assert "high_quality_altitude" in Said(capsys, "graph", "elevator_and_chute").out
    for arguments in (
        ["g_eav", "--level", "pe"], ["elevator_and_chute", "-o", str(tmp_path / "x.png")], ["nothing"],
    ):  # fmt: skip
        assert Said(capsys, "graph", *arguments).code == 2


def test_check_of_a_spec(spec: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert Said(capsys, "check", "elevator_and_chute").code == 0, "it has no plant"
    said = Said(capsys, "check", spec)
    assert said.code == 1
    assert "plant plant:elevator: open, on no control path\n" in said.out
    assert said.out.endswith("required, but does not hold: on_path\n")
    assert Said(capsys, "check", spec, "--at", "plant:elevator").code == 1, "no view"


def test_scripts_of_plans(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = []
    for number, down in enumerate(([], ["--down", "device:gps"])):
        assert main(["plan", "elevator_and_chute", *down, "--json"]) == 0
        files.append(str(tmp_path / f"plan{number}.json"))
        Path(files[-1]).write_text(capsys.readouterr().out)
    said = Said(capsys, "script", *files, "--spec", "elevator_and_chute")
    assert Said(capsys, "script", *files).out == said.out, "the spec of a plan is found among the shipped ones"
    (tmp_path / "other.json").write_text("{}")
    assert Said(capsys, "script", files[0], str(tmp_path / "other.json")).code == 2
    script = tmp_path / "down.pcs.script"
    script.write_text(said.out)
    tried = Said(capsys, "apply", str(script), "elevator_and_chute", "--plan", files[0], "--json")
    assert (tried.code, tried.json["errors"], tried.json["violations"]) == (0, [], [])
    graph = Said(capsys, "graph", "elevator_and_chute", "--plan", files[1], "--json").json
    assert tried.json["after"]["graph"] == graph["graph"]
    illegal = tmp_path / "illegal.pcs.script"
    illegal.write_text("G.DeleteComponent ( elevator_control );\nG.PruneEdges ();\n")
    said = Said(capsys, "apply", str(illegal), "elevator_and_chute")
    assert said.code == 0
    assert "not legal: " in said.out
    illegal.write_text("G.DeleteComponent ( nothing );\n")
    assert Said(capsys, "apply", str(illegal), "elevator_and_chute", "--json").json["violations"] == []


def test_the_cut(flat: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = Said(capsys, "cut", flat, "--json")
    assert (said.code, said.json) == (0, {"mbit_per_s": 1000, "sides": {"left": ["A", "B"], "right": ["D"]}})
    assert "at least 1 bit/s cross\n  left: A, B\n  right: D\n" in Said(capsys, "cut", flat).out
    assert Said(capsys, "cut", "elevator_and_chute", "--json").json == {"error": "sides"}
    assert Said(capsys, "cut", "elevator_and_chute").err.endswith("here they are pinned to side:sensor_pe\n")
    assert [cut_text(mbit, {})[9:-13] for mbit in (0, 43_200_000, 9_500, 1_001)] == ["0", "43200", "9.5", "1.001"]


def test_a_file_that_is_no_script_is_told_in_a_few_lines(
    flat: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "drawing.svg"
    file.write_text("<svg>;\n" * 40)
    said = Said(capsys, "apply", str(file), flat)
    assert said.out.splitlines()[3:] == [
        "and 37 more; is this the right file? A script is text as in *.pcs.script",
        "0 statements read, 40 errors: nothing is done",
    ]


def test_one_edge_is_no_plural(capsys: pytest.CaptureFixture[str]) -> None:
    said = Said(capsys, "graph", "elevator_and_chute", "--level", "pe")
    assert said.out.startswith("elevator_and_chute: 3 members, 37 vertices, 1 edge\n")


def test_a_misspelt_requirement_has_its_remedy(flat: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = Said(capsys, "check", flat, "--require", "confguration")
    assert said.err == "heronry: --require: there is no predicate 'confguration'; did you mean 'configuration'?\n"
    assert list(Said(capsys, "cut", "big_blue", "--json").json["sides"]) == ["side:flight", "side:ground"]


def test_files_that_cannot_be_used(flat: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = tmp_path / "bad.pcs.yaml"
    bad.write_text("pcs: 1\nedges: [A.p -> B.p]\n")
    said = Said(capsys, "check", str(bad))
    assert said.code == 2
    assert f"{bad}:2:9: PCS001 error: unknown:A.p: " in said.err
    assert Said(capsys, "check", flat, "--plan", "x").code == 2
    assert Said(capsys, "apply", str(tmp_path / "none.pcs.script"), flat).code == 2
    said = Said(capsys, "edit", flat, "cprune", "--write", str(tmp_path / "x.yaml"))
    assert said.code == 2
    assert "ends in .pcs.json" in said.err


def test_a_name_of_nothing_is_refused_with_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    said = Said(capsys, "check", "g_eave")
    assert said.code == 2
    assert "a shipped graph (g_eav, g_max, g_star)" in said.err
    assert "a shipped spec (big_blue, elevator_and_chute, eav)" in said.err


def test_a_list_of_names_without_a_name(flat: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["pcs", "check", flat, "--at", "A,,B"])
    assert "write names with commas between them" in capsys.readouterr().err


def test_a_file_beside_a_shipped_name_is_not_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy("dg_specs/polymorphic/g_eav.pcs.yaml", tmp_path)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "g_eav").write_text("")
    assert main(["pcs", "check", "g_eav"]) == 2
    assert main(["pcs", "check", "g_max", "--require", "whole"]) == 0
