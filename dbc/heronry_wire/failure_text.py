"""Makes the text of a module's failure harmless to print, for the agent and the manager, which receive the text.

The text goes from the module's process to its agent, and from there over SDO to the manager. Each of these two
receivers gets the text from a sender that it does not trust: a module may put anything into the message of an
exception, and any node may answer an SDO request. So each receiver makes the text plain. Printable ASCII stays as it
is; every other character is escaped, so that an escape sequence for a terminal has no effect. A text that is longer
than the limit is cut. No decision depends on the text; people read it.
"""

REASON_BYTES = 200
"""Longest reason, in one line: exception type, message, file and line."""

TRACEBACK_BYTES = 2_000
"""Longest traceback; a longer one loses its beginning, since the last frame is where the exception was raised."""

_CUT = "..."


def plain_reason(text: str) -> str:
    """Return a reason in one line of printable ASCII; a line longer than REASON_BYTES loses its end."""
    plain = _plain(text)
    return plain if len(plain) <= REASON_BYTES else plain[: REASON_BYTES - len(_CUT)] + _CUT


def plain_traceback(text: str) -> str:
    """Return a traceback in lines of printable ASCII, with its beginning cut off if it is too long."""
    plain = "\n".join(map(_plain, text[-TRACEBACK_BYTES:].splitlines()))
    cut = len(plain) > TRACEBACK_BYTES or len(text) > TRACEBACK_BYTES
    return _CUT + plain[len(_CUT) - TRACEBACK_BYTES :] if cut else plain


def _plain(text: str) -> str:
    return "".join(c if " " <= c <= "~" else _escaped(c) for c in text[: TRACEBACK_BYTES + 1])


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode()
