"""What CLEAR and HOLDS name: an element, the place of a module that failed on one PE, or the spec that flies."""

from heronry_wire.management import EVERYWHERE, ElementKind


def element_field(kind: ElementKind, node: int = EVERYWHERE) -> int:
    """Return the argument `a` of CLEAR and HOLDS for an element of this kind.

    node: for a module that has failed on one PE alone, the node-ID of that PE; otherwise EVERYWHERE.
    """
    return kind | node << 8


def kind_and_place(a: int) -> tuple[int, int]:
    """Split the argument `a` of CLEAR or HOLDS in two: the number of an element's kind, and a node-ID or EVERYWHERE."""
    return a & 0xFF, a >> 8


def spec_mark(digest: str) -> int:
    """Return the argument `b` of the HOLDS that names the spec that flies: the first 16 bits of its digest.

    digest: of the spec, hexadecimal.
    """
    return int(digest[:4], 16)
