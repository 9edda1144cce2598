"""The argument `a` of CLEAR and HOLDS: the kind of an element, and the place of a module that failed on one PE."""

from heronry_wire.management import EVERYWHERE, ElementKind


def element_field(kind: ElementKind, node: int = EVERYWHERE) -> int:
    """Return the argument `a` of CLEAR and HOLDS for an element of this kind.

    node: for a module that has failed on one PE alone, the node-ID of that PE; otherwise EVERYWHERE.
    """
    return kind | node << 8


def kind_and_place(a: int) -> tuple[int, int]:
    """Split the argument `a` of CLEAR or HOLDS in two: the number of an element's kind, and a node-ID or EVERYWHERE."""
    return a & 0xFF, a >> 8
