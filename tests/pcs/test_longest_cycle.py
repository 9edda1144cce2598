"""The search for a longest cycle: what it proves, and what it says where it proves nothing."""

from heronry_pcs.cycles import bounds_alone
from heronry_tools.analysis.control.longest_cycle import MOST_MEMBERS, longest_cycle

LADDER = {"A": "XYZ", "B": "XYZ", "X": "AB", "Y": "AB", "Z": "AB"}  # a cycle passes two of X, Y, Z


def grid(width: int, height: int) -> dict[str, list[str]]:
    """A block in rows and columns; with an odd number of members no cycle passes all."""
    steps = ((0, 1), (1, 0), (0, -1), (-1, 0))
    return {
        f"{x}.{y}": [f"{x + a}.{y + b}" for a, b in steps if 0 <= x + a < width and 0 <= y + b < height]
        for x in range(width)
        for y in range(height)
    }


def test_a_cycle_of_some_members_and_none_of_others() -> None:
    assert longest_cycle(LADDER, frozenset()) == (4, 4)
    assert longest_cycle(LADDER, frozenset("XY")) == (4, 4)
    assert longest_cycle(LADDER, frozenset("XYZ")) == (0, 0)


def test_a_proven_cycle_of_a_grid() -> None:
    assert longest_cycle(grid(5, 5), frozenset()) == (24, 24)


def test_without_effort_nothing_is_known_that_was_not_known_before() -> None:
    least, most = longest_cycle(grid(15, 15), frozenset(), effort=0.0)
    assert bounds_alone(grid(15, 15), frozenset()) == (4, 225)
    assert 4 <= least <= 224 <= most <= 225


def test_a_large_block_is_not_searched() -> None:
    large = grid(21, 21)
    assert len(large) > MOST_MEMBERS
    assert longest_cycle(large, frozenset()) == bounds_alone(large, frozenset()) == (4, 441)
