"""The minimal sets of some sets: those that contain no other one."""

from collections.abc import Iterable


def minimal(sets: Iterable[frozenset[str]]) -> list[frozenset[str]]:
    """Give the sets that contain no other one, smaller sets first; sets of equal size keep their order."""
    found: list[frozenset[str]] = []
    for one in sorted(dict.fromkeys(sets), key=len):
        if not any(known < one for known in found):
            found.append(one)
    return found
