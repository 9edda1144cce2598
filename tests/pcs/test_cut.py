"""The least cut agrees with trying every partition, and keeps most leaves on the first side."""

from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pcs.reference as ref
from heronry_pcs.graph import Graph, Leaf, Part, PcsError
from heronry_pcs.graph_files import load_graph
from heronry_tools.analysis.control.cut import least_cut
from pcs.drawn_graphs import as_graph, drawn
from thoroughness import part_of


@settings(max_examples=part_of(2000, 10))
@given(st.integers(0, 2**32))
def test_the_cut_is_the_one_that_trying_finds(seed: int) -> None:
    rng = Random(seed)
    g = drawn(rng)
    first = rng.choice([None, "left", "right", "middle"])
    try:
        expected = ref.cut(g, first)
    except ref.Refused:
        with pytest.raises(PcsError, match="two sides"):
            least_cut(as_graph(g), first)
        return
    found = least_cut(as_graph(g), first)
    assert (found.mbit_per_s, dict(found.sides)) == expected
    assert list(found.sides) == list(expected[1])


def chain(weights: list[int]) -> Graph:
    """A0 on the left feeds A1 feeds A2 ... on the right, each port of its weight."""
    last = len(weights)
    sides = {0: "left", last: "right"}
    leaves = {f"A{n}": Leaf(f"A{n}", {"p": [*weights, 0][n]}, "x", side=sides.get(n)) for n in range(last + 1)}
    edges = frozenset((f"A{n}.p", f"A{n + 1}.p") for n in range(last))
    return Graph("g", leaves, {}, Part(frozenset(f"{name}.p" for name in leaves), edges, frozenset(leaves)))


def test_of_several_cuts_the_first_side_keeps_most() -> None:
    assert least_cut(chain([3, 2, 2, 5])).sides == {"left": ["A0", "A1", "A2"], "right": ["A3", "A4"]}
    assert least_cut(chain([3, 2, 2, 5]), "right").sides == {"right": ["A2", "A3", "A4"], "left": ["A0", "A1"]}


def test_a_port_costs_its_weight_once() -> None:
    graph = chain([3])
    more = Leaf("B", {"p": 0}, "x", side="right")
    both = Graph("g", {**graph.leaves, "B": more}, {}, Part(
        graph.vertices | {"B.p"}, graph.edges | {("A0.p", "B.p")}, graph.own.components | {"B"}
    ))  # fmt: skip
    assert least_cut(both).mbit_per_s == 3


def test_a_cut_needs_two_sides() -> None:
    with pytest.raises(PcsError, match="exactly two sides"):
        least_cut(chain([]))


def test_the_cut_of_g_star_brings_the_filter_to_the_aircraft() -> None:
    """Section 3.4: during the minimum cut, K_ekf was moved to the UAV system partition."""
    cut = least_cut(load_graph(Path("dg_specs/polymorphic/g_star.pcs.yaml")))
    assert "Kekf" in cut.sides["uav"]
    assert {"Kcam", "Kvis", "Ktf"} <= set(cut.sides["ugv"])
    assert cut.mbit_per_s == 950_000, "the result of the vision alone crosses the radio"
