"""What a person may have meant by a name that does not exist: the closest of those that do."""

import difflib
from collections.abc import Iterable


def close(word: str, known: Iterable[str], likeness: float = 0.6) -> str | None:
    """The known word that is closest to another one; None where none is as like as this share, 0 to 1."""
    return next(iter(difflib.get_close_matches(word, list(known), n=1, cutoff=likeness)), None)


def meant(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """What may have been meant: the closest known word; where none is close, `otherwise`, or all of them."""
    names = list(known)
    found = close(word, names)
    return f"did you mean '{found}'?" if found else otherwise or f"there is {', '.join(names) or 'none'}"
