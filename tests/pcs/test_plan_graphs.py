"""The graph of a plan: its wires are the plan's, and what surrounds them is what section by section is said of it.

`expected` is derived a second time here, name by name, from the plan's JSON and the spec.
"""

import json
import random
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.objective import placement
from heronry_dg.plan import Plan
from heronry_dg.shipped import example_specs, shipped_spec_names, shipped_spec_path
from heronry_dg.situation import Situation, elements, situation
from heronry_manager.planner.exact import Planner
from heronry_manager.planner.greedy.planner import Greedy
from heronry_pcs.assessment import assess
from heronry_pcs.graph_files import document
from heronry_pcs.plan_graph import level_view, managers_side, plan_graph, sides_of
from heronry_pcs.plan_script import apply_to_plan, module_graph
from heronry_pcs.predicates import is_configuration
from heronry_pcs.script_difference import difference
from heronry_pcs.views import view_graph
from heronry_tools.analysis.control.cut import least_cut
from planner.random_specs import random_case
from thoroughness import IS_WHOLE, part_of, sample

SHIPPED = [load(shipped_spec_path(name)) for name in shipped_spec_names()] + [load(path) for path in example_specs()]


def planned(spec: Spec, now: Situation) -> Plan:
    return Greedy(spec).plan(now, None)


def wires_of(plan: dict[str, Any]) -> set[tuple[str, str]]:
    return {
        (f"{wire['producer']}.{wire['variable']}", f"{name}.{wire['variable']}:{path}")
        for name, one in plan["modules"].items()
        for path, wire in one["inputs"].items()
    }


def check_graph(spec: Spec, plan: Plan) -> None:
    """Compare the graph of a plan with the plan's own JSON."""
    graph = plan_graph(spec, plan.configuration)
    told = json.loads(plan.to_json())
    modules = set(told["modules"])
    between = {edge for edge in graph.edges if {end.split(".")[0] for end in edge} <= modules}
    assert between == wires_of(told)
    assert {name for name in graph.leaves if ":" not in name} == modules
    assert graph.vertices == graph.space
    for name, one in told["modules"].items():
        assert graph.leaves[name].image == f"{spec.modules[name].image}:{one['mode']}@{one['pe']}"
        assert name in graph.composites[f"pe:{one['pe']}"].components
    used = {spec.modules[name].device for name in modules} - {None}
    assert {name for name in graph.leaves if name.startswith("device:")} == {f"device:{name}" for name in used}
    assessed = assess(graph)
    assert assessed.holds("component_graph")
    assert assessed.holds("whole")
    assert assessed.holds("nested")
    assert assessed.holds("edge_contained")
    for level in ("pe", "side"):
        assert view_graph(graph, level_view(graph, level)).vertices == graph.vertices


@pytest.mark.parametrize("spec", SHIPPED, ids=lambda spec: spec.name)
def test_wires_of_plans_of_shipped_specs(spec: Spec) -> None:
    for down in ((), *((element,) for element in sample(elements(spec), 8))):
        check_graph(spec, planned(spec, situation(spec, down)))


@settings(max_examples=part_of(200, 10))
@given(st.integers(0, 2**32))
def test_wires_of_plans_of_random_specs(seed: int) -> None:
    case = random_case(random.Random(seed))
    check_graph(case.spec, planned(case.spec, case.now))


def pairs(spec: Spec, count: int) -> Iterator[tuple[Plan, Plan]]:
    """Draw pairs of plans as they fly: in `make soak` the best ones, otherwise those without a search."""
    rng = random.Random(spec.name)
    best = Planner(spec)
    for _ in range(count):
        old, new = (situation(spec, rng.sample(elements(spec), rng.randint(0, 2))) for _ in range(2))
        if IS_WHOLE:
            before = best.plan(old, effort=5.0)
            yield before, best.plan(new, placement(before.configuration), effort=5.0)
        else:
            yield planned(spec, old), planned(spec, new)


@pytest.mark.parametrize("spec", SHIPPED, ids=lambda spec: spec.name)
def test_the_difference_of_two_plans_leads_from_the_one_to_the_other(spec: Spec) -> None:
    for old, new in pairs(spec, part_of(100, 25)):
        text = difference(module_graph(spec, old.configuration), module_graph(spec, new.configuration))
        outcome = apply_to_plan(text, spec, new.now, old.configuration)
        assert outcome.errors == ()
        assert outcome.no_wires == ()
        assert outcome.configuration.modules == new.configuration.modules


