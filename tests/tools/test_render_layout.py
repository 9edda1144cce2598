"""The places in a picture: no symbol on another, no edge through a symbol, every edge to the right."""

import random
from collections import Counter
from itertools import combinations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation
from heronry_tools.reports.render.build import build
from heronry_tools.reports.render.graph import Edge, Graph, Node
from heronry_tools.reports.render.layout import Box, Layout, Point, laid_out
from heronry_tools.reports.render.marks import marks
from heronry_tools.reports.render.ranks import ranked
from heronry_tools.reports.render.shapes import wrapped
from heronry_tools.reports.render.sheets import sheets
from planner.random_specs import random_spec
from thoroughness import part_of

SHIPPED = ("elevator_and_chute", "big_blue")


def graph_of(spec: Spec) -> Graph:
    return build(spec, marks(spec, situation(spec)))


def shipped(name: str) -> Graph:
    return graph_of(load(shipped_spec_path(name)))


def overlapping(layout: Layout) -> list[tuple[str, str]]:
    return [
        (a, b)
        for (a, one), (b, other) in combinations(layout.boxes.items(), 2)
        if one.x < other.x + other.shape.width
        and other.x < one.x + one.shape.width
        and one.y < other.y + other.shape.height
        and other.y < one.y + one.shape.height
    ]


def outside(layout: Layout) -> list[str]:
    return [
        key
        for key, box in layout.boxes.items()
        if box.x < 0 or box.y < 0 or box.x + box.shape.width > layout.width or box.y + box.shape.height > layout.height
    ]


def crossed(layout: Layout, graph: Graph) -> list[tuple[Edge, str]]:
    """Edges with a box under them that is not at one of their ends."""
    pieces: list[tuple[int, Point, Point]] = []
    for curve in layout.curves:
        ways = ((curve.start, curve.leave), (curve.leave, curve.enter), (curve.enter, curve.end))
        pieces += [(curve.edges[0], a, b) for a, b in ways]
    for loop in layout.loops:
        pieces += [(loop.edge, a, b) for a, b in zip(loop.points, loop.points[1:], strict=False)]
    return [
        (graph.edges[number], key)
        for number, a, b in pieces
        for key, box in layout.boxes.items()
        if key not in (graph.edges[number].source, graph.edges[number].target) and touches(box, a, b)
    ]


