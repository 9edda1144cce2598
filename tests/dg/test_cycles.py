"""Components and shortest cycles, compared with their definitions, which are too slow for use."""

from hypothesis import given
from hypothesis import strategies as st

from heronry_dg.cycles import components, shortest_cycle

Graph = dict[int, list[int]]
GRAPHS = st.integers(1, 7).flatmap(
    lambda size: st.fixed_dictionaries({node: st.lists(st.integers(0, size - 1), max_size=4) for node in range(size)})
)


def reached(graph: Graph, start: int) -> set[int]:
    """Every node that can be reached in one step or more."""
    found: set[int] = set()
    frontier = [start]
    while frontier:
        fresh = set(graph[frontier.pop()]) - found
        found |= fresh
        frontier.extend(fresh)
    return found


@given(GRAPHS)
def test_components_are_the_nodes_that_reach_one_another(graph: Graph) -> None:
    together = {frozenset({a} | {b for b in graph if b in reached(graph, a) and a in reached(graph, b)}) for a in graph}
    found = components(graph)
    assert {frozenset(component) for component in found} == together
    assert sum(len(component) for component in found) == len(graph)


@given(GRAPHS)
def test_a_component_comes_after_those_it_points_to(graph: Graph) -> None:
    place = {node: index for index, component in enumerate(components(graph)) for node in component}
    assert all(place[successor] <= place[node] for node in graph for successor in graph[node])


@given(GRAPHS)
def test_a_cycle_is_found_where_there_is_one_and_it_is_one(graph: Graph) -> None:
    for component in components(graph):
        cycle = shortest_cycle(graph, component)
        assert bool(cycle) == (component[0] in reached(graph, component[0]))
        assert len(set(cycle)) == len(cycle)
        assert all(b in graph[a] for a, b in zip(cycle, [*cycle[1:], *cycle[:1]], strict=True))


def test_a_chain_as_long_as_a_file_needs_no_deep_stack() -> None:
    length = 100_000
    chain = {node: [node + 1] for node in range(length)} | {length: [0]}
    (ring,) = components(chain)
    assert ring == list(range(length + 1))
    assert shortest_cycle(chain, ring) == ring