SPEC = """\
dg: 1
buses:
  can0: {bitrate: 500000}
  radio: {bitrate: 100000, kind: wireless}
pes:
  nose: {node_id: 92, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}
  tail: {node_id: 93, buses: [can0, radio], cpu: 1, ram: 64KiB, flash: 64KiB}
  ground: {node_id: 94, buses: [radio], cpu: 1, ram: 64KiB, flash: 64KiB}
  spare: {node_id: 95, buses: [radio], cpu: 1, ram: 64KiB, flash: 64KiB}
devices:
  gauge: {kind: sensor, pe: nose}
  idle: {kind: sensor, pe: nose}
  valve: {kind: actuator, pe: tail}
variables:
  level: {type: FLOAT, versions: 2}
  demand: {type: FLOAT}
modules:
  gauge_driver:
    device: gauge
    modes:
      fine: {gives: {level: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 20}
      rough: {gives: {level: 2}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  control: {image: pid, needs: level, gives: {demand: 1}, runs_on: [nose, ground], cpu: 0.1, ram: 1KiB, rate_hz: 20}
  valve_driver: {device: valve, needs: {and: [demand]}, cpu: 0.1, ram: 1KiB, rate_hz: 20}
  clock: {runs_on: [tail], cpu: 0.1, ram: 1KiB, rate_hz: 1}
functions:
  filling: {output: valve_driver}
  ticking: {output: clock}
plants:
  tank: {moved_by: [valve], seen_by: [gauge, idle], affects: [room], criticality: A}
  room: {}
  moon: {}
"""


def small() -> tuple[Spec, Configuration]:
    spec = loads(SPEC, "small.dg.yaml")
    return spec, planned(spec, situation(spec)).configuration


def test_an_example_name_by_name() -> None:
    spec, configuration = small()
    graph = plan_graph(spec, configuration)
    assert {name: dict(leaf.ports) for name, leaf in graph.leaves.items()} == {
        "gauge_driver": {"level": (55 + 10 * 8) * 20_000, "device:": 0},
        "control": {"demand": (55 + 10 * 8) * 20_000, "level:": 0},
        "valve_driver": {"demand:0": 0, "device:": 0},
        "clock": {"none": 0},
        "device:gauge": {"module": 0, "world": 0},
        "device:valve": {"module": 0, "world": 0},
        "plant:tank": {"device:valve": 0, "device:gauge": 0, "device:idle": 0, "to:room": 0},
        "plant:room": {"from:tank": 0},
        "plant:moon": {"none": 0},
    }
    assert graph.edges == {
        ("gauge_driver.level", "control.level:"),
        ("control.demand", "valve_driver.demand:0"),
        ("device:gauge.module", "gauge_driver.device:"),
        ("valve_driver.device:", "device:valve.module"),
        ("device:valve.world", "plant:tank.device:valve"),
        ("plant:tank.device:gauge", "device:gauge.world"),
        ("plant:tank.to:room", "plant:room.from:tank"),
    }
    assert {name: set(part.components) for name, part in graph.composites.items()} == {
        "side:nose": {"gauge_driver", "control", "device:gauge", "valve_driver", "device:valve", "clock",
                      "pe:nose", "pe:tail"},
        "pe:nose": {"gauge_driver", "control", "device:gauge"},
        "pe:tail": {"valve_driver", "device:valve", "clock"},
    }  # fmt: skip
    assert {name: leaf.side for name, leaf in graph.leaves.items()} == {
        **dict.fromkeys(("gauge_driver", "valve_driver", "clock", "device:gauge", "device:valve"), "side:nose"),
        **dict.fromkeys(("control", "plant:tank", "plant:room", "plant:moon")),
    }
    assert {leaf.image for leaf in graph.leaves.values() if leaf.name == "control"} == {"pid:only@nose"}
    assert [name for name, leaf in graph.leaves.items() if leaf.plant] == ["plant:tank", "plant:room", "plant:moon"]


def test_sides_and_the_managers_side() -> None:
    spec, _ = small()
    assert sides_of(spec) == {"nose": "nose", "tail": "nose", "ground": "ground", "spare": "spare"}
    assert managers_side(spec) == "side:nose"


def test_a_plant_is_on_a_path_or_open() -> None:
    spec, configuration = small()
    facts = assess(plan_graph(spec, configuration)).document["components"]
    assert {name: one["on_path"] for name, one in facts.items() if "on_path" in one} == {
        "plant:tank": True,
        "plant:room": False,
        "plant:moon": False,
    }
    without = Configuration({name: one for name, one in configuration.modules.items() if name != "control"})
    inputs = {name: one for name, one in without.modules.items() if not one.inputs}
    assert assess(plan_graph(spec, Configuration(inputs))).document["components"]["plant:tank"]["on_path"] is False


