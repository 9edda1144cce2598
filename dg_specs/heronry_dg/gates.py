"""Gate expressions: what the inputs of a module mode must satisfy.

An expression is a tree of `And`, `Or` (k of n) and `Xor` over leaves. The loader has replaced the name of each gate by
the expression of that gate, so a tree names only variables. A leaf is addressed by its index path in the tree: `""` for
a lone leaf, `"0"`, `"0.1"`.

A leaf holds iff it is wired. A gate holds iff the number of its inputs that hold lies between the two numbers of
`bounds`; everything else about a gate follows from these numbers. So a new kind of gate needs a class, a case in
`bounds` and in `words`, and a syntax (`expression_reader`, `check.json_schema`).

A DEMUX is not a node of a tree. The expression of each branch contains the expression in front of the DEMUX, as a rule
a lone leaf; the field `demux` of each of its leaves names the DEMUX.

Source: section 3.1 and Figure 2 of the paper by Rawashdeh et al. (docs/semantics.md has the reference). The paper has
no numbers for worth and accepted versions.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeVar, assert_never


@dataclass(frozen=True, slots=True)
class Leaf:
    """One input of a mode: `variable`, in a version from `best` to `worst` (1 is the best version)."""

    variable: str
    best: int
    worst: int
    worth: tuple[int, ...]  # points for a wire to version best, best + 1, ..., worst
    demux: str | None = None  # the DEMUX of which the leaf's module is a branch
    only_in: frozenset[str] | None = None  # phases in which it may be wired; None: in all

    def accepts(self, version: int) -> bool:
        """Tell whether a datum of `version` may be wired here."""
        return self.best <= version <= self.worst

    def is_open_in(self, phase: str | None) -> bool:
        """Tell whether the leaf may be wired in a phase; if the phase is None, `only_in` is ignored."""
        return self.only_in is None or phase is None or phase in self.only_in

    def closed(self) -> "Leaf":
        """Return a copy of the leaf that accepts no version, for a phase in which the leaf is never wired."""
        return replace(self, worst=self.best - 1, worth=())

    def points(self, version: int) -> int:
        """Points for a wire to `version`, which the leaf must accept."""
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


Gate = And | Or | Xor
Expression = Leaf | Gate

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Words:
    """The texts by which messages and pictures describe one kind of gate."""

    rule: str  # sub-rule of the verifier (`verify`)
    demand: str  # how many inputs must hold
    written: str  # stands before the brackets around its inputs
    drawn: str  # label in a picture
    outline: Literal["and", "or", "xor"]  # shape of the symbol in a picture


# Only the next two functions define the kinds of gates; everything else uses them.


def bounds(gate: Gate) -> tuple[int, int]:
    """Return the least and the largest number of inputs that may hold if the gate is to hold."""
    match gate:
        case And(inputs):
            return len(inputs), len(inputs)
        case Or(k, inputs):
            return k, len(inputs)
        case Xor():
            return 1, 1
        case _:
            assert_never(gate)


def words(gate: Gate) -> Words:
    """Return the texts by which messages and pictures describe a gate of this kind."""
    match gate:
        case And():
            return Words("3.and", "all must", "and", "AND", "and")
        case Or(k, inputs):
            return Words("3.or", f"at least {k} must", f"{k} of ", f"{k}/{len(inputs)}", "or")
        case Xor():
            return Words("3.xor", "exactly one must", "xor", "XOR", "xor")
        case _:
            assert_never(gate)


def fold(
    expression: Expression, leaf: Callable[[Leaf, str], T], gate: Callable[[Gate, list[T]], T], path: str = ""
) -> T:
    """Compute a value of an expression from the leaves up.

    leaf: gives the value of a leaf, from the leaf and its path.
    gate: gives the value of a gate, from the gate and the values of its inputs.
    """
    if isinstance(expression, Leaf):
        return leaf(expression, path)
    inputs = enumerate(expression.inputs)
    return gate(expression, [fold(child, leaf, gate, child_path(path, index)) for index, child in inputs])


def could_hold(expression: Expression, is_given: Callable[[Leaf], bool]) -> bool:
    """Tell whether an expression could hold if only leaves for which `is_given` is true may be wired."""
    if isinstance(expression, Leaf):
        return is_given(expression)
    fewest, _ = bounds(expression)
    return sum(could_hold(child, is_given) for child in expression.inputs) >= fewest


def most_points(expression: Expression | None, of_leaf: Callable[[Leaf, str], int]) -> int:
    """Return the most points that the leaves of an expression can have together.

    of_leaf: gives the points of one leaf, 0 or more.
    """

    def together(gate: Gate, points: list[int]) -> int:
        return most_together(points, bounds(gate)[1])

    return 0 if expression is None else fold(expression, of_leaf, together)


def most_together(points: Sequence[int], most: int) -> int:
    """Add up the `most` largest numbers of `points`: the most points that `most` inputs can have together."""
    return sum(points) if most == len(points) else sum(sorted(points, reverse=True)[:most])


def with_leaves(expression: Expression, changed: Callable[[Leaf], Leaf]) -> Expression:
    """Return the same tree, with each leaf replaced by `changed(leaf)`."""
    return fold(expression, lambda leaf, _: changed(leaf), lambda gate, inputs: replace(gate, inputs=tuple(inputs)))


def demux_at(expression: Expression) -> str | None:
    """Name of the DEMUX to which all leaves of an expression belong; None if they do not belong to one DEMUX."""
    names = {leaf.demux for _, leaf in leaves(expression)}
    return next(iter(names)) if len(names) == 1 else None


def child_path(path: str, index: int) -> str:
    """Path of the input number `index` of the gate at `path`."""
    return f"{path}.{index}" if path else str(index)


def leaves(expression: Expression | None, path: str = "") -> Iterator[tuple[str, Leaf]]:
    """Yield every leaf with its path, in the order of the file; no leaves for a mode without `needs`."""
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
    """Tell whether the expression at `path` holds if exactly the leaves with the paths in `wired` are wired."""
    if expression is None:
        return True
    if isinstance(expression, Leaf):
        return path in wired
    held = sum(holds(child, wired, child_path(path, i)) for i, child in enumerate(expression.inputs))
    fewest, most = bounds(expression)
    return fewest <= held <= most
