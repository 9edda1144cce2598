"""Inputs and gates for the greedy planner, in integers.

The leaves of all modes are numbered in one series, from 0. A gate is a tree of tuples (`Node`).
"""

from collections.abc import Mapping
from dataclasses import dataclass

from heronry_dg.configuration import Wire
from heronry_dg.gates import Expression, Leaf, bounds, child_path
from heronry_manager.planner.greedy.numbering import Numbering

LEAF = 0  # first value of the node of a leaf, which has no inputs
Node = tuple[int, int, tuple["Node", ...], tuple["Node", ...]]
"""A node of a gate, or a leaf, as four values.

    gate   the largest and the least number of inputs that may be satisfied; the inputs by worth, highest first; the
           inputs by price, cheapest first
    leaf   `LEAF`; the number of the leaf; and twice an empty tuple
"""


@dataclass(frozen=True, slots=True)
class Leaves:
    """All leaves, by number, and the gates as the spec writes them."""

    mode: list[int]  # by leaf: the mode that reads it
    module: list[int]  # by leaf: the module that reads it
    path: list[str]  # by leaf: its path in the gate of its mode
    variable: list[int]  # by leaf: the number of its variable
    worth: list[dict[int, int]]  # by leaf: mode that may feed it -> points
    wire: list[dict[int, Wire]]  # by leaf: mode that may feed it -> the wire
    of_mode: list[list[int]]  # by mode: its leaves
    written: list[Node | None]  # by mode: what it needs, with inputs in the order in which they are written


def numbered_leaves(numbers: Numbering) -> Leaves:
    """Number the leaves of all modes."""
    numberer = _Numberer(numbers)
    for number, (_, mode) in enumerate(numbers.modes):
        numberer.leaves.written.append(numberer.node(number, mode.needs, ""))
    return numberer.leaves


class _Numberer:
    """Numbers the leaves of all modes, and turns the gates of each mode into a tree."""

    def __init__(self, numbers: Numbering) -> None:
        self._numbers = numbers
        self._giving = _modes_that_give(numbers)
        self.leaves = Leaves([], [], [], [], [], [], [[] for _ in numbers.modes], [])

    def node(self, mode: int, gate: Expression | None, path: str) -> Node | None:
        """Turn a gate into a tree, and number the leaves in it; None: there is no gate."""
        if gate is None:
            return None
        if isinstance(gate, Leaf):
            return (LEAF, self._leaf(mode, gate, path), (), ())
        inputs = (self.node(mode, child, child_path(path, index)) for index, child in enumerate(gate.inputs))
        nodes = tuple(node for node in inputs if node is not None)
        least, most = bounds(gate)
        return (most, least, nodes, nodes)

    def _leaf(self, mode: int, leaf: Leaf, path: str) -> int:
        """Number a leaf, and list the modes that may feed the leaf; returns the number.

        Of the modes of the leaf's own module, only the mode that reads the leaf may feed it.
        """
        numbers, leaves, number = self._numbers, self.leaves, len(self.leaves.mode)
        leaves.mode.append(mode)
        leaves.module.append(numbers.module_of[mode])
        leaves.path.append(path)
        leaves.variable.append(numbers.variable_number[leaf.variable])
        leaves.of_mode[mode].append(number)
        giving = [
            (giver, numbers.modes[giver][1].gives[leaf.variable])
            for giver in self._giving.get(leaf.variable, ())
            if numbers.module_of[giver] != numbers.module_of[mode] or giver == mode
        ]
        accepted = [(giver, version) for giver, version in giving if leaf.accepts(version)]
        names = {giver: numbers.modules[numbers.module_of[giver]].name for giver, _ in accepted}
        leaves.worth.append({giver: leaf.points(version) for giver, version in accepted})
        leaves.wire.append({giver: Wire(names[giver], leaf.variable, version) for giver, version in accepted})
        return number


def _modes_that_give(numbers: Numbering) -> Mapping[str, list[int]]:
    giving: dict[str, list[int]] = {}
    for number, (_, mode) in enumerate(numbers.modes):
        for variable in mode.gives:
            giving.setdefault(variable, []).append(number)
    return giving
