"""Scripts: every error where it stands, what operations do, and the difference of two graphs as a script."""

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_pcs.graph import Graph, Leaf, Part, PcsError
from heronry_pcs.script import interpret
from heronry_pcs.script_difference import difference
from pcs.drawn_graphs import as_graph, drawn
from thoroughness import part_of


def small_graph() -> Graph:
    """A and B in the composite K, which is in L with C; D alone in the space; A feeds B, B feeds C."""
    space = {name: Leaf(name, {"p": 1, "q.0": 1}, f"{name}.dll") for name in "ABCD"}
    ports = {name: space[name].vertices() for name in space}
    edges = frozenset({("A.p", "B.p"), ("B.p", "C.p")})
    k = Part(ports["A"] | ports["B"], frozenset({("A.p", "B.p")}), frozenset("AB"))
    everything = ports["A"] | ports["B"] | ports["C"]
    inner = Part(everything, edges, frozenset("ABCK"))
    return Graph("g", space, {"K": k, "L": inner}, Part(everything, edges, frozenset("ABCKL")))


def errors_of(text: str) -> list[str]:
    outcome = interpret(text, small_graph())
    if outcome.errors:
        assert outcome.after == small_graph(), "with an error nothing is done at all"
    return [f"{error.line}:{error.column} {error.code[3:]}" for error in outcome.errors]


@pytest.mark.parametrize(
    ("text", "errors"),
    [
        ("", []),
        ("// nothing\n", []),
        ("G.PruneEdges();", []),
        ("G . PruneEdges ( ) ; // a comment; and more", []),
        ("G.PruneEdges()", ["1:15 101"]),
        ("G.PruneEdges()\n", ["2:1 101"]),
        ("G.PruneEdges(1);", ["1:14 101"]),
        ('G.PruneEdges("A");', ["1:14 101"]),
        ("G.CreateEdge(A, B);", ["1:14 101"]),
        ('G.CreateEdge("A.p");', ["1:19 101"]),
        ('G.CreateEdge("A.p",\nG.PruneEdges();\n', ["2:1 101"]),
        ('G.CreateEdge("A.p\n", "B");', ["1:14 101"]),
        (") ; G.PruneEdges();", ["1:1 101"]),
        ("define;\ndefine x;", ["1:7 101"]),
        ("define\ndefine x;", ["2:8 101"]),
        ("define x", ["1:9 101"]),
        ("G.\nG.PruneEdges();", ["2:1 102"]),
        ("x y;\nG PruneEdges();", ["1:3 101", "2:3 101"]),
        ("G.Explode();", ["1:3 102"]),
        ('G.explode("A");G.PruneEdges();', ["1:3 102"]),
        ("G.PruneEdges();\nH.PruneEdges();", ["2:0 103"]),
        ("A.PruneEdges();\nG.PruneEdges();", ["1:0 103"]),
        ("L.PruneEdges();", ["1:0 103"]),
        ("D.PruneEdges();", ["1:0 103"]),
        ("define x;\nx.PruneEdges();", ["2:0 103"]),
        ('D = G.CreateComponent("D.dll");', ["1:0 104"]),
        ("define D;\ndefine D;", ["2:0 104"]),
        ("define D;\nD = G.PruneEdges();", ["2:0 104"]),
        ('G.CreateComponent("D.dll");', ["1:0 104"]),
        ('define A;\nA = G.CreateComponent("A.dll");', ["2:0 203"]),
        ('define D;\nD = G.CreateComponent("A.dll");', ["2:0 204"]),
        ('define E;\nE = G.CreateComponent("E.dll");', ["2:0 204"]),
        ("G.DeleteComponent(D);", ["1:0 201"]),
        ("G.DeleteComponent(A);\nG.DeleteComponent(A);", ["2:0 207"]),
        ("G.DeleteComponent(K);\nG.DeleteComponent(A);", ["2:0 207"]),
        ('G.CreateEdge("A.p", "C.p");', []),
        ('G.CreateEdge("A.q.0", "C.q.0");', []),
        ('G.CreateEdge("D.p", "E.p");', ["1:0 201", "1:0 201"]),
        ('G.CreateEdge("K.p", "C.p");', ["1:0 201"]),
        ('G.CreateEdge("A.x", "C");', ["1:0 202", "1:0 202"]),
        ('G.CreateEdge("A.p", "B.p");', ["1:0 205"]),
        ('G.CreateEdge("A.p", "A.q.0");', ["1:0 208"]),
        ('G.CreateEdge("A.p", "A.x");', ["1:0 202"]),
        ('G.DeleteEdge("A.p", "C.p");', ["1:0 206"]),
        ('G.DeleteEdge("A.p", "B.p");\nG.DeleteEdge("A.p", "B.p");', ["2:0 206"]),
        ('G.DeleteComponent("A");\nG.CreateEdge("A.x", "C.x");', ["2:0 207", "2:0 202"]),
        ('D = G.CreateComponent("D.dll");\nG.CreateEdge("D.p", "C.x");\nG.DeleteComponent(D);', ["1:0 104", "2:0 202"]),
        ('define D;\nD = G.CreateComponent("x");\nG.CreateEdge("D.p", "E.p");', ["2:0 204", "3:0 201"]),
        ('define C;\nC = G.PruneEdges();\nG.DeleteEdge("B.p", "C.p");\nG.DeleteEdge("B.p", "C.p");', ["2:0 104"]),
        ('define D;\nD = G.CreateComponent("x");\nD = G.CreateComponent("D.dll");\nG.DeleteEdge("D.p", "C.p");',
         ["2:0 204", "4:0 206"]),
    ],
)  # fmt: skip
def test_errors_and_their_places(text: str, errors: list[str]) -> None:
    assert errors_of(text) == errors


