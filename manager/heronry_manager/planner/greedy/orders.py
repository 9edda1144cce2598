"""The orders in which the planner tries the inputs of gates, and the modes that may feed each input.

A *giver* of a leaf is a mode that may feed the leaf. The *price* of a mode is the sum of the shares of CPU, RAM and
flash that the mode takes together with its cheapest producers; it serves only to order alternatives.

There are two orders: by worth, and by price. Inputs or givers with equal values are tried in the order of the spec.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from heronry_dg.gates import most_together
from heronry_manager.planner.greedy.leaves import LEAF, Leaves, Node

_PRICE_ROUNDS = 8  # depth of producers that prices include; deeper graphs are ordered less well
_UNPRICED = 1 << 40

Giver = tuple[int, int]
"""A mode that may feed a leaf, and its module."""


@dataclass(frozen=True, slots=True)
class Orders:
    """The needs of each mode, and the modes that may feed each leaf, in the orders in which they are tried."""

    price: list[int]  # by mode
    needs: list[Node | None]  # by mode
    has_choice: list[bool]  # by mode: its inputs can be supplied in ways of different worth
    readers: list[int]  # by mode: the set of modes with a leaf that this mode may feed
    dearest: list[list[Giver]]  # by leaf: its givers, the one of most worth first
    cheapest: list[list[Giver]]  # by leaf: its givers, the one of the lowest price first
    givers: list[int]  # by leaf: the set of its givers


def ordered(leaves: Leaves, module_of: Sequence[int], size: Sequence[int]) -> Orders:
    """Compute the price of each mode, and the orders in which the planner tries inputs of gates and givers of leaves.

    The head of this file defines price and giver.

    module_of: the module of each mode.
    size: what each mode takes by itself, without its producers: the sum of its shares of all CPU, RAM and
        flash, in millionths (`Sizes.size`).
    """
    order = _Order(leaves, _prices(leaves, size))
    needs = [None if node is None else order.ordered(node) for node in leaves.written]
    givers = [[(mode, module_of[mode]) for mode in worths] for worths in leaves.worth]
    readers = [0] * len(size)
    for leaf, worths in enumerate(leaves.worth):
        for mode in worths:
            readers[mode] |= 1 << leaves.mode[leaf]
    return Orders(
        price=order.price,
        needs=needs,
        has_choice=[node is not None and order.has_choice(node) for node in needs],
        readers=readers,
        dearest=[_dearest(one, worths) for one, worths in zip(givers, leaves.worth, strict=True)],
        cheapest=[sorted(one, key=lambda giver: order.price[giver[0]]) for one in givers],
        givers=[sum(1 << mode for mode in worths) for worths in leaves.worth],
    )


def _dearest(givers: list[Giver], worths: dict[int, int]) -> list[Giver]:
    return sorted(givers, key=lambda giver: -worths[giver[0]])


def _prices(leaves: Leaves, size: Sequence[int]) -> list[int]:
    prices = list(size)
    for _ in range(_PRICE_ROUNDS):
        order = _Order(leaves, prices)
        prices = [
            alone + (0 if node is None else order.price_of(node))
            for alone, node in zip(size, leaves.written, strict=True)
        ]
    return prices


class _Order:
    """Computes the prices of gates from those of modes, and the orders in which the inputs of a gate are tried.

    Also tells how many points the leaves of a gate can have together.
    """

    def __init__(self, leaves: Leaves, price: list[int]) -> None:
        self._worth, self.price = leaves.worth, price

    def price_of(self, node: Node) -> int:
        """Return the least price with which a gate or a leaf can be supplied.

        For a leaf this is the price of its cheapest giver, for a gate the sum over the cheapest inputs it needs.
        """
        most, number, inputs, _ = node
        if most == LEAF:
            return min((self.price[giver] for giver in self._worth[number]), default=_UNPRICED)
        prices = sorted(map(self.price_of, inputs))
        return min(sum(prices[:number]), _UNPRICED)

    def most_points(self, node: Node) -> int:
        """Return the most points that the leaves of a gate can have together."""
        most, number, inputs, _ = node
        if most == LEAF:
            return max(self._worth[number].values(), default=0)
        points = [self.most_points(one) for one in inputs]
        return most_together(points, most)

    def has_choice(self, node: Node) -> bool:
        """Tell whether a gate or leaf can be supplied in several ways that may differ in worth."""
        most, number, inputs, _ = node
        if most == LEAF:
            return len(set(self._worth[number].values())) > 1
        return number < len(inputs) or any(map(self.has_choice, inputs))

    def ordered(self, node: Node) -> Node:
        """Return a gate with two lists of its inputs: one with the highest worth first, one with the cheapest first.

        The gates below it get two such lists, too. If a gate needs all its inputs, both its lists keep the given order.
        """
        most, number, inputs, _ = node
        parts = tuple(map(self.ordered, inputs))
        if number >= len(inputs):  # all inputs are needed, or this is a leaf
            return (most, number, parts, parts)
        return (
            most,
            number,
            tuple(sorted(parts, key=lambda one: (-self.most_points(one), self.price_of(one)))),
            tuple(sorted(parts, key=self.price_of)),
        )
