"""Claims of the paper that do not hold as printed, each with a counterexample.

Figures 13 to 15 and sections 2.2, 2.3 and 3.4 of Ippolito et al.; docs/polymorphic.md lists what is decided instead.
"""

import pytest

from heronry_pcs.cycles import cycles
from heronry_pcs.graph import Edge, Graph, Leaf, Part, PcsError
from heronry_pcs.loops import loops
from heronry_pcs.neighborhood import controllable, observable
from heronry_pcs.operations import add_edge, addition, combine, cprune, removal
from heronry_pcs.predicates import PREDICATES, broken, is_component_connected, is_configuration, is_disjoint
from heronry_pcs.views import contract, view_graph
from heronry_tools.analysis.control.longest_cycle import longest_cycle


def graph_of(text: str, outside: str = "") -> Graph:
    """A graph of leaves with one port, from its edges as `AB BC` (or a lone `A`)."""
    words = text.split()
    leaves = sorted(set("".join(words)))
    edges = frozenset((f"{word[0]}.p", f"{word[1]}.p") for word in words if len(word) == 2)
    space = {name: Leaf(name, {"p": 1}, name) for name in [*leaves, *outside]}
    return Graph("g", space, {}, Part(frozenset(f"{n}.p" for n in leaves), edges, frozenset(leaves)))


def edge(text: str) -> Edge:
    return f"{text[0]}.p", f"{text[1]}.p"


def is_cycle_bound(text: str) -> bool | None:
    return cycles(graph_of(text), longest_cycle).cycle_bound


def test_components_with_inner_edges_are_in_no_configuration() -> None:
    """By (i) to (iii) a member of a configuration has no components and no edges: the figures' K_c would be none."""
    graph = graph_of("AB BC")
    model, view = contract(graph, set("ABC"), "K", {"A", "B"})
    opened = Graph("g", model.leaves, model.composites, Part(model.vertices, model.edges, view))
    assert model.composites["K"].edges
    assert "subgraph" in broken(opened)["K"]
    assert not is_configuration(opened)
    assert is_configuration(view_graph(model, view)), "closed, it is one"


def test_subcomponents_need_not_be_a_proper_subset_of_the_vertices() -> None:
    model, _ = contract(graph_of("A"), {"A"}, "K", {"A"})
    assert broken(model) == {}
    assert model.part("A").vertices == model.part("K").vertices


def test_a_connected_set_is_no_path() -> None:
    """A star of four is a component-path by the letter; connectedness comes to the same, and cycles do not."""
    assert is_component_connected(graph_of("AB AC AD"))
    assert cycles(graph_of("AB AC AD")).longest == (0, 0)


def test_two_edges_in_a_row_are_no_cycle_and_two_components_that_feed_each_other_are_a_loop() -> None:
    assert cycles(graph_of("AB BC")).longest == (0, 0)
    feeding = graph_of("AB BA")
    assert cycles(feeding).longest == (0, 0)
    assert loops(feeding).found == (frozenset("AB"),)


def test_the_longest_cycle_need_not_pass_all_components() -> None:
    assert cycles(graph_of("AB BC CA CD")).longest == (3, 3)


def test_a_bridge_keeps_a_graph_from_being_cycle_bound() -> None:
    """Two triangles and a bridge pass by the letter: the union of two cycles is never empty."""
    assert is_cycle_bound("AB BC CA CD DE EF FD") is False


def test_one_longest_cycle_is_enough() -> None:
    """Three triangles in a row: those at the ends share no member, the one in the middle meets both."""
    assert is_cycle_bound("AB BC CA CD DE EC EF FG GE") is True


def test_a_ring_and_two_triangles_in_a_row_are_not_cycle_bound() -> None:
    assert is_cycle_bound("AB BC CD DA DE EF FD FG GH HF") is False