def touches(box: Box, a: Point, b: Point) -> bool:
    """Whether the rectangle that a piece may fill reaches into a box: a curve stays within that of its ends."""
    return (
        box.x < max(a[0], b[0])
        and min(a[0], b[0]) < box.x + box.shape.width
        and box.y <= max(a[1], b[1])
        and min(a[1], b[1]) <= box.y + box.shape.height
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_graph_has_no_symbol_on_another_and_no_edge_through_one(name: str) -> None:
    graph = shipped(name)
    layout = laid_out(graph)
    assert overlapping(layout) == []
    assert outside(layout) == []
    assert crossed(layout, graph) == []


def test_a_wide_graph_is_broken_into_sheets_that_fit_a_screen() -> None:
    graph = shipped("big_blue")
    assert laid_out(graph).width > 4000
    drawn = sheets(graph)
    assert all(sheet.layout.width <= 2000 for sheet in drawn)
    for sheet in drawn:
        assert overlapping(sheet.layout) == []
        assert outside(sheet.layout) == []
        assert crossed(sheet.layout, sheet.graph) == []


def test_on_the_sheets_everything_is_there_once_and_a_variable_again_where_it_is_read() -> None:
    graph = shipped("big_blue")
    drawn = sheets(graph)
    itself = Counter(key for sheet in drawn for key, node in sheet.graph.nodes.items() if not node.again)
    assert itself == Counter(graph.nodes.keys())
    assert Counter(edge for sheet in drawn for edge in sheet.graph.edges) == Counter(graph.edges)
    again = {key for sheet in drawn for key, node in sheet.graph.nodes.items() if node.again}
    assert again
    assert all(key.startswith("variable:") for key in again)


def test_a_long_chain_is_cut_between_its_variables_and_what_stands_alone_is_on_one_sheet() -> None:
    nodes, edges = dict[str, Node](), list[Edge]()
    for number in range(20):
        module, variable = f"module:m{number}", f"variable:v{number}"
        nodes |= {module: Node(module, "module", f"m{number}"), variable: Node(variable, "variable", f"v{number}", "1")}
        edges.append(Edge(module, variable))
        if number:
            edges.append(Edge(f"variable:v{number - 1}", module))
    alone = {
        "variable:lone": Node("variable:lone", "variable", "lone", "1"),
        "device:d": Node("device:d", "sensor", "d"),
    }
    first, *rest = sheets(Graph("chain", nodes | alone, tuple(edges)))
    assert rest
    assert not any(node.again for node in first.graph.nodes.values())
    for before, after in zip([first, *rest], rest, strict=False):
        (again,) = (key for key, node in after.graph.nodes.items() if node.again)
        assert again in before.graph.nodes
    assert [sum(key in sheet.graph.nodes for sheet in (first, *rest)) for key in alone] == [1, 1]


def test_a_graph_that_is_not_wide_stays_in_one_piece() -> None:
    (sheet,) = sheets(shipped("elevator_and_chute"))
    assert sheet.graph == shipped("elevator_and_chute")


@settings(max_examples=part_of(60))
@given(st.randoms(use_true_random=False))
def test_a_random_graph_has_none_either(rng: random.Random) -> None:
    graph = graph_of(random_spec(rng))
    layout = laid_out(graph)
    assert set(layout.boxes) == set(graph.nodes)
    assert overlapping(layout) == []
    assert outside(layout) == []
    assert crossed(layout, graph) == []
    drawn = [number for curve in layout.curves if curve.last for number in curve.edges]
    assert sorted(drawn + [loop.edge for loop in layout.loops]) == list(range(len(graph.edges)))


@settings(max_examples=part_of(60))
@given(st.randoms(use_true_random=False))
def test_data_flows_to_the_right_but_for_feedback_out_of_variables_that_start_with_a_value(rng: random.Random) -> None:
    graph = graph_of(random_spec(rng))
    ranks = ranked(graph)
    for number, edge in enumerate(graph.edges):
        if number in ranks.feedback:
            assert graph.nodes[edge.source].initial
        else:
            assert ranks.of[edge.source] < ranks.of[edge.target]


@pytest.mark.parametrize("name", SHIPPED)
def test_sensors_stand_at_the_left_and_actuators_at_the_right(name: str) -> None:
    graph = shipped(name)
    ranks = ranked(graph)
    last = max(ranks.of.values())
    assert {ranks.of[key] for key, node in graph.nodes.items() if node.kind == "sensor"} == {0}
    assert {ranks.of[key] for key, node in graph.nodes.items() if node.kind == "actuator"} == {last}


def test_only_what_closes_a_cycle_is_feedback() -> None:
    nodes = {f"module:{name}": Node(f"module:{name}", "module", name) for name in "abc"}
    nodes["variable:on"] = Node("variable:on", "variable", "on")
    nodes["variable:back"] = Node("variable:back", "variable", "back", initial=True)
    edges = (
        Edge("module:a", "variable:on"),
        Edge("variable:on", "module:b"),
        Edge("module:b", "variable:back"),
        Edge("variable:back", "module:a"),
        Edge("variable:back", "module:c"),
    )
    assert ranked(Graph("loop", nodes, edges)).feedback == {3}


def test_big_blue_feeds_back_what_it_says_it_does() -> None:
    graph = shipped("big_blue")
    sources = {graph.edges[number].source for number in ranked(graph).feedback}
    assert sources <= {"variable:servo_health", "variable:wing_state"}
    assert sources


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("gps", ("gps",)),
        ("elevator_servo_1", ("elevator_servo_1",)),
        ("longitudinal_acceleration", ("longitudinal_", "acceleration")),
        ("a" * 30, ("a" * 30,)),
        ("", ()),
    ],
)
def test_long_names_are_broken_where_their_words_end(name: str, lines: tuple[str, ...]) -> None:
    assert wrapped(name, "_") == lines


def test_a_long_edge_with_room_keeps_its_height_until_its_end() -> None:
    graph = shipped("elevator_and_chute")
    long = [
        curve for curve in laid_out(graph).curves if graph.edges[curve.edges[0]].source == "variable:release_command"
    ]
    assert len(long) > 4
    assert len({curve.start[1] for curve in long}) == 1
    assert [curve.last for curve in long if curve.leave[1] != curve.enter[1]] == [True]
