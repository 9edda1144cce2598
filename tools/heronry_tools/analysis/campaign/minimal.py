"""Finds the minimal sets of a collection of sets: those that contain no other set of the collection."""

from collections.abc import Iterable


def minimal(sets: Iterable[frozenset[str]]) -> list[frozenset[str]]:
    """Return each set that contains none of the others, smaller ones first; sets of equal size keep their order."""
    found: list[frozenset[str]] = []
    for one in sorted(dict.fromkeys(sets), key=len):
        if not any(known < one for known in found):
            found.append(one)
    return found
