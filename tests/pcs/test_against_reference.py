"""The library and the reference agree on every predicate, operation and error, on random graphs."""

from collections import Counter
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pcs.reference as ref
from heronry_pcs import operations, views
from heronry_pcs.assessment import assess
from heronry_pcs.cycles import cycles
from heronry_pcs.graph import Graph, PcsError
from heronry_pcs.loops import home, loops
from heronry_pcs.predicates import PREDICATES, broken
from heronry_tools.analysis.control.longest_cycle import longest_cycle
from pcs.drawn_graphs import answer, as_graph, as_reference, drawn, drawn_configuration, drawn_view
from thoroughness import IS_WHOLE, part_of

GRAPHS = part_of(2000, 10)
SEEDS = st.integers(0, 2**32)


def ours(operation: Any, *arguments: Any) -> Any:
    """What the library gives, as the reference has it, or the name of its error."""
    try:
        result = operation(*arguments)
    except PcsError as error:
        return error.error
    if isinstance(result, Graph):
        return as_reference(result)
    model, view = result
    return as_reference(model), view


def some_graph(rng: Random) -> ref.G:
    return drawn_configuration(rng) if rng.random() < 0.4 else drawn(rng)


@settings(max_examples=GRAPHS)
@given(SEEDS)
def test_predicates_relations_and_loops(seed: int) -> None:
    g = drawn(Random(seed))
    assert_alike(g)


@settings(max_examples=part_of(1000, 10))
@given(SEEDS)
def test_predicates_of_configurations(seed: int) -> None:
    assert_alike(drawn_configuration(Random(seed)))


def assert_alike(g: ref.G) -> None:
    graph = as_graph(g)
    for name, holds in PREDICATES.items():
        assert holds(graph) == ref.PREDICATES[name](g), name
    assert broken(graph) == ref.broken(g)
    found = cycles(graph, longest_cycle)
    assert found.longest == (ref.longest_cycle(g),) * 2
    assert found.cycle_bound == ref.cycle_bound(g)
    quick = cycles(graph)
    assert quick.cycle_bound in (None, found.cycle_bound)
    assert quick.longest[0] <= found.longest[0] <= quick.longest[1]
    for vertex in ref.space_vertices(g):
        assert home(graph, vertex) == ref.home(g, vertex)
    assessed = assess(graph, search=longest_cycle).document["components"]
    below = ref.subsumes(g)
    for k in ref.members(g):
        assert assessed[k]["neighbors"] == [one for one in ref.members(g) if ref.neighbors(g, k, one)]
        assert assessed[k]["subsumes"] == sorted(b for a, b in below if a == k and b in graph.members)
        assert assessed[k]["controllable"] == ref.controllable(g, k)
        assert assessed[k]["observable"] == ref.observable(g, k)
        assert assessed[k]["on_loop"] == ref.on_loop(g, k)
        assert assessed[k].get("on_path") == (ref.on_path(g, k) if ref.is_plant(g, k) else None)
    for size in (1, 2, 3):
        names = ref.members(g)[:size]
        parts = [graph.members[name].vertices for name in names]
        assert loops(graph).join(parts) == ref.control_path(g, names)


def operations_of(rng: Random) -> list[tuple[str, Any, Any]]:
    """One drawing of every operation: its name, what the library gives, and what the reference gives."""
    g, h = some_graph(rng), some_graph(rng) if rng.random() < 0.4 else drawn(rng, "PQRSTUVW")
    if rng.random() < 0.3:
        h = {**h, "leaves": {**h["leaves"], **g["leaves"]}}
        h["components"] = {**h["components"], **(g["components"] if rng.random() < 0.5 else {})}
    graph, other = as_graph(g), as_graph(h)
    space = [*sorted(ref.space_vertices(g)), *sorted(ref.space_vertices(g)), "Z.z", "A.z"]
    both = [*space, *sorted(ref.space_vertices(h)), *sorted(ref.space_vertices(h))]
    e = (rng.choice(space), rng.choice(space))
    between = rng.choice([None, (rng.choice(both), rng.choice(both))])
    gone = set(rng.sample(sorted(g["graph"][1]), rng.randint(0, len(g["graph"][1])))) | {e}
    return [
        ("cprune", ours(operations.cprune, graph), answer(ref.cprune, g)),
        ("combine", ours(operations.combine, graph, other, between), answer(ref.combine, g, h, between)),
        ("removal", ours(operations.removal, graph, gone), answer(ref.removal, g, gone)),
        ("addition", ours(operations.addition, graph, e), answer(ref.addition, g, e)),
        ("add_edge", ours(operations.add_edge, graph, e), answer(ref.add_edge, g, e)),
        *views_of(rng),
    ]


def views_of(rng: Random) -> list[tuple[str, Any, Any]]:
    g = drawn(rng)
    graph, view = as_graph(g), drawn_view(rng, g)
    k = rng.choice([*g["leaves"], *g["components"], *g["components"], "Z"])
    parts = set(rng.sample(sorted(view), rng.randint(0, len(view))))
    return [
        ("view", ours(views.view_graph, graph, view), answer(ref.seen, g, view)),
        ("contract", ours(views.contract, graph, view, k), answer(ref.contract, g, view, k)),
        ("expand", ours(views.expand, graph, view, k), answer(ref.expand, g, view, k)),
        *(
            ("contract to", ours(views.contract, graph, view, name, parts), answer(ref.contract, g, view, name, parts))
            for name in (k, "N")
        ),
    ]


@settings(max_examples=GRAPHS)
@given(SEEDS)
def test_operations_and_views(seed: int) -> None:
    for name, found, expected in operations_of(Random(seed)):
        assert found == expected, name


