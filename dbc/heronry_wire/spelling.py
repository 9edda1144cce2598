"""What a person may have meant by a name that does not exist: the closest of those that do."""

import difflib
from collections.abc import Iterable


def close(word: str, known: Iterable[str], likeness: float = 0.6) -> str | None:
    """Give the known word that is closest to `word`; None where no word has at least `likeness`, 0 to 1."""
    return next(iter(difflib.get_close_matches(word, list(known), n=1, cutoff=likeness)), None)


def meant(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """Give the closest known word as a question; else `otherwise`, or the list of all known words."""
    names = list(known)
    found = close(word, names)
    return f"did you mean '{found}'?" if found else otherwise or f"there is {', '.join(names) or 'none'}"
