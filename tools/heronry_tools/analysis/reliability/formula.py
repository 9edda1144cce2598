"""Monotone formulas: when a function is lost, written over the elements that fail.

A formula is an acyclic graph of nodes. A node is a constant, an event (an element is down), or a gate. A gate is true
iff at least `least` of its inputs are true: 1 makes it an OR, the number of its inputs an AND. There is no negation, so
one more event never makes a formula false.

Nodes are numbers, and inputs have smaller numbers than the gate that reads them. Equal nodes are made once, and
constants and repeated inputs vanish as soon as a gate is made.
"""

from collections.abc import Callable, Collection, Container, Iterable, Mapping
from typing import Final

FALSE: Final = 0
TRUE: Final = 1
LEAF: Final = 0  # `least` of a constant or an event


class TooLargeError(Exception):
    """A formula or a diagram outgrew its limit."""


class Formula:
    """A pool of nodes, of which some are roots.

    least: of each node, the fewest inputs that must be true; 0 for constants and events.
    inputs: of each node, the nodes that it reads.
    events: of each event, its node; in the order of their making.
    """

    def __init__(self, most_nodes: int = 1_000_000) -> None:
        """Make an empty pool of at most `most_nodes` nodes; a gate beyond that raises TooLargeError."""
        self.least: list[int] = [LEAF, LEAF]
        self.inputs: list[tuple[int, ...]] = [(), ()]
        self.events: dict[str, int] = {}
        self.names: dict[int, str] = {}
        self._made: dict[tuple[int, ...], int] = {}
        self._most_nodes = most_nodes

    def event(self, name: str) -> int:
        """Return the node of an event."""
        node = self.events.get(name)
        if node is None:
            node = self.events[name] = self._add(LEAF, ())
            self.names[node] = name
        return node

    def any_of(self, inputs: Iterable[int]) -> int:
        """Return the OR of some nodes; FALSE for none."""
        return self.at_least(1, inputs)

    def all_of(self, inputs: Iterable[int]) -> int:
        """Return the AND of some nodes; TRUE for none."""
        these = list(inputs)
        return self.at_least(len(these), these)

    def at_least(self, least: int, inputs: Iterable[int]) -> int:
        """Return the node that is true iff at least `least` of some nodes are; a repeated node counts each time."""
        kept = list(inputs)
        if TRUE in kept or FALSE in kept:
            least -= kept.count(TRUE)
            kept = [node for node in kept if node > TRUE]
        if least <= 0:
            return TRUE
        if least > len(kept):
            return FALSE
        if least == len(kept):
            kept = list(dict.fromkeys(kept))
            least = len(kept)
        elif least == 1:
            kept = list(dict.fromkeys(kept))
        if len(kept) == 1:
            return kept[0]
        key = (least, *sorted(kept))
        node = self._made.get(key)
        if node is None:
            node = self._made[key] = self._add(least, tuple(kept))
        return node

    def _add(self, least: int, inputs: tuple[int, ...]) -> int:
        if len(self.least) >= self._most_nodes:
            raise TooLargeError
        self.least.append(least)
        self.inputs.append(inputs)
        return len(self.least) - 1

    def below(self, root: int) -> list[int]:
        """Return all nodes on which a node depends, itself included, inputs before the gates that read them."""
        seen, waiting = {root}, [root]
        while waiting:
            for node in self.inputs[waiting.pop()]:
                if node not in seen:
                    seen.add(node)
                    waiting.append(node)
        return sorted(seen)

    def support(self, root: int) -> list[str]:
        """Return the names of the events that a node reads, in the order of their making."""
        return [self.names[node] for node in self.below(root) if node in self.names]

    def with_replaced(self, root: int, replaced: Mapping[int, int], above: Container[int] | None = None) -> int:
        """Return the node that `root` becomes if some nodes are replaced by others.

        above: all nodes that depend on what is replaced, if they are known; then no other is looked at.
        """
        return self.each_with_replaced([root], replaced, above)[root]

    def each_with_replaced(
        self, roots: Collection[int], replaced: Mapping[int, int], above: Container[int] | None = None
    ) -> dict[int, int]:
        """Return what each of some nodes becomes if some nodes are replaced by others; `above` as for one node."""
        now, every = dict(replaced), self.inputs
        for node in self._changing(roots, replaced, above):
            before = every[node]
            inputs = tuple([now.get(one, one) for one in before])
            if inputs != before:
                now[node] = self.at_least(self.least[node], inputs)
        return {root: now.get(root, root) for root in roots}

    def _changing(self, roots: Iterable[int], replaced: Collection[int], above: Container[int] | None) -> list[int]:
        """Return the nodes between some nodes and what is replaced, inputs before the gates that read them."""
        least = min(replaced)  # smaller nodes do not depend on what is replaced
        seen = set(roots).difference(replaced)
        waiting = list(seen)
        while waiting:
            for node in self.inputs[waiting.pop()]:
                if node not in seen and node > least and node not in replaced and (above is None or node in above):
                    seen.add(node)
                    waiting.append(node)
        return sorted(seen)

    def evaluate(self, root: int, is_true: Callable[[str], bool]) -> bool:
        """Tell whether a node is true, from the events that are."""
        value: dict[int, bool] = {FALSE: False, TRUE: True}
        for node in self.below(root):
            if node in self.names:
                value[node] = is_true(self.names[node])
            elif node > TRUE:
                value[node] = sum(value[one] for one in self.inputs[node]) >= self.least[node]
        return value[root]
