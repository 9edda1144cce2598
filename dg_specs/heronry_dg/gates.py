"""Gate expressions: what the inputs of a module mode must satisfy.

An expression is a tree of `And`, `Or` (k of n) and `Xor` over leaves; named gates have been written out by the
loader, so a tree holds no names but those of variables. A leaf is addressed by its index path in the tree:
`""` for a lone leaf, `"0"`, `"0.1"`.

One rule decides everything here: a leaf holds iff it is wired, a gate holds iff its condition does. A DEMUX is no
node of the tree: the leaf of each of its branches carries the DEMUX's name.

Source: the paper, section 3.1 and Figure 2; the numbers (worth, accepted versions) are this project's.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import assert_never


@dataclass(frozen=True, slots=True)
class Leaf:
    """One datum a mode reads: `variable` in a version from `best` to `worst` (1 is the best version)."""

    variable: str
    best: int
    worst: int
    worth: tuple[int, ...]  # points for being wired to version best, best + 1, ..., worst
    demux: str | None = None  # the DEMUX this leaf is a branch of

    def accepts(self, version: int) -> bool:
        """Tell whether a datum of `version` may be wired here."""
        return self.best <= version <= self.worst

    def points(self, version: int) -> int:
        """Worth, in points, of being wired to `version`, which must be an accepted one."""
        return self.worth[version - self.best]


@dataclass(frozen=True, slots=True)
class And:
    """Holds iff all inputs hold."""

    inputs: tuple["Expression", ...]


@dataclass(frozen=True, slots=True)
class Or:
    """Holds iff at least `k` inputs hold; with k = 0 all of them are optional."""

    k: int
    inputs: tuple["Expression", ...]


@dataclass(frozen=True, slots=True)
class Xor:
    """Holds iff exactly one input holds."""

    inputs: tuple["Expression", ...]


Expression = Leaf | And | Or | Xor


def child_path(path: str, index: int) -> str:
    """Path of the input number `index` of the gate at `path`."""
    return f"{path}.{index}" if path else str(index)


def leaves(expression: Expression | None, path: str = "") -> Iterator[tuple[str, Leaf]]:
    """Every leaf with its path, in the order written; nothing for a mode without `needs`."""
    if expression is None:
        return
    if isinstance(expression, Leaf):
        yield path, expression
        return
    for index, child in enumerate(expression.inputs):
        below = child_path(path, index)
        if isinstance(child, Leaf):
            yield below, child
        else:
            yield from leaves(child, below)


def holds(expression: Expression | None, wired: Collection[str], path: str = "") -> bool:
    """Tell whether the gate at `path` holds when exactly the leaves with the paths in `wired` are wired."""
    match expression:
        case None:
            return True
        case Leaf():
            return path in wired
        case And(inputs) | Or(_, inputs) | Xor(inputs):
            held = sum(holds(child, wired, child_path(path, i)) for i, child in enumerate(inputs))
        case _:
            assert_never(expression)
    match expression:
        case And():
            return held == len(inputs)
        case Or(k, _):
            return held >= k
        case Xor():
            return held == 1
        case _:
            assert_never(expression)
