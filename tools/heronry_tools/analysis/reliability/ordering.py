"""Orders of the variables of a diagram: the size of a diagram depends on the order more than on anything else.

No order is good for every formula, so several are proposed, and the caller takes the first with a small diagram:

    as read     the order in which a search from the root, depth first, meets the leaves
    small first the same search, but each gate's smaller inputs first
    large first the same search, but each gate's larger inputs first
    shared first the same search, but what is read most often first
    pulled      one of these, with the leaves of a gate moved near each other (Aloul, Markov and Sakallah, FORCE: a fast
                and easy-to-implement variable-ordering heuristic, 2003)
"""

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Final

from heronry_tools.analysis.reliability.formula import LEAF, Formula
from heronry_tools.analysis.reliability.parts import Part

_ROUNDS: Final = 60


def orders(formula: Formula, part: Part) -> Iterator[list[int]]:
    """Propose orders of the leaves of a part, each once."""
    seen: set[tuple[int, ...]] = set()
    for order in _proposed(formula, part):
        if tuple(order) not in seen:
            seen.add(tuple(order))
            yield order


def _proposed(formula: Formula, part: Part) -> Iterator[list[int]]:
    size = _sizes(formula, part)
    readers = Counter(one for gate in part.gates for one in formula.inputs[gate])
    keys: tuple[Callable[[int], object], ...] = (
        lambda _: 0,
        lambda one: size[one],
        lambda one: -size[one],
        lambda one: (-readers[one], size[one]),
    )
    searches = [
        _searched(part, {gate: sorted(formula.inputs[gate], key=key) for gate in part.gates})  # type: ignore[arg-type]
        for key in keys
    ]
    yield searches[1]
    pulled = [_pulled(formula, part, order) for order in searches]
    yield from sorted([*searches, *pulled], key=lambda order: _span(formula, part, order))


def _sizes(formula: Formula, part: Part) -> dict[int, int]:
    """Return the number of nodes below each node of a part, with repetitions, up to a limit."""
    size = dict.fromkeys(part.leaves, 1)
    for gate in part.gates:
        size[gate] = min(1 << 40, 1 + sum(size[one] for one in formula.inputs[gate]))
    return size


def _searched(part: Part, inputs: dict[int, list[int]]) -> list[int]:
    seen, found, waiting = set[int](), list[int](), [part.root]
    while waiting:
        node = waiting.pop()
        if node in seen:
            continue
        seen.add(node)
        if node in inputs:
            waiting += reversed(inputs[node])
        else:
            found.append(node)
    return found


def _span(formula: Formula, part: Part, order: list[int]) -> int:
    """Return the sum, over the gates, of the distance between the first and the last leaf that the gate depends on."""
    place = {leaf: (index, index) for index, leaf in enumerate(order)}
    total = 0
    for gate in part.gates:
        first = min(place[one][0] for one in formula.inputs[gate])
        last = max(place[one][1] for one in formula.inputs[gate])
        place[gate] = (first, last)
        total += last - first
    return total


def _pulled(formula: Formula, part: Part, order: list[int]) -> list[int]:
    """Move gates and leaves to the middle of their neighbours, again and again, while the span shrinks."""
    edges = [(gate, *formula.inputs[gate]) for gate in part.gates]
    around: dict[int, list[int]] = {}
    for number, edge in enumerate(edges):
        for node in edge:
            around.setdefault(node, []).append(number)
    place: dict[int, float] = {leaf: float(index) for index, leaf in enumerate(order)}
    for gate in part.gates:
        inputs = formula.inputs[gate]
        place[gate] = sum(place[one] for one in inputs) / len(inputs)
    best, best_span = order, _span(formula, part, order)
    without_gain = 0
    for _ in range(_ROUNDS):
        middles = [sum(place[node] for node in edge) / len(edge) for edge in edges]
        place = {node: sum(middles[edge] for edge in its) / len(its) for node, its in around.items()}
        ranked = sorted(place, key=place.__getitem__)
        place = {node: float(index) for index, node in enumerate(ranked)}
        now = [node for node in ranked if formula.least[node] == LEAF or node not in part.gates]
        span = _span(formula, part, now)
        without_gain = 0 if span < best_span else without_gain + 1
        if span < best_span:
            best, best_span = now, span
        if without_gain >= 3:
            break
    return best
