"""The one root of all errors that a caller, or in the end a user, can mend.

Bad bytes are values, not errors. An error is for our own callers; its message is one sentence that says what is wrong,
where, and what to do, fit to be shown as it is. Whatever is not a HeronryError is a defect of ours.
"""


class HeronryError(Exception):
    """Something that the caller can mend; the message is for people."""


def on_one_line(text: str) -> str:
    """Escape what is not printable, so that whatever is quoted breaks no sentence."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
