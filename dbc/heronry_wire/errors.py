"""The base class of all errors that a caller, or in the end a user, can correct.

Bytes from outside that break a rule raise no error: a decoder returns a `Malformed` value for them (`frame`). An error
is for callers in this project. Its message is one sentence that says what is wrong, where, and what to do, and can be
shown to a user unchanged. Any other exception is a defect of this program.
"""


class HeronryError(Exception):
    """An error that the caller or the user can correct; the message is one sentence for the user."""


def on_one_line(text: str) -> str:
    """Escape characters that are not printable, so that quoted text stays on one line."""
    if text.isprintable():
        return text  # as nearly always, and each name of a spec is quoted before it is known to be wrong
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
