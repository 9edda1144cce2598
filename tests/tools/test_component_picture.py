"""The picture of a component graph: what is drawn, what is bold, and what is open."""

from pathlib import Path

import pytest

from heronry_dg.loader import loads
from heronry_dg.situation import situation
from heronry_manager.planner.greedy.planner import Greedy
from heronry_pcs.graph_files import load_graph
from heronry_pcs.plan_graph import level_view, plan_graph
from heronry_pcs.views import view_graph
from heronry_tools.cli import main
from heronry_tools.reports.render.components import component_picture
from heronry_tools.reports.render.svg import svg

FOLDER = Path("dg_specs/polymorphic")
G_EAV = load_graph(FOLDER / "g_eav.pcs.yaml")
G_MAX = load_graph(FOLDER / "g_max.pcs.yaml")
SPEC = Path("dg_specs/elevator_and_chute.dg.yaml").read_text() + (
    "plants:\n  elevator: {moved_by: [elevator_servo_1, elevator_servo_2], seen_by: [elevator_angle_sensor]}\n"
)


def test_leaves_are_drawn_and_composites_are_not() -> None:
    drawn = component_picture(G_EAV)
    assert set(drawn.nodes) == set(G_EAV.members) - {"Kc", "Kuav"}
    assert drawn.nodes["Kdyn"].kind == "variable"
    assert drawn.nodes["Kimu"].note == "pinned to uav"
    ends = {(edge.source, edge.target): edge.label for edge in drawn.edges}
    assert ends["Kimu", "Kc4"] == "2 edges"
    assert ends["Kdyn", "Kimu"] == ""


def test_a_loop_through_a_plant_is_bold_and_an_open_plant_is_crossed_out() -> None:
    drawn = component_picture(G_MAX)
    bold = {(edge.source, edge.target) for edge in drawn.edges if edge.chosen}
    assert ("Kmtr", "Kugv") in bold
    assert ("Kcam", "Kvis") not in bold
    assert (drawn.nodes["Kenv"].note, drawn.nodes["Kenv"].dead) == ("open", True)
    assert (drawn.nodes["Kugv"].note, drawn.nodes["Kugv"].dead) == ("plant", False)
    assert [edge.target for edge in drawn.edges if edge.dead] == ["Kcam"]


def test_loops_of_a_view_are_those_of_its_model() -> None:
    view = view_graph(G_EAV, {"Kfms", "Kc", "Km", "Kuav"})
    drawn = component_picture(view, G_EAV)
    assert set(drawn.nodes) == {"Kfms", "Kc", "Km", "Kuav"}
    assert all(edge.chosen for edge in drawn.edges)


def test_devices_of_a_plan_have_their_symbols() -> None:
    spec = loads(SPEC, "elevator.dg.yaml")
    graph = plan_graph(spec, Greedy(spec).plan(situation(spec), None).configuration)
    drawn = component_picture(graph)
    assert drawn.nodes["device:gps"].kind == "sensor"
    assert drawn.nodes["device:elevator_servo_1"].kind == "actuator"
    assert drawn.nodes["plant:elevator"].note == "open"
    assert drawn.nodes["gps_driver"].note.startswith("image gps_driver:only@sensor_pe\npinned to ")
    by_pe = component_picture(view_graph(graph, level_view(graph, "pe")), graph)
    assert set(by_pe.nodes) == {"pe:sensor_pe", "pe:control_pe", "pe:tail_pe", "plant:elevator"}


@pytest.mark.parametrize("name", ["g_eav", "g_max", "g_star", "big_blue"])
def test_the_command_draws(name: str, tmp_path: Path) -> None:
    file = tmp_path / "graph.svg"
    assert main(["pcs", "graph", name, "-o", str(file)]) == 0
    text = file.read_text()
    assert text.startswith("<svg ")
    assert f"<title>Component graph of {name}</title>" in text
    assert main(["pcs", "graph", name, "-o", str(file)]) == 0
    assert file.read_text() == text


def test_every_member_is_in_the_picture() -> None:
    text = svg(component_picture(G_MAX), "Component graph")
    assert all(f">{name}</text>" in text for name in G_MAX.members)