EVERY_ERROR = {
    "cprune": {"needs:component_graph", "needs:disjoint", "needs:pruned", ""},
    "combine": {"needs:component_graph", "needs:vertex", "clash", "unknown", "edge_apart", ""},
    "removal": {"needs:configuration", "unknown", ""},
    "addition": {"needs:configuration", "unknown", "edge_outside", "edge_inside", ""},
    "add_edge": {"needs:configuration", "unknown", "edge_apart", ""},
    "view": {"needs:component_graph", "needs:whole", "needs:nested", "unknown", "view", ""},
    "contract": {
        "needs:component_graph", "needs:whole", "needs:nested", "unknown", "view", "contracted", "",
    },
    "expand": {
        "needs:component_graph", "needs:whole", "needs:nested", "unknown", "view", "leaf", "uncovered", "",
    },
    "contract to": {
        "needs:component_graph", "needs:whole", "needs:nested", "unknown", "view", "clash", "",
    },
}  # fmt: skip


def kind_of(result: Any) -> str:
    if not isinstance(result, str):
        return ""
    return result if result.startswith("needs:") else result.partition(":")[0]


def test_drawings_reach_both_sides_of_every_predicate_and_every_error() -> None:
    """In the whole run each predicate is true and false at least fifty times; in a part of it, once."""
    truths: Counter[tuple[str, bool]] = Counter()
    errors: Counter[tuple[str, str]] = Counter()
    for seed in range(GRAPHS):
        g = some_graph(Random(seed))
        truths.update((name, holds(g)) for name, holds in ref.PREDICATES.items())
        truths.update((name, False) for name in {one for some in ref.broken(g).values() for one in some})
        errors.update((name, kind_of(result)) for name, _, result in operations_of(Random(seed)))
    least = 50 if IS_WHOLE else 1
    assert {one: count for one in truths if (count := truths[one]) < least} == {}
    assert {truth for truth in truths if truth[0] in ref.PREDICATES} == {
        (name, value) for name in ref.PREDICATES for value in (True, False)
    }
    assert {name for name, _ in truths} == {*ref.PREDICATES, *ref.CONDITIONS}
    if IS_WHOLE:
        assert {(name, kind) for name, kinds in EVERY_ERROR.items() for kind in kinds} == set(errors)


def test_a_composite_made_of_what_overlaps_another_one_is_refused() -> None:
    """The one error of a contraction that needs a special drawing: parts that another member cuts through."""
    g = drawn_leaves("ABC")
    g["components"]["K"] = (frozenset({"A.a", "B.a"}), frozenset(), frozenset("AB"))
    g["graph"] = (g["graph"][0], g["graph"][1], frozenset("ABCK"))
    found = ours(views.contract, as_graph(g), set("ABC"), "N", set("BC"))
    assert found == answer(ref.contract, g, set("ABC"), "N", set("BC")) == "needs:nested"


def test_a_new_composite_gives_its_edges_to_what_holds_all_of_its_parts() -> None:
    g = drawn_leaves("ABC")
    edges = frozenset({("A.a", "B.a")})
    g["components"]["K"] = (g["graph"][0], frozenset(), frozenset("ABC"))
    g["graph"] = (g["graph"][0], edges, frozenset("ABCK"))
    model, _ = ours(views.contract, as_graph(g), set("ABC"), "N", set("AB"))
    assert (model, set("CN")) == answer(ref.contract, g, set("ABC"), "N", set("AB"))
    assert model["components"]["K"][1] == edges


def test_a_leaf_and_a_composite_of_one_name_clash_after_leaves() -> None:
    g, h = drawn_leaves("AB"), drawn_leaves("BC")
    g["components"]["C"] = (frozenset({"A.a"}), frozenset(), frozenset("A"))
    for one, two in ((g, h), (h, g)):
        found = ours(operations.combine, as_graph(one), as_graph(two), None)
        assert found == answer(ref.combine, one, two, None) == "clash:C"
    h["leaves"]["B"]["image"] = "y"
    assert ours(operations.combine, as_graph(g), as_graph(h), None) == "clash:B"


def test_the_empty_graph_is_no_configuration() -> None:
    empty = Graph("g", {})
    assert {name: holds(empty) for name, holds in PREDICATES.items()} == {
        **dict.fromkeys(PREDICATES, True),
        "configuration": False,
    }


def test_a_ring_needs_no_search() -> None:
    g = drawn_leaves("ABCDEFG")
    ring = frozenset((f"{a}.a", f"{b}.a") for a, b in zip("ABCDEFG", "BCDEFGA", strict=True))
    g["graph"] = (g["graph"][0], ring, g["graph"][2])
    assert cycles(as_graph(g)).longest == (7, 7)


def drawn_leaves(names: str) -> ref.G:
    leaf = {"ports": {"a": 0}, "image": "x", "plant": False, "side": None}
    g: ref.G = {"leaves": {name: dict(leaf) for name in names}, "components": {}, "graph": None}
    g["graph"] = (ref.space_vertices(g), frozenset(), frozenset(names))
    return g


@pytest.mark.parametrize("seed", range(3))
def test_the_reference_finds_component_paths_by_enumeration(seed: int) -> None:
    """The reference's own short cut for connectedness: the same as joining every two members by a path."""
    rng = Random(seed)
    for _ in range(20):
        g = drawn(rng)
        names = ref.members(g)[:5]
        g["graph"] = (g["graph"][0], g["graph"][1], frozenset(names))
        joined = all(ref.joined(g, a, b) for a in names for b in names if a < b)
        assert joined == ref.component_connected(g)