def test_the_empty_plan_has_its_plants_alone() -> None:
    spec, _ = small()
    graph = plan_graph(spec, Configuration())
    assert sorted(graph.members) == ["plant:moon", "plant:room", "plant:tank"]
    assert not is_configuration(graph)


def tried(text: str) -> Any:
    spec, configuration = small()
    return apply_to_plan(text, spec, situation(spec), configuration)


REWIRED = """\
define control;
G.DeleteComponent ( control );
G.PruneEdges ();
control = G.CreateComponent ( "{image}" );
G.CreateEdge ( "gauge_driver.level", "control.level{path}" );
G.CreateEdge ( "control.demand", "valve_driver.demand" );
"""


@pytest.mark.parametrize("path", ["", ":"])
@pytest.mark.parametrize(
    ("image", "pe"), [("pid:only@ground", "ground"), ("pid@ground", "ground"), ("pid:only", "nose"), ("pid", "nose")]
)
def test_what_an_image_and_an_edge_may_leave_out(image: str, pe: str, path: str) -> None:
    outcome = tried(REWIRED.format(image=image, path=path))
    assert (outcome.errors, outcome.no_wires) == ((), ())
    assert outcome.configuration.modules["control"].pe == pe
    assert list(outcome.configuration.modules["valve_driver"].inputs) == ["0"]


@pytest.mark.parametrize("image", ["pid:only@tail", "pid:other", "control", "pid:"])
def test_an_image_that_the_space_lacks(image: str) -> None:
    assert [error.code for error in tried(REWIRED.format(image=image, path="")).errors] == ["PCS204"]


def test_the_best_mode_that_has_all_wires_told() -> None:
    text = "define gauge_driver;\nG.DeleteComponent ( gauge_driver );\nG.PruneEdges ();\n"
    text += 'gauge_driver = G.CreateComponent ( "gauge_driver" );\n'
    outcome = tried(text + 'G.CreateEdge ( "gauge_driver.level", "control.level" );')
    assert outcome.configuration.modules["gauge_driver"].mode == "fine"
    rough = tried(text.replace('( "gauge_driver" )', '( "gauge_driver:rough" )'))
    assert rough.configuration.modules["gauge_driver"].mode == "rough"
    assert [error.code for error in tried(text + 'G.CreateEdge ( "gauge_driver.x", "control.level" );').errors] == [
        "PCS204"
    ]


@pytest.mark.parametrize(
    "edge",
    [
        '"gauge_driver.level", "valve_driver.demand:0"',
        '"gauge_driver.device:", "control.level:"',
        '"control.level:", "valve_driver.demand:0"',
        '"clock.none", "valve_driver.device:"',
    ],
)
def test_an_edge_that_is_no_wire_is_told(edge: str) -> None:
    assert len(tried(f"G.CreateEdge ( {edge} );").no_wires) == 1


def test_edges_of_a_deleted_module_are_told_until_they_are_pruned() -> None:
    outcome = tried("define gauge_driver;\nG.DeleteComponent ( gauge_driver );")
    assert "gauge_driver" not in outcome.configuration.modules
    assert outcome.no_wires
    assert all(start.startswith("gauge_driver.") for start, _ in outcome.no_wires)
    pruned = tried("define gauge_driver;\nG.DeleteComponent ( gauge_driver );\nG.PruneEdges ();")
    assert pruned.no_wires == ()


def test_devices_and_plants_are_not_told() -> None:
    assert [error.code for error in tried('G.DeleteComponent ( "device:gauge" );').errors] == ["PCS201"]


def test_a_graph_of_a_plan_is_written_as_a_file() -> None:
    spec, configuration = small()
    found = document(plan_graph(spec, configuration))
    assert found["leaves"]["plant:tank"]["plant"] is True
    assert found["leaves"]["control"]["side"] is None
    assert found["components"]["pe:nose"]["edges"] == [
        ["device:gauge.module", "gauge_driver.device:"],
        ["gauge_driver.level", "control.level:"],
    ]


def test_the_cut_of_a_plan_of_two_sides() -> None:
    spec = load(shipped_spec_path("big_blue"))
    graph = plan_graph(spec, planned(spec, situation(spec)).configuration)
    cut = least_cut(graph, managers_side(spec))
    assert list(cut.sides) == ["side:flight", "side:ground"]
    assert cut.mbit_per_s > 0
