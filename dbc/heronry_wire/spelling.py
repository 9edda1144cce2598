"""Suggests the name that a user may have meant: the known name that is closest to an unknown one."""

import difflib
from collections.abc import Iterable

_MOST_NAMES = 40  # in one sentence


def close(word: str, known: Iterable[str], likeness: float = 0.6) -> str | None:
    """Give the known word that is closest to `word`; None where no word has at least `likeness`, 0 to 1."""
    return next(iter(difflib.get_close_matches(word, list(known), n=1, cutoff=likeness)), None)


def meant(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """Give the closest known word as a question; else `otherwise`, or the list of known words, the first of many."""
    names = list(known)
    found = close(word, names)
    if found:
        return f"did you mean '{found}'?"
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return otherwise or f"there is {', '.join(names[:_MOST_NAMES]) or 'none'}{more}"