def after(text: str) -> Graph:
    outcome = interpret(text, small_graph())
    assert outcome.errors == ()
    return outcome.after


def test_a_deleted_component_goes_from_all_composites() -> None:
    graph = after("G.DeleteComponent(A);")
    assert graph.own.components == set("BCKL")
    assert graph.vertices == {"B.p", "B.q.0", "C.p", "C.q.0"}
    assert graph.composites["K"] == Part(frozenset({"B.p", "B.q.0"}), frozenset(), frozenset("B"))
    assert ("A.p", "B.p") in graph.edges, "edges stay until PruneEdges"
    assert after("G.DeleteComponent(A);\nG.PruneEdges();").edges == {("B.p", "C.p")}


def test_a_composite_goes_with_all_that_is_in_it_and_one_left_without_vertices_goes() -> None:
    assert after("G.DeleteComponent(K);").own.components == set("CL")
    graph = after("G.DeleteComponent(A);\nG.DeleteComponent(B);")
    assert graph.own.components == set("CL")
    assert list(graph.composites) == ["L"]
    assert graph.composites["L"].components == {"C"}
    assert errors_of("G.DeleteComponent(A);\nG.DeleteComponent(B);\nG.DeleteComponent(K);") == ["3:0 207"]


def test_a_created_leaf_joins_no_composite_and_may_come_back() -> None:
    graph = after('define D;\nD = G.CreateComponent("D.dll");\nG.CreateEdge("C.p", "D.p");')
    assert graph.own.components == set("ABCDKL")
    assert "D" not in graph.composites["L"].components
    again = after('define A;\nG.DeleteComponent(A);\nA = G.CreateComponent("A.dll");\nG.CreateEdge("A.p", "C.p");')
    assert "A" in again.own.components
    assert "A" not in again.composites["K"].components


def test_edges_of_composites_are_those_of_the_graph_inside_them() -> None:
    graph = after('G.CreateEdge("B.p", "A.p");\nG.DeleteEdge("B.p", "C.p");')
    assert graph.composites["K"].edges == graph.composites["L"].edges == {("A.p", "B.p"), ("B.p", "A.p")}


def test_statements_count_those_that_could_be_read() -> None:
    outcome = interpret("define D;\nG.Explode();\nG.PruneEdges(;\nG.DeleteComponent(Z);", small_graph())
    assert outcome.statements == 2
    assert [error.code for error in outcome.errors] == ["PCS102", "PCS101", "PCS201"]


@given(st.text(alphabet='G.=;,()"/ \nAdefinCreateComponentEdge'), st.text())
def test_no_text_makes_the_interpreter_fail(text: str, other: str) -> None:
    for one in (text, other, text + other):
        interpret(one, small_graph())


def drawn_pair(rng: Random) -> tuple[Graph, Graph]:
    """Two graphs in one space, each of some of its leaves, without edges inside a leaf."""
    space = as_graph(drawn(rng, "ABCDEF")).leaves

    def one() -> Graph:
        names = [name for name in space if rng.random() < 0.7]
        vertices = sorted(vertex for name in names for vertex in space[name].vertices())
        pairs = [(rng.choice(vertices), rng.choice(vertices)) for _ in range(len(vertices))] if vertices else []
        edges = frozenset(pair for pair in pairs if pair[0][0] != pair[1][0])
        return Graph("g", space, {}, Part(frozenset(vertices), edges, frozenset(names)))

    return one(), one()


@settings(max_examples=part_of(2000, 20))
@given(st.integers(0, 2**32))
def test_the_difference_leads_from_the_one_to_the_other(seed: int) -> None:
    old, new = drawn_pair(Random(seed))
    outcome = interpret(difference(old, new), old)
    assert outcome.errors == ()
    assert outcome.after == new
    assert difference(new, new) == ""


def test_the_form_of_a_difference() -> None:
    space = {name: Leaf(name, {"p": 0}, f"{name}.dll") for name in ("A", "B", "C", "G", "device:x")}

    def graph(names: list[str], *edges: tuple[str, str]) -> Graph:
        own = Part(frozenset(f"{name}.p" for name in names), frozenset(edges), frozenset(names))
        return Graph("g", space, {}, own)

    old = graph(["A", "B", "device:x"], ("A.p", "device:x.p"), ("A.p", "B.p"))
    new = graph(["A", "B", "C"], ("B.p", "A.p"))
    assert difference(old, new) == (
        "define C;\n"
        'G_.DeleteComponent ( "device:x" );\n'
        "G_.PruneEdges ();\n"
        'G_.DeleteEdge ( "A.p", "B.p" );\n'
        'C = G_.CreateComponent ( "C.dll" );\n'
        'G_.CreateEdge ( "B.p", "A.p" );\n'
    )
    assert "PruneEdges" not in difference(graph(["A", "B"], ("A.p", "B.p")), graph(["A", "B"]))
    assert difference(old, graph(["B"])).startswith("G_.DeleteComponent ( A );\n")


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (Part(frozenset({"A.p"}), frozenset(), frozenset({"A", "B"})), "needs:component_graph"),
        (Part(frozenset({"A.p"}), frozenset(), frozenset()), "needs:whole"),
        (Part(frozenset({"A.p", "A.q.0"}), frozenset({("A.p", "B.p")}), frozenset()), "needs:edge_contained"),
        (Part(frozenset({"A.p", "A.q.0"}), frozenset(), frozenset()), "needs:leaves"),
    ],
)
def test_graphs_whose_difference_cannot_be_told(change: Part, error: str) -> None:
    graph = small_graph()
    bad = graph.of(change.vertices, change.edges, change.components)
    for pair in ((graph, bad), (bad, graph)):
        with pytest.raises(PcsError) as refused:
            difference(*pair)
        assert refused.value.error == error
