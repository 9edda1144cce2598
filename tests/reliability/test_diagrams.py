"""Formulas and their diagrams against truth tables."""

import itertools
import random

import pytest

from heronry_tools.analysis.reliability import truncating
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.formula import FALSE, TRUE, Formula, TooLargeError
from heronry_tools.analysis.reliability.simplifying import simplified
from reliability.brute_force import chance, smallest, subsets
from thoroughness import part_of


def drawn(rng: random.Random, events: int, gates: int) -> tuple[Formula, int]:
    """Draw a formula in which gates and events are read in many places."""
    formula = Formula()
    nodes = [formula.event(f"e{i}") for i in range(events)]
    for _ in range(gates):
        inputs = rng.sample(nodes[-8:] + nodes[:events], rng.randint(2, 4))
        nodes.append(formula.at_least(rng.randint(1, len(inputs)), inputs))
    return formula, nodes[-1]


@pytest.mark.parametrize("share", range(4))
def test_sets_and_probabilities_of_random_formulas_are_those_of_the_truth_table(share: int) -> None:
    for seed in range(share, part_of(1600), 4):
        rng = random.Random(seed)
        formula, root = drawn(rng, rng.randint(2, 8), rng.randint(1, 14))
        names = list(formula.events)
        true = [down for down in subsets(names) if formula.evaluate(root, down.__contains__)]
        chances = {name: rng.choice((1e-6, 0.2, 0.9, 1.0)) for name in names}
        solution = Solution(formula, root)
        listed = list(solution.sets(10_000))
        assert set(listed) == smallest(true), seed
        assert len(listed) == len(set(listed)) == sum(solution.by_order().values())
        assert [len(one) for one in listed] == sorted(map(len, listed))
        exact = sum(chance(down, chances) for down in true)
        assert solution.probability(chances) == pytest.approx(exact, rel=1e-9), seed
        assert solution.survival(chances) == pytest.approx(
            sum(chance(down, chances) for down in subsets(names) if down not in set(true)), rel=1e-9, abs=1e-300
        )
        likeliest = list(solution.likeliest(10_000, chances))
        assert {down for down, _ in likeliest} == set(listed), seed
        assert [its for _, its in likeliest] == sorted((its for _, its in likeliest), reverse=True) or all(
            one >= 0.999999 * other for (_, one), (_, other) in itertools.pairwise(likeliest)
        )


def test_birnbaum_is_the_difference_that_an_event_makes() -> None:
    for seed in range(part_of(400)):
        rng = random.Random(seed)
        formula, root = drawn(rng, rng.randint(2, 8), rng.randint(1, 14))
        chances = {name: rng.choice((0.01, 0.2, 0.7)) for name in formula.events}
        solution = Solution(formula, root)
        for name, slope in solution.birnbaum(chances).items():
            surely, never = (solution.probability({**chances, name: value}) for value in (1.0, 0.0))
            assert slope == pytest.approx(surely - never, rel=1e-9, abs=1e-12), (seed, name)


def test_a_formula_made_smaller_has_the_same_value() -> None:
    for seed in range(part_of(1600)):
        rng = random.Random(seed)
        formula, root = drawn(rng, rng.randint(2, 7), rng.randint(1, 20))
        names = list(formula.events)
        small = simplified(formula, root)
        for down in subsets(names):
            assert formula.evaluate(root, down.__contains__) == formula.evaluate(small, down.__contains__), (seed, down)


def test_a_chain_of_many_gates_is_no_harder_than_a_short_one() -> None:
    formula = Formula()
    node = formula.event("e0")
    shared = formula.event("shared")
    for depth in range(1, 600):
        own = formula.event(f"e{depth}")
        node = formula.any_of([formula.all_of([node, own]), formula.all_of([own, shared])])
    solution = Solution(formula, node)
    assert solution.by_order() == {2: 1, 600: 1}
    assert solution.probability(dict.fromkeys(formula.events, 0.5)) == pytest.approx(0.25)


def test_what_is_listed_is_limited_in_number_and_order() -> None:
    formula = Formula()
    pairs = [formula.all_of([formula.event(f"a{i}"), formula.event(f"b{i}")]) for i in range(40)]
    root = formula.any_of([formula.event("alone"), formula.all_of(pairs[:20]), *pairs[20:]])
    solution = Solution(formula, root)
    assert solution.by_order() == {1: 1, 2: 20, 40: 1}
    assert len(list(solution.sets(7))) == 7
    assert len(list(solution.sets(1000, order=2))) == 21
    assert next(solution.likeliest(1, dict.fromkeys(formula.events, 0.1))) == (frozenset({"alone"}), 0.1)


