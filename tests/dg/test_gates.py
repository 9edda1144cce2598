"""Gates as two numbers: how many of their inputs must hold, and how many may hold."""

from itertools import product

from heronry_dg.gates import (
    And,
    Expression,
    Leaf,
    Or,
    Xor,
    bounds,
    could_hold,
    fold,
    holds,
    leaves,
    most_points,
    with_leaves,
    words,
)

A, B, C = (Leaf(name, 1, 1, (points,)) for name, points in (("a", 5), ("b", 3), ("c", 2)))
TREE = And((A, Or(1, (B, Xor((A, C))))))


def test_bounds_and_words_of_each_kind() -> None:
    gates = (And((A, B, C)), Or(2, (A, B, C)), Xor((A, B, C)))
    assert [bounds(gate) for gate in gates] == [(3, 3), (2, 3), (1, 1)]
    told = [(words(gate).rule, words(gate).drawn, words(gate).demand) for gate in gates]
    assert told == [
        ("3.and", "AND", "all must"),
        ("3.or", "2/3", "at least 2 must"),
        ("3.xor", "XOR", "exactly one must"),
    ]


def test_a_gate_holds_within_its_bounds() -> None:
    for wired in product((False, True), repeat=3):
        paths = [str(index) for index, is_wired in enumerate(wired) if is_wired]
        assert holds(And((A, B, C)), paths) == (len(paths) == 3)
        assert holds(Or(2, (A, B, C)), paths) == (len(paths) >= 2)
        assert holds(Xor((A, B, C)), paths) == (len(paths) == 1)
    assert holds(None, ())


def test_a_fold_goes_from_the_leaves_up() -> None:
    assert fold(TREE, lambda leaf, path: f"{leaf.variable}:{path}", lambda _, inputs: f"({' '.join(inputs)})") == (
        "(a:0 (b:1.0 (a:1.1.0 c:1.1.1)))"
    )


def test_what_could_hold_if_any_leaf_may_be_left_out() -> None:
    def could(expression: Expression, given: str) -> bool:
        return could_hold(expression, lambda leaf: leaf.variable in given)

    assert could(TREE, "ab")
    assert could(TREE, "a")
    assert not could(TREE, "bc")
    assert could(Xor((A, B)), "ab")
    assert could(Or(0, (A,)), "")


def test_most_points_of_a_gate_are_those_of_as_many_inputs_as_may_hold() -> None:
    def points(leaf: Leaf, _: str) -> int:
        return leaf.worth[0]

    assert most_points(TREE, points) == 5 + 3 + 5
    assert most_points(Xor((B, A)), points) == 5
    assert most_points(A, points) == 5
    assert most_points(None, points) == 0


def test_the_same_tree_with_other_leaves() -> None:
    changed = with_leaves(TREE, lambda leaf: Leaf(leaf.variable.upper(), 1, 1, (0,)))
    assert [(path, leaf.variable) for path, leaf in leaves(changed)] == [
        (path, leaf.variable.upper()) for path, leaf in leaves(TREE)
    ]
    assert isinstance(changed, And)
    assert isinstance(changed.inputs[1], Or)