def test_a_search_that_is_left_out_leaves_a_question_open() -> None:
    """A block of five of which a cycle passes four, and a triangle: without a search the five might all be passed."""
    graph = graph_of("AX XB AY YB AZ ZB AP PQ QA")
    assert (cycles(graph).longest, cycles(graph).cycle_bound) == ((4, 5), None)
    found = cycles(graph, longest_cycle)
    assert (found.longest, found.cycle_bound) == ((4, 4), True)


@pytest.mark.parametrize(("text", "is_bound", "of_a"), [("AB AC BC", True, "excluded"), ("AB BA", False, "possible")])
def test_being_cycle_bound_says_nothing_of_control(text: str, is_bound: bool, of_a: str) -> None:
    assert is_cycle_bound(text) is is_bound
    assert controllable(graph_of(text))["A"] == of_a


def test_contraction_may_lose_and_make_a_cycle() -> None:
    graph = graph_of("AB BC CD DA")
    model, view = contract(graph, set("ABCD"), "K", {"A", "B", "C"})
    assert cycles(graph).cycle_bound is True
    assert cycles(view_graph(model, view)).cycle_bound is False
    chain = graph_of("AB BC CD DE EB")
    model, view = contract(chain, set("ABCDE"), "K", {"A", "B"})
    assert cycles(chain).cycle_bound is False
    assert cycles(view_graph(model, view)).cycle_bound is True


def test_pruning_by_the_letter_leaves_vertices_in_no_member() -> None:
    graph = graph_of("A B")
    letter = graph.of(graph.vertices, graph.edges, graph.own.components - {"A"})
    assert not is_disjoint(letter)
    assert is_disjoint(cprune(graph))
    assert cprune(cprune(graph)).own.components == {"B"}, "a lone component stays"


def test_combining_without_an_edge_gives_no_configuration() -> None:
    """G' = combineCGraph(G_eav - E_v, G_max) of section 3.4: no operation of section 2.3 may be used on it."""
    joined = combine(graph_of("AB"), graph_of("CD"))
    assert not is_configuration(joined)
    for operation in (addition, add_edge):
        with pytest.raises(PcsError, match="is not a configuration, and this operation works on configurations alone"):
            operation(joined, edge("AC"))
    with pytest.raises(PcsError, match="is not a configuration, and this operation works on configurations alone"):
        removal(joined, [edge("AB")])


def test_what_an_operation_lacks_is_a_sentence_and_its_name_stays_for_programs() -> None:
    joined = combine(graph_of("AB"), graph_of("CD"))
    with pytest.raises(PcsError) as refused:
        removal(joined, [edge("AB")])
    assert refused.value.error == "needs:configuration"
    assert str(refused.value).startswith("the graph is not a configuration, and")
    assert all(str(PcsError(f"needs:{name}")) for name in (*PREDICATES, "vertex", "leaves"))


def test_removal_need_not_give_a_configuration() -> None:
    assert not is_configuration(removal(graph_of("AB BC CD"), [edge("BC")]))
    left = removal(graph_of("AB"), [edge("AB")])
    assert is_configuration(left)
    assert left.own.components == {"B"}


def test_addition_needs_its_ends_in_two_members() -> None:
    with pytest.raises(PcsError, match="one member holds both ends"):
        addition(graph_of("A"), edge("AA"))
    with pytest.raises(PcsError, match="an end of the edge is not in the graph"):
        addition(graph_of("A", "B"), edge("AB"))


def test_an_edge_between_two_members_is_added() -> None:
    """By the letter (iii) it never is; and with an end outside, the vertices of the parent are in no member."""
    assert edge("BA") in add_edge(graph_of("AB"), edge("BA")).edges
    brought = add_edge(graph_of("A", "B"), edge("AB"))
    assert is_configuration(brought)
    letter = brought.of(brought.vertices, brought.edges, frozenset("A"))
    assert not is_disjoint(letter)


def test_the_necessary_conditions_do_not_find_what_is_on_no_loop() -> None:
    graph = graph_of("AB BA BC CD DE ED")
    assert controllable(graph)["C"] == observable(graph)["C"] == "possible"
    assert not loops(graph).through(graph.members["C"].vertices)
