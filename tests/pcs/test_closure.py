"""What operations keep, on all configurations of up to four leaves with one port, and on random ones.

The paper claims more than holds: test_slips.py has a counterexample for each claim that is false.
"""

from collections.abc import Callable, Iterator
from itertools import combinations, product
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_pcs.graph import Edge, Graph, Leaf, Part, PcsError
from heronry_pcs.operations import add_edge, addition, combine, cprune, removal
from heronry_pcs.predicates import PREDICATES, is_configuration
from heronry_pcs.views import contract, expand, view_graph
from pcs.drawn_graphs import as_graph, drawn, drawn_configuration, drawn_view
from thoroughness import part_of, sample

SEEDS = st.integers(0, 2**32)
ALL_BUT_CONNECTED = tuple(name for name in PREDICATES if name not in ("component_connected", "configuration"))


def graph_of(leaves: str, edges: frozenset[Edge], outside: str = "") -> Graph:
    """A graph of leaves with one port `p`; those outside are in the space alone."""
    space = {name: Leaf(name, {"p": 1}, name) for name in leaves + outside}
    return Graph("g", space, {}, Part(frozenset(f"{name}.p" for name in leaves), edges, frozenset(leaves)))


def small_configurations() -> Iterator[Graph]:
    """All configurations of up to four leaves with one port, and one more leaf in the space."""
    for size in (1, 2, 3, 4):
        leaves = "ABCD"[:size]
        pairs = [(f"{a}.p", f"{b}.p") for a, b in product(leaves, leaves) if a != b]
        for count in range(len(pairs) + 1):
            for edges in combinations(pairs, count):
                graph = graph_of(leaves, frozenset(edges), "Z")
                if is_configuration(graph):
                    yield graph


SMALL = list(small_configurations())


def held(graph: Graph, names: tuple[str, ...] = tuple(PREDICATES)) -> set[str]:
    return {name for name in names if PREDICATES[name](graph)}


def tried(operation: Callable[[Graph, Edge], Graph], graph: Graph, edge: Edge) -> Graph | str:
    """What an operation gives, or the name of its error."""
    try:
        return operation(graph, edge)
    except PcsError as error:
        return error.error


def assert_closed(graph: Graph, edges: list[Edge]) -> None:
    """What section 2.3 promises, for each of some edges."""
    assert cprune(graph) == graph, "a connected graph has nothing to prune"
    for edge in edges:
        less = removal(graph, [edge])
        assert held(less) >= set(ALL_BUT_CONNECTED)
        assert is_configuration(less) == PREDICATES["component_connected"](less)
        for operation in (addition, add_edge):
            more = tried(operation, graph, edge)
            assert (
                more in ("edge_outside", "edge_inside", "edge_apart")
                if isinstance(more, str)
                else is_configuration(more)
            )


def test_there_are_as_many_small_configurations_as_connected_digraphs() -> None:
    """Weakly connected labelled digraphs of 1 to 4 nodes: 1, 3, 54 and 3 834 (OEIS A003027)."""
    counts = [sum(len(graph.members) == size for graph in SMALL) for size in (1, 2, 3, 4)]
    assert counts == [1, 3, 54, 3834]


def test_small_configurations_stay_configurations() -> None:
    for graph in sample(SMALL, 40):
        vertices = sorted(graph.space)
        assert_closed(graph, list(product(vertices, vertices)))


@settings(max_examples=part_of(2000, 20))
@given(SEEDS)
def test_random_configurations_stay_configurations(seed: int) -> None:
    rng = Random(seed)
    graph = as_graph(drawn_configuration(rng))
    vertices = sorted(graph.space)
    assert_closed(graph, [(rng.choice(vertices), rng.choice(vertices)) for _ in range(4)])


@settings(max_examples=part_of(2000, 20))
@given(SEEDS)
def test_combined_configurations_that_share_nothing_are_one(seed: int) -> None:
    rng = Random(seed)
    one, other = as_graph(drawn_configuration(rng)), as_graph(drawn_configuration(rng, "PQRSTUV"))
    if "K" in one.composites and "K" in other.composites:
        return
    joined = combine(one, other, (min(one.vertices), min(other.vertices)))
    assert is_configuration(joined)
    apart = combine(one, other)
    assert {"component_graph", "edge_contained"} <= held(apart)
    assert not is_configuration(apart)


@settings(max_examples=part_of(2000, 10))
@given(SEEDS)
def test_contraction_and_expansion_keep_what_they_should(seed: int) -> None:
    rng = Random(seed)
    g = drawn(rng)
    model, view = as_graph(g), drawn_view(rng, g)
    for name in [*sorted(g["leaves"]), *sorted(g["components"])]:
        for operation, lost in ((contract, ()), (expand, ("component_connected", "configuration"))):
            try:
                after = operation(model, view, name)
            except PcsError:
                continue
            before = held(view_graph(model, view))
            assert before - set(lost) <= held(view_graph(*after)), operation


@pytest.mark.parametrize("parts", [{"A", "B"}, {"C"}])
def test_a_contraction_to_a_new_composite_changes_the_model_by_that_alone(parts: set[str]) -> None:
    graph = graph_of("ABC", frozenset({("A.p", "B.p"), ("B.p", "C.p")}))
    model, view = contract(graph, set("ABC"), "K", parts)
    assert model.own.components == graph.own.components | {"K"}
    assert (model.vertices, model.edges) == (graph.vertices, graph.edges)
    assert view == set("ABC") - parts | {"K"}
