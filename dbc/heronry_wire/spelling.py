"""Suggests the name that a user may have meant: the known name that is closest to an unknown one."""

import difflib
from collections.abc import Iterable

_MOST_NAMES = 40  # in one sentence


def close(word: str, known: Iterable[str], likeness: float = 0.6) -> str | None:
    """Return the known word most similar to `word`; None where none has at least the similarity `likeness`, 0 to 1."""
    return next(iter(difflib.get_close_matches(word, list(known), n=1, cutoff=likeness)), None)


def kind_word(kind: str) -> str:
    """Return the word for a kind of element in a sentence: `PE` for `pe`, any other kind as it is."""
    return "PE" if kind == "pe" else kind


def meant(word: str, known: Iterable[str], otherwise: str = "", *, there_is: str = "there is") -> str:
    """Return "did you mean ...?" with the known word most similar to `word`.

    Where no known word is similar, give `otherwise`; if `otherwise` is empty, give a sentence that lists the first
    known words and begins with `there_is`.
    """
    names = list(known)
    found = close(word, names)
    if found:
        return f"did you mean '{found}'?"
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return otherwise or f"{there_is} {', '.join(names[:_MOST_NAMES]) or 'none'}{more}"
