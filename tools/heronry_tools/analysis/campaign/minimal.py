"""The minimal sets among some sets: the sets that contain no other one of these sets."""

from collections.abc import Iterable


def minimal(sets: Iterable[frozenset[str]]) -> list[frozenset[str]]:
    """Give those of the sets that contain no other one of them, smaller sets first; equal sizes keep their order."""
    found: list[frozenset[str]] = []
    for one in sorted(dict.fromkeys(sets), key=len):
        if not any(known < one for known in found):
            found.append(one)
    return found