def test_sets_are_counted_that_nobody_could_list() -> None:
    formula = Formula()
    root = formula.all_of(formula.any_of(formula.event(f"{i}.{j}") for j in range(10)) for i in range(60))
    assert Solution(formula, root).by_order() == {60: 10**60}


@pytest.mark.parametrize(("node", "sets", "chance_of"), [(FALSE, [], 0.0), (TRUE, [frozenset()], 1.0)])
def test_constants(node: int, sets: list[frozenset[str]], chance_of: float) -> None:
    solution = Solution(Formula(), node)
    assert (list(solution.sets(9)), solution.probability({})) == (sets, chance_of)
    assert [one for one, _ in solution.likeliest(9, {})] == sets


def test_a_single_event() -> None:
    formula = Formula()
    solution = Solution(formula, formula.event("e"))
    assert list(solution.sets(9)) == [frozenset({"e"})]
    assert solution.by_order() == {1: 1}
    assert solution.birnbaum({"e": 0.25}) == {"e": 1.0}
    assert list(solution.likeliest(9, {"e": 0.25})) == [(frozenset({"e"}), 0.25)]


def test_a_diagram_that_outgrows_its_limit_says_so() -> None:
    formula = Formula()
    rng = random.Random(5)
    pairs = [(f"e{rng.randrange(40)}", f"e{rng.randrange(40)}") for _ in range(90)]
    root = formula.any_of(formula.all_of([formula.event(one), formula.event(other)]) for one, other in pairs)
    with pytest.raises(TooLargeError):
        Solution(formula, root, most_nodes=200)


@pytest.mark.parametrize(
    ("kept", "set_nodes"), [((3_000,), 100_000), ((6, 2, 1), 100_000), ((20, 4, 1), 12), ((1,), 2)]
)
def test_what_is_truncated_has_all_sets_to_its_order_and_true_bounds(
    kept: tuple[int, ...], set_nodes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(truncating, "_KEPT", kept)
    monkeypatch.setattr(truncating, "_SET_NODES", set_nodes)
    orders = set[int | None]()
    for seed in range(part_of(400)):
        rng = random.Random(seed)
        formula, root = drawn(rng, rng.randint(3, 8), rng.randint(3, 14))
        names = list(formula.events)
        true = [down for down in subsets(names) if formula.evaluate(root, down.__contains__)]
        chances = {name: rng.choice((1e-6, 0.2, 0.9, 1.0)) for name in names}
        solution = Solution(formula, root, most_nodes=4, truncate=dict.fromkeys(names, 0.1))
        expected = {one for one in smallest(true) if solution.order is None or len(one) <= solution.order}
        assert set(solution.sets(10_000)) == expected, seed
        assert {one for one, _ in solution.likeliest(10_000, chances)} == expected, seed
        assert sum(solution.by_order().values()) == len(expected)
        exact = sum(chance(down, chances) for down in true)
        assert solution.probability(chances) <= exact * (1.0 + 1e-9), seed
        assert solution.at_most(chances) >= exact * (1.0 - 1e-9), seed
        assert solution.survival_at_least(chances) <= 1.0 - exact + 1e-9 <= solution.survival(chances) + 2e-9, seed
        if solution.exact:
            assert solution.probability(chances) == solution.at_most(chances)
        orders.add(solution.order if not solution.exact else -1)
    assert len(orders - {-1}) > 0


def test_a_tree_that_is_too_large_keeps_close_bounds() -> None:
    formula, rng = Formula(), random.Random(5)
    events = [formula.event(f"e{number}") for number in range(25)]
    root = formula.any_of(formula.all_of(rng.sample(events, 3)) for _ in range(40))
    chances = {name: rng.choice((1e-3, 1e-2, 0.03)) for name in formula.events}
    whole = Solution(formula, root)
    assert whole.exact
    cut = Solution(formula, root, most_nodes=300, truncate=chances)
    assert not cut.exact
    assert cut.by_order() == whole.by_order()
    exact = whole.probability(chances)
    assert 0.9 * exact < cut.probability(chances) <= exact <= cut.at_most(chances) < 1.1 * exact
